// portmet-train solid: learns the material of a body from its fields.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/options.h"
#include "body/solid_fit.h"
#include "command/commands.h"
#include "model/part.h"
#include "scene/weights.h"

#define MOST_FIELDS 16

typedef struct solid_arguments {
    const char *path[MOST_FIELDS + 1]; // NULL after the last
    const char *branches, *units, *iterations, *trajectories, *output;
} solid_arguments;

static pm_status read_arguments(solid_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--branches", NULL, "N", NULL, &a->branches, false,
         "relaxing branches of the material, 0 to 4 (default: 2)"},
        {"--units", NULL, "N", NULL, &a->units, false,
         "hidden units of each learned function, 0 to 16 (default: 0)"},
        {"--iterations", NULL, "N", NULL, &a->iterations, false,
         "the most iterations of each of the two stages (default: 12)"},
        {"--trajectories", NULL, "LIST", NULL, &a->trajectories, false,
         "only these of each file, such as 0:3 (not including 3), or 0,3,6:9"},
        {"--output", "-o", "FILE", NULL, &a->output, true, "weights to write (HDF5)"},
    };
    const pm_options options = {
        .usage = "portmet-train solid FIELD [FIELD...] -o FILE [options]",
        .summary =
            "Learns the material of bodies from their fields: displacements, stresses, forces,\n"
            "stored and dissipated energies. The material then serves bodies of any shape, on any\n"
            "mesh of bricks. FIELD is a file such as `truth` writes for bodies on a mesh.",
        .positional_name = "FIELD",
        .positional = a->path,
        .most = MOST_FIELDS,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, helped));
    return pm_options_output("--output", a->output);
}

// Reads a whole number from 0 to `most`.
static pm_status read_count(const char *name, const char *text, int most, int *count) {
    char *end = NULL;
    const long number = text == NULL ? *count : strtol(text, &end, 10);
    if (text != NULL && (end == text || *end != '\0' || number < 0 || number > most)) {
        return pm_fail(PM_EUSAGE, "%s: expected 0 to %d, found \"%s\"", name, most, text);
    }
    *count = (int)number;
    return PM_OK;
}

static void print_score(void *context, int iteration, const double score[PM_SOLID_NSCORE]) {
    (void)context;
    printf("%9d %12.4f %12.4f %12.4f %12.4f\n", iteration, 100 * score[PM_SOLID_DISPLACEMENT],
           100 * score[PM_SOLID_STRESS], 100 * score[PM_SOLID_STORED],
           100 * score[PM_SOLID_DISSIPATED]);
    fflush(stdout);
}

#define MOST_GROUPS 3

// The layout of a node, a point and a body; a scene has as many of each as the mesh has. It refers
// to `group`, which the function fills in.
static pm_layout layout_of(int nbranch, pm_group group[MOST_GROUPS]) {
    pm_layout layout = {.ngroup = 2, .group = group};
    group[0] = (pm_group){"u", "m", 3, 0};
    if (nbranch > 0) {
        layout.group[1] = (pm_group){"inner", "1", PM_SYM * nbranch, 3};
        layout.ngroup = 3;
    }
    layout.group[layout.ngroup - 1] = (pm_group){"s", "J/K", 1, 3 + PM_SYM * nbranch};
    layout.nz = 4 + PM_SYM * nbranch;
    return layout;
}

static pm_status learn(const solid_arguments *a, pm_solid_fit_settings *settings, pm_part *part,
                       pm_group group[MOST_GROUPS], const char *command) {
    double score[PM_SOLID_NSCORE], loss = 0;
    const clock_t start = clock();
    part->spec = (pm_part_spec){.form = PM_HARD, .solid = &settings->spec};
    part->layout = layout_of(settings->spec.nbranch, group);
    PM_TRY(pm_part_declare(part));
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    pm_params_randomise(&part->params, &rng);
    PM_TRY(pm_solid_fit_start(settings, &part->params));
    printf("Root mean squares over all trajectories, in %% of each quantity's size\n"
           "iteration displacement       stress       stored   dissipated\n");
    PM_TRY(pm_solid_fit(settings, &part->params, score));
    for (int k = 0; k < PM_SOLID_NSCORE; ++k) {
        loss += score[k] * score[k];
    }
    const double seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    const pm_provenance provenance = {.command = command,
                                      .data = a->path[0],
                                      .trajectories = a->trajectories,
                                      .seed = 1,
                                      .loss = loss,
                                      .seconds = seconds};
    PM_TRY(pm_weights_save_part(a->output, part, &provenance));
    printf("wrote %s: %zu weights, %.0f s of CPU time\n", a->output,
           pm_params_trained(&part->params), seconds);
    return PM_OK;
}

pm_status pm_command_solid(int argc, char **argv, const volatile sig_atomic_t *stop) {
    solid_arguments a;
    memset(&a, 0, sizeof a);
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_solid_data data[MOST_FIELDS];
    pm_field *field[MOST_FIELDS] = {NULL};
    pm_arena arena = {0};
    pm_group group[MOST_GROUPS]; // of the part's layout
    pm_part part = {0};
    pm_status status;
    pm_solid_fit_settings settings = {.spec = {2, 0, PM_DEFAULT_TEMPERATURE},
                                      .iterations = 12,
                                      .data = data,
                                      .stop = stop,
                                      .tell = print_score};
    PM_TRY_DONE(
        read_count("--branches", a.branches, PM_SOLID_MAX_BRANCHES, &settings.spec.nbranch));
    PM_TRY_DONE(read_count("--units", a.units, PM_SOLID_MAX_UNITS, &settings.spec.nunit));
    PM_TRY_DONE(read_count("--iterations", a.iterations, 1000, &settings.iterations));
    for (int i = 0; a.path[i] != NULL; ++i) {
        PM_TRY_DONE(pm_field_load(&field[i], a.path[i]));
        PM_TRY_DONE(pm_solid_data_open(&data[i], field[i], &arena));
        PM_TRY_DONE(pm_options_list(a.trajectories, field[i]->ntrajectory, data[i].trajectory,
                                    &data[i].count));
        settings.ndata = i + 1;
    }
    status = learn(&a, &settings, &part, group, command);
done:
    pm_part_free(&part);
    pm_arena_free(&arena);
    for (int i = 0; i < MOST_FIELDS; ++i) {
        pm_field_free(field[i]);
    }
    return status;
}
