// Makes many double pendula for runs over LCM (random_over_lcm.sh). Their weights are the shipped
// ones plus random numbers as large as initial weights. One process serves all upper links and
// another one all lower links, so that every port uses the network.
//   random_pairs make DIR CONFIGS FIRST COUNT METHOD   writes DIR/scene.yaml and its weights; those
//                                                      of pair i are of stream FIRST + i
//   random_pairs check DIR RECORDING                   exits with 9 unless every number recorded is
//                                                      finite, and with 10 if an entropy falls
//   random_pairs check_begun DIR RECORDING             the same for a run that ended early
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "scene/columns.h"
#include "scene/system.h"
#include "store/dataset.h"
#include "store/hdf5_io.h"

#define SEED 5
#define STEPS 20
// J/K; entropies are of order one, and summed over the substeps of a step.
#define LARGEST_FALL 1e-12
#define MAX_PATH 4096

// --- making a scene ---

static const char *const parts[] = {"upper", "lower"};

static void write_state(FILE *file, const pm_layout *layout, const double *z) {
    fprintf(file, "    state: {");
    for (int g = 0; g < layout->ngroup; ++g) {
        const pm_group *group = &layout->group[g];
        fprintf(file, "%s%s: {unit: %s, size: %d}", g > 0 ? ", " : "", group->name, group->unit,
                group->size);
    }
    fprintf(file, "}\n    initial: {");
    for (int g = 0; g < layout->ngroup; ++g) {
        const pm_group *group = &layout->group[g];
        fprintf(file, "%s%s: [", g > 0 ? ", " : "", group->name);
        for (int c = 0; c < group->size; ++c) {
            fprintf(file, "%s%.17g", c > 0 ? ", " : "", z[group->first + c]);
        }
        fprintf(file, "]");
    }
    fprintf(file, "}\n");
}

static void write_scene(FILE *file, const pm_scene *pair, const double *z, int count,
                        const char *method) {
    fprintf(file,
            "scene: random_pairs\nurl: \"udpm://239.255.76.67:7667?ttl=0\"\n"
            "time: {dt: 0.3, steps: %d, integrator: %s, substeps: 4}\nsubsystems:\n",
            STEPS, method);
    for (int i = 0; i < 2 * count; ++i) {
        const pm_scene_subsystem *part = &pair->physics.subsystem[i % 2];
        fprintf(file, "  %s%d:\n    weights: %s%d.h5\n", parts[i % 2], i / 2, parts[i % 2], i / 2);
        write_state(file, &part->layout, z + part->first);
    }
    fprintf(file, "ports:\n");
    for (int i = 0; i < count; ++i) {
        fprintf(file,
                "  joint%d: {law: bracket, between: [upper%d, lower%d], weights: joint%d.h5,\n"
                "    expose: {upper%d: [q, p, s], lower%d: [q, p, s]}}\n",
                i, i, i, i, i, i);
    }
    fprintf(file, "processes:\n");
    for (int end = 0; end < 2; ++end) {
        fprintf(file, "  %ss: [", parts[end]);
        for (int i = 0; i < count; ++i) {
            fprintf(file, "%s%s%d", i > 0 ? ", " : "", parts[end], i);
        }
        fprintf(file, "]\n");
    }
}

// The numbers of pair `i`, in place of the system's, and its files.
static pm_status make_weights(const char *folder, pm_system *system, double *const *shipped,
                              int stream, int i) {
    static const pm_provenance provenance = {.command = "random_pairs", .data = "", .seed = SEED};
    char path[MAX_PATH];
    pm_rng rng;
    pm_rng_init(&rng, SEED, (uint64_t)stream);
    for (int k = 0; k < pm_system_components(system); ++k) {
        pm_params_scatter(pm_system_params(system, k), shipped[k]);
        pm_params_randomise(pm_system_params(system, k), &rng);
    }
    for (int end = 0; end < 2; ++end) {
        snprintf(path, sizeof path, "%s/%s%d.h5", folder, parts[end], i);
        PM_TRY(pm_weights_save(path, pm_component_of_part(system->part[end]), &provenance));
    }
    snprintf(path, sizeof path, "%s/joint%d.h5", folder, i);
    return pm_weights_save(path, pm_component_of_port(system->port[0]), &provenance);
}

static pm_status make_all(const char *folder, pm_system *system, int first, int count) {
    double *shipped[3];
    for (int k = 0; k < 3; ++k) {
        const pm_params *params = pm_system_params(system, k);
        shipped[k] = pm_arena_array(&system->arena, pm_params_trained(params), sizeof **shipped);
        if (shipped[k] == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for weights");
        }
        pm_params_gather(params, shipped[k]);
    }
    for (int i = 0; i < count; ++i) {
        PM_TRY(make_weights(folder, system, shipped, first + i, i));
    }
    return PM_OK;
}

