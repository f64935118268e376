// portmet-train nodes: fields of a body as trajectories of nodal values, and back.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "nodal.h"
#include "options.h"

typedef struct arguments {
    const char *fields, *relaxation, *temperature, *states, *trajectories, *output;
} arguments;

static pm_status read_arguments(arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--relaxation", NULL, "TAU[,TAU...]", NULL, &a->relaxation, false,
         "s, of a viscoelastic body's Prony series, e.g. 0.2,0.5; without, it remembers nothing"},
        {"--temperature", NULL, "T", NULL, &a->temperature, false,
         "K, by which what is dissipated is divided (default: 300)"},
        {"--states", NULL, "N", NULL, &a->states, false, "only the first N of each trajectory"},
        {"--trajectories", NULL, "LIST", NULL, &a->trajectories, false,
         "only these, such as 0:40 (not including 40), 0,3,6:9, or 40: up to the last"},
        {"--output", "-o", "FILE", NULL, &a->output, true, "dataset to write (HDF5)"},
    };
    const pm_options options = {
        .usage = "portmet-train nodes FIELDS -o FILE [options]",
        .summary =
            "Writes fields of a body on a box of bricks as trajectories of the values at its\n"
            "free nodes, a dataset for `fit` and `evaluate` of networks on its mesh.\n"
            "`reconstruct` goes back.",
        .positional_name = "FIELDS",
        .positional = &a->fields,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    return pm_options_read(&options, argc, argv, helped);
}

// A number > 0 up to `end`.
static pm_status read_positive(const char *option, const char **text, double *number) {
    char *end;
    *number = strtod(*text, &end);
    if (end == *text || !isfinite(*number) || *number <= 0) {
        return pm_fail(PM_EUSAGE, "nodes: %s \"%s\": expected a number > 0", option, *text);
    }
    *text = end;
    return PM_OK;
}

// The number of states to keep.
static pm_status read_states(const arguments *a, const pm_field *field, pm_nodal_how *how) {
    double count = field->ntime;
    const char *text = a->states;
    if (text != NULL) {
        PM_TRY(read_positive("--states", &text, &count));
    }
    if (count != floor(count) || count > field->ntime || (text != NULL && *text != '\0')) {
        return pm_fail(PM_EUSAGE, "nodes: --states \"%s\": expected a whole number up to %d",
                       a->states, field->ntime);
    }
    how->nstate = (int)count;
    return PM_OK;
}

static pm_status read_how(const arguments *a, pm_nodal_how *how) {
    const char *text = a->temperature;
    how->temperature = 300;
    if (text != NULL) {
        PM_TRY(read_positive("--temperature", &text, &how->temperature));
        if (*text != '\0') {
            return pm_fail(PM_EUSAGE, "nodes: --temperature \"%s\": expected one number",
                           a->temperature);
        }
    }
    for (text = a->relaxation; text != NULL && *text != '\0';) {
        if (how->nbranch == PM_NODAL_MOST_BRANCHES) {
            return pm_fail(PM_EUSAGE, "nodes: --relaxation: at most %d times",
                           PM_NODAL_MOST_BRANCHES);
        }
        PM_TRY(read_positive("--relaxation", &text, &how->tau[how->nbranch++]));
        if (*text != '\0' && (*text++ != ',' || *text == '\0')) {
            return pm_fail(PM_EUSAGE, "nodes: --relaxation \"%s\": expected times and commas",
                           a->relaxation);
        }
    }
    return PM_OK;
}

static pm_status print_mesh(const pm_field *field) {
    pm_arena arena = {0};
    const pm_mesh *mesh;
    const int *node;
    const pm_status status = pm_nodal_mesh(field, &arena, &mesh, &node);
    if (status == PM_OK) {
        printf("mesh: {size: [%g, %g, %g], elements: [%d, %d, %d]}   %d free nodes, %d edges\n",
               mesh->size[0], mesh->size[1], mesh->size[2], mesh->elements[0], mesh->elements[1],
               mesh->elements[2], mesh->nnode, mesh->nedge);
    }
    pm_arena_free(&arena);
    return status;
}

static pm_status write_nodes(const arguments *a, const pm_field *field, const pm_nodal_how *how,
                             const char *command) {
    int count = 0, *which = calloc((size_t)field->ntrajectory, sizeof *which);
    pm_dataset *nodes = NULL;
    pm_status status;
    if (which == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a list of trajectories");
    }
    PM_TRY_DONE(pm_options_list(a->trajectories, field->ntrajectory, which, &count));
    PM_TRY_DONE(pm_nodal_dataset(&nodes, field, count, which, how));
    PM_TRY_DONE(pm_dataset_note(nodes, "title", "Nodal values of %s", a->fields));
    PM_TRY_DONE(pm_dataset_note(nodes, "source", "portmet-train nodes"));
    PM_TRY_DONE(pm_dataset_note(nodes, "command", "%s", command));
    PM_TRY_DONE(pm_dataset_save(nodes, a->output));
    printf("wrote %s: %d trajectories of %d states, %d columns\n", a->output, nodes->ntrajectory,
           nodes->ntime, nodes->ncolumn);
done:
    pm_dataset_free(nodes);
    free(which);
    return status;
}

pm_status pm_command_nodes(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    arguments a = {0};
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_nodal_how how = {0};
    pm_field *field = NULL;
    pm_status status;
    PM_TRY(read_how(&a, &how));
    PM_TRY_DONE(pm_field_load(&field, a.fields));
    PM_TRY_DONE(read_states(&a, field, &how));
    PM_TRY_DONE(print_mesh(field));
    PM_TRY_DONE(write_nodes(&a, field, &how, command));
done:
    pm_field_free(field);
    return status;
}
