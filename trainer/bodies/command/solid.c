// portmet-train solid: learns the material of a body from its fields.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/options.h"
#include "bodies/bodies.h"
#include "bodies/solid/solid_fit.h"
#include "model/part.h"
#include "scene/weights.h"

#define MOST_FIELDS 16

typedef struct solid_arguments {
    const char *path[MOST_FIELDS + 1]; // NULL after the last
    const char *branches, *units, *iterations, *trajectories, *output;
} solid_arguments;

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

pm_status pm_command_solid(int argc, char **argv, const volatile sig_atomic_t *stop) {
    solid_arguments a;
    memset(&a, 0, sizeof a);
    bool helped = false;
    const pm_option table[] = {
        {"--branches", NULL, "N", NULL, &a.branches, false,
         "relaxing branches of the material, 0 to 4 (default: 2)"},
        {"--units", NULL, "N", NULL, &a.units, false,
         "hidden units of each learned function, 0 to 16 (default: 0)"},
        {"--iterations", NULL, "N", NULL, &a.iterations, false,
         "the most iterations of each of the two stages (default: 12)"},
        {"--trajectories", NULL, "LIST", NULL, &a.trajectories, false,
         "only these of each file, such as 0:3 (not including 3), or 0,3,6:9"},
        {"--output", "-o", "FILE", NULL, &a.output, true, "weights to write (HDF5)"},
    };
    const pm_options options = {
        .usage = "portmet-train solid FIELD [FIELD...] -o FILE [options]",
        .summary =
            "Learns the material of bodies from their fields: displacements, stresses, forces,\n"
            "stored and dissipated energies. The material then serves bodies of any shape, on any\n"
            "mesh of bricks. FIELD is a file such as `truth` writes for bodies on a mesh.",
        .examples = "portmet-train solid small_beam.h5 -o material.h5",
        .positional_name = "FIELD",
        .positional = a.path,
        .most = MOST_FIELDS,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, &helped));
    PM_TRY(pm_options_output("--output", a.output));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_solid_data data[MOST_FIELDS];
    pm_field *field[MOST_FIELDS] = {NULL};
    pm_arena arena = {0};
    pm_group group[3]; // of the part's layout
    double score[PM_SOLID_NSCORE], loss = 0;
    const clock_t start = clock();
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
    part.spec = (pm_part_spec){.form = PM_HARD, .solid = &settings.spec};
    // The layout of a node, a point and a body; a scene has as many of each as the mesh has.
    part.layout = (pm_layout){.group = group};
    pm_layout_add(&part.layout, "u", "m", 3);
    if (settings.spec.nbranch > 0) {
        pm_layout_add(&part.layout, "inner", "1", PM_SYM * settings.spec.nbranch);
    }
    pm_layout_add(&part.layout, "s", "J/K", 1);
    PM_TRY_DONE(pm_part_declare(&part));
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    pm_params_randomise(&part.params, &rng);
    PM_TRY_DONE(pm_solid_fit_start(&settings, &part.params));
    printf("Root mean squares over all trajectories, in %% of each quantity's size\n"
           "iteration displacement       stress       stored   dissipated\n");
    PM_TRY_DONE(pm_solid_fit(&settings, &part.params, score));
    for (int k = 0; k < PM_SOLID_NSCORE; ++k) {
        loss += score[k] * score[k];
    }
    const double seconds = (double)(clock() - start) / CLOCKS_PER_SEC;
    const pm_provenance provenance = {.command = command,
                                      .data = a.path[0],
                                      .trajectories = a.trajectories,
                                      .seed = 1,
                                      .loss = loss,
                                      .seconds = seconds};
    PM_TRY_DONE(pm_weights_save(a.output, pm_component_of_part(&part), &provenance));
    printf("wrote %s: %zu weights, %.0f s of CPU time\n", a.output, pm_params_trained(&part.params),
           seconds);
done:
    pm_part_free(&part);
    pm_arena_free(&arena);
    for (int i = 0; i < MOST_FIELDS; ++i) {
        pm_field_free(field[i]);
    }
    return status;
}
