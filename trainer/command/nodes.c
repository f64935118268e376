// portmet-train nodes: writes fields of a body as trajectories of nodal values.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "body/solid_nodes.h"
#include "command/commands.h"

typedef struct nodes_arguments {
    const char *fields, *mesh, *temperature, *states, *trajectories, *output;
} nodes_arguments;

static pm_status read_arguments(nodes_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--mesh", NULL, "FILE", NULL, &a->mesh, true, "mesh to write (HDF5)"},
        {"--temperature", NULL, "T", NULL, &a->temperature, false,
         "K, at which dissipated energy becomes entropy (default: 300)"},
        {"--states", NULL, "N", NULL, &a->states, false,
         "write only the first N states of each trajectory"},
        {"--trajectories", NULL, "LIST", NULL, &a->trajectories, false,
         "only these, such as 0:40 (not including 40), 0,3,6:9, or 40: (to the last)"},
        {"--output", "-o", "FILE", NULL, &a->output, true, "dataset to write (HDF5)"},
    };
    const pm_options options = {
        .usage = "portmet-train nodes FIELDS --mesh FILE -o FILE [options]",
        .summary = "Writes the fields of a body as trajectories of the values at its nodes,\n"
                   "a dataset for `evaluate`, and the mesh, which a scene with a solid names.\n"
                   "`reconstruct` turns nodal values into fields again.",
        .positional_name = "FIELDS",
        .positional = &a->fields,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, helped));
    return pm_options_output("--output", a->output);
}

// Reads the number of states to keep.
static pm_status read_states(const nodes_arguments *a, const pm_field *field, int *nstate) {
    double count = field->ntime;
    if (a->states != NULL) {
        PM_TRY(pm_options_positive("--states", a->states, &count));
    }
    if (count != floor(count) || count > field->ntime) {
        return pm_fail(PM_EUSAGE, "--states: expected a whole number up to %d, found \"%s\"",
                       field->ntime, a->states);
    }
    *nstate = (int)count;
    return PM_OK;
}

// Makes the dataset, and writes the mesh.
static pm_status make_nodes(const nodes_arguments *a, const pm_field *field, int count,
                            const int *trajectory, pm_dataset **nodes) {
    pm_arena arena = {0};
    pm_solid_data data;
    double temperature = PM_DEFAULT_TEMPERATURE;
    int nstate = 0;
    pm_status status;
    if (a->temperature != NULL) {
        PM_TRY(pm_options_positive("--temperature", a->temperature, &temperature));
    }
    PM_TRY(read_states(a, field, &nstate));
    PM_TRY_DONE(pm_solid_data_open(&data, field, &arena));
    memcpy(data.trajectory, trajectory, (size_t)count * sizeof *trajectory);
    data.count = count;
    PM_TRY_DONE(pm_solid_mesh_save(&data.mesh, a->mesh));
    printf("wrote %s: %d nodes, %d bricks\n", a->mesh, data.mesh.nnode, data.mesh.nelement);
    status = pm_solid_nodes_dataset(nodes, &data, nstate, temperature);
done:
    pm_arena_free(&arena);
    return status;
}

static pm_status write_nodes(const nodes_arguments *a, const pm_field *field, const char *command) {
    int count = 0, *trajectory = calloc((size_t)field->ntrajectory, sizeof *trajectory);
    pm_dataset *nodes = NULL;
    pm_status status;
    if (trajectory == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a list of trajectories");
    }
    PM_TRY_DONE(pm_options_list(a->trajectories, field->ntrajectory, trajectory, &count));
    PM_TRY_DONE(make_nodes(a, field, count, trajectory, &nodes));
    PM_TRY_DONE(pm_dataset_note(nodes, "title", "Nodal values of %s", a->fields));
    PM_TRY_DONE(pm_dataset_note(nodes, "source", "portmet-train nodes"));
    PM_TRY_DONE(pm_dataset_note(nodes, "command", "%s", command));
    PM_TRY_DONE(pm_dataset_save(nodes, a->output));
    printf("wrote %s: %d trajectories of %d states, %d columns\n", a->output, nodes->ntrajectory,
           nodes->ntime, nodes->ncolumn);
done:
    pm_dataset_free(nodes);
    free(trajectory);
    return status;
}

pm_status pm_command_nodes(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    nodes_arguments a = {0};
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_field *field = NULL;
    pm_status status;
    PM_TRY_DONE(pm_field_load(&field, a.fields));
    PM_TRY_DONE(write_nodes(&a, field, command));
done:
    pm_field_free(field);
    return status;
}