static pm_status make(const char *folder, const char *configs, int first, int count,
                      const char *method) {
    char path[MAX_PATH];
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_dataset *reference = NULL;
    pm_columns columns;
    double z[64];
    pm_status status;
    snprintf(path, sizeof path, "%s/double_pendulum.yaml", configs);
    PM_TRY_DONE(pm_scene_load(&scene, path));
    PM_TRY_DONE(pm_system_load(&system, scene, NULL));
    PM_TRY_DONE(pm_dataset_load(&reference, scene->run.reference));
    PM_TRY_DONE(pm_columns_bind(&columns, scene, reference, &reference->arena));
    pm_columns_to_state(&columns, pm_dataset_state(reference, 0, 0), z);
    PM_TRY_DONE(make_all(folder, system, first, count));
    snprintf(path, sizeof path, "%s/scene.yaml", folder);
    FILE *file = fopen(path, "w");
    if (file == NULL) {
        status = pm_fail(PM_EFILE, "%s: cannot write", path);
        goto done;
    }
    write_scene(file, scene, z, count, method);
    status = fclose(file) == 0 ? PM_OK : pm_fail(PM_EFILE, "%s: cannot write", path);
done:
    pm_dataset_free(reference);
    pm_system_free(system);
    pm_scene_free(scene);
    return status;
}

// --- checking a recording ---

// Reads one of the arrays of a subsystem, with `count` rows.
static pm_status read_finite(const pm_hdf5 *file, const char *subsystem, const char *what,
                             int count, int width, double *value) {
    char name[256];
    const int extent[2] = {count, width};
    snprintf(name, sizeof name, "/subsystems/%s/%s", subsystem, what);
    PM_TRY(pm_hdf5_read(file, name, width == 0 ? 1 : 2, extent, value));
    for (int i = 0; i < count * (width == 0 ? 1 : width); ++i) {
        if (!isfinite(value[i])) {
            return pm_fail(PM_ENUMERIC, "%s: a number that is not finite went by", name);
        }
    }
    return PM_OK;
}

// Adds the entropies [count] of a subsystem.
static pm_status check_subsystem(const pm_hdf5 *file, const pm_scene_subsystem *subsystem,
                                 int count, double *entropy) {
    double value[(STEPS + 1) * 64];
    PM_TRY(read_finite(file, subsystem->name, "z", count, subsystem->layout.nz, value));
    PM_TRY(read_finite(file, subsystem->name, "E", count, 0, value));
    PM_TRY(read_finite(file, subsystem->name, "S", count, 0, value));
    for (int i = 0; i < count; ++i) {
        entropy[i] += value[i];
    }
    return PM_OK;
}

// Checks the `count` states of all pairs.
static pm_status check_pairs(const pm_hdf5 *file, const pm_scene *scene, int count) {
    for (int i = 0; i < scene->physics.nsubsystem; i += 2) {
        double entropy[STEPS + 1] = {0};
        PM_TRY(check_subsystem(file, &scene->physics.subsystem[i], count, entropy));
        PM_TRY(check_subsystem(file, &scene->physics.subsystem[i + 1], count, entropy));
        for (int k = 1; k < count; ++k) {
            if (!(entropy[k] >= entropy[k - 1] - LARGEST_FALL)) {
                return pm_fail(PM_ELAW, "pair %d: entropy falls by %g J/K in step %d", i / 2,
                               entropy[k - 1] - entropy[k], k);
            }
        }
    }
    return PM_OK;
}

static pm_status check(const char *folder, const char *recording, int most_unsolved) {
    int count = 0;
    char path[MAX_PATH];
    pm_scene *scene = NULL;
    pm_hdf5 *file = NULL;
    pm_status status;
    snprintf(path, sizeof path, "%s/scene.yaml", folder);
    PM_TRY_DONE(pm_scene_load(&scene, path));
    PM_TRY_DONE(pm_hdf5_open(&file, recording, PM_HDF5_ANY, PM_EDATA));
    char name[MAX_PATH];
    snprintf(name, sizeof name, "/subsystems/%s/E", scene->physics.subsystem[0].name);
    PM_TRY_DONE(pm_hdf5_shape(file, name, 1, &count));
    if (count < STEPS + 1 - most_unsolved || count > STEPS + 1 || count < 1) {
        status = pm_fail(PM_EDATA, "%s: %d states, expected %d", recording, count, STEPS + 1);
        goto done;
    }
    status = check_pairs(file, scene, count);
done:
    pm_hdf5_close(file);
    pm_scene_free(scene);
    return status;
}

int main(int argc, char **argv) {
    pm_status status = PM_EUSAGE;
    pm_linalg_init();
    if (argc == 7 && strcmp(argv[1], "make") == 0) {
        status = make(argv[2], argv[3], atoi(argv[4]), atoi(argv[5]), argv[6]);
    } else if (argc == 4 && strcmp(argv[1], "check") == 0) {
        status = check(argv[2], argv[3], 0);
    } else if (argc == 4 && strcmp(argv[1], "check_begun") == 0) {
        status = check(argv[2], argv[3], STEPS);
    }
    if (status != PM_OK) {
        fprintf(stderr, "random_pairs: %s\n",
                status == PM_EUSAGE ? "see its first lines" : pm_error());
    }
    return (int)status;
}
