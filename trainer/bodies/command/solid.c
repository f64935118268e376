// portmet-train solid: learns the material of a body from its fields.
#include <stdio.h>
#include <time.h>

#include "base/files.h"
#include "base/options.h"
#include "bodies/bodies.h"
#include "bodies/solid/solid_fit.h"
#include "model/part.h"
#include "scene/weights.h"

#define MOST_FIELDS 16

static void print_score(void *context, int iteration, const double score[PM_SOLID_NSCORE]) {
    (void)context;
    printf("%9d %12.4f %12.4f %12.4f %12.4f\n", iteration, 100 * score[PM_SOLID_DISPLACEMENT],
           100 * score[PM_SOLID_STRESS], 100 * score[PM_SOLID_STORED],
           100 * score[PM_SOLID_DISSIPATED]);
    fflush(stdout);
}

pm_status pm_command_solid(int argc, char **argv, const volatile sig_atomic_t *stop) {
    const char *path[MOST_FIELDS + 1] = {NULL}; // NULL after the last
    const char *trajectories = NULL, *output = NULL;
    int64_t nbranch = 2, nunit = 0, iterations = 12;
    const pm_option table[] = {
        {"--branches", NULL, "N", .count = &nbranch, .most = PM_SOLID_MAX_BRANCHES,
         .help = "relaxing branches of the material, 0 to 4 (default: 2)"},
        {"--units", NULL, "N", .count = &nunit, .most = PM_SOLID_MAX_UNITS,
         .help = "hidden units of each learned function, 0 to 16 (default: 0)"},
        {"--iterations", NULL, "N", .count = &iterations, .most = 1000,
         .help = "the most iterations of each of the two stages (default: 12)"},
        {"--trajectories", NULL, "LIST", NULL, &trajectories, false,
         .help = "only these of each file, such as 0:3 (not including 3), or 0,3,6:9"},
        {"--output", "-o", "FILE", NULL, &output, true, .help = "weights to write (HDF5)",
         .is_output = true, .kind = PM_FILES_WEIGHTS},
    };
    const pm_options options = {
        .usage = "portmet-train solid FIELD [FIELD...] -o FILE [options]",
        .summary =
            "Learns the material of bodies from their fields: displacements, stresses, forces,\n"
            "stored and dissipated energies. The material then serves bodies of any shape, on any\n"
            "mesh of bricks. FIELD is a file such as `truth` writes for bodies on a mesh.",
        .examples = "portmet-train solid small_beam.h5 -o material.h5",
        .positional_name = "FIELD",
        .positional = path,
        .most = MOST_FIELDS,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
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
    pm_solid_fit_settings settings = {.spec = {(int)nbranch, (int)nunit, PM_DEFAULT_TEMPERATURE},
                                      .iterations = (int)iterations,
                                      .data = data,
                                      .stop = stop,
                                      .tell = print_score};
    for (int i = 0; path[i] != NULL; ++i) {
        PM_TRY_DONE(pm_field_load(&field[i], path[i]));
        PM_TRY_DONE(pm_solid_data_open(&data[i], field[i], &arena));
        PM_TRY_DONE(pm_options_list(trajectories, field[i]->ntrajectory, data[i].trajectory,
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
                                      .data = path[0],
                                      .trajectories = trajectories,
                                      .seed = 1,
                                      .loss = loss,
                                      .seconds = seconds};
    PM_TRY_DONE(pm_weights_save(output, pm_component_of_part(&part), &provenance));
    printf("wrote %s: %zu weights, %.0f s of CPU time\n", output, pm_params_trained(&part.params),
           seconds);
done:
    pm_part_free(&part);
    pm_arena_free(&arena);
    for (int i = 0; i < MOST_FIELDS; ++i) {
        pm_field_free(field[i]);
    }
    return status;
}
