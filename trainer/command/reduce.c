// portmet-train reduce: finds the modes of a body, and writes its fields as trajectories of their
// amplitudes.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "command/commands.h"
#include "modal/reduce.h"
#include "modal/save_modes.h"
#include "store/yaml.h"

typedef struct reduce_arguments {
    const char *configuration, *data, *basis, *trajectories, *output;
} reduce_arguments;

static pm_status read_arguments(reduce_arguments *a, int argc, char **argv, bool *helped) {
    const pm_option table[] = {
        {"--data", "-d", "FILE", NULL, &a->data, true, "fields of the body (HDF5)"},
        {"--basis", "-b", "FILE", NULL, &a->basis, false,
         "project on this basis instead of making one as CONFIG says"},
        {"--trajectories", NULL, "LIST", NULL, &a->trajectories, false,
         "only these, such as 0:40 (not including 40), 0,3,6:9, or 40: (to the last)"},
        {"--output", "-o", "DIR", NULL, &a->output, true,
         "write modes.h5 into DIR, and basis.h5 unless --basis is given"},
    };
    const pm_options options = {
        .usage = "portmet-train reduce CONFIG --data FIELDS -o DIR [options]",
        .summary =
            "Finds the modes in which a body moves, and writes its fields as trajectories of "
            "their\n"
            "amplitudes: a dataset for `fit` and `evaluate`. `reconstruct` turns amplitudes into\n"
            "fields again.",
        .positional_name = "CONFIG",
        .positional = &a->configuration,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    return pm_options_read(&options, argc, argv, helped);
}

static pm_status read_positive(pm_yaml root, const char *key, double *result) {
    pm_yaml value;
    PM_TRY(pm_yaml_require(root, key, &value));
    PM_TRY(pm_yaml_double(value, 0, INFINITY, result));
    return *result > 0 ? PM_OK : pm_yaml_fail(value, "expected a number > 0");
}

static pm_status read_count(pm_yaml root, const char *key, int most, int *result) {
    pm_yaml value;
    PM_TRY(pm_yaml_require(root, key, &value));
    return pm_yaml_int(value, 1, most, result);
}

static pm_status read_relaxation(pm_yaml list, pm_arena *arena, pm_reduce_settings *settings) {
    double *tau = NULL;
    PM_TRY(pm_yaml_doubles(list, arena, &settings->nbranch, &tau));
    if (settings->nbranch > PM_BASIS_MAX_BRANCHES) {
        return pm_yaml_fail(list, "expected at most %d times", PM_BASIS_MAX_BRANCHES);
    }
    for (int i = 0; i < settings->nbranch; ++i) {
        if (!(tau[i] > 0)) {
            return pm_yaml_fail(list, "expected times > 0");
        }
        settings->tau[i] = tau[i];
    }
    return PM_OK;
}

static pm_status read_settings(pm_yaml root, pm_arena *arena, pm_reduce_settings *settings) {
    static const char *const keys[] = {"modes",        "state",       "leading",      "relaxation",
                                       "inertia_time", "temperature", "displacement", "stress",
                                       "symmetry",     "reach",       "trajectories", NULL};
    static const char *const sections[] = {"any", "square", NULL};
    pm_yaml value;
    int section = 0;
    PM_TRY(pm_yaml_allow(root, keys));
    PM_TRY(read_count(root, "modes", PM_BASIS_MAX_MODES, &settings->nmode));
    PM_TRY(read_count(root, "state", settings->nmode, &settings->nstate));
    PM_TRY(read_count(root, "leading", settings->nmode, &settings->nlead));
    PM_TRY(read_positive(root, "inertia_time", &settings->inertia_time));
    PM_TRY(read_positive(root, "temperature", &settings->temperature));
    PM_TRY(read_count(root, "displacement", PM_BASIS_MAX_RANK, &settings->displacement_rank));
    PM_TRY(read_count(root, "stress", PM_BASIS_MAX_RANK, &settings->stress_rank));
    if (pm_yaml_exists(value = pm_yaml_get(root, "relaxation"))) {
        PM_TRY(read_relaxation(value, arena, settings));
    }
    if (pm_yaml_exists(value = pm_yaml_get(root, "reach"))) {
        PM_TRY(pm_yaml_int(value, 0, PM_LOCAL_MAX_REACH, &settings->reach));
    }
    if (pm_yaml_exists(value = pm_yaml_get(root, "symmetry"))) {
        PM_TRY(pm_yaml_choice(value, sections, &section));
    }
    settings->square = section == 1;
    return PM_OK;
}

static void print_basis(const pm_basis *b) {
    printf("modes             %d, of which %d carry the energy; %d features\n", b->nmode, b->nstate,
           pm_basis_features(b));
    printf("stiffness         ");
    for (int i = 0; i < b->nmode; ++i) {
        printf("%s%.3g", i == 0 ? "" : i == b->nstate ? " | " : " ", b->stiffness[i]);
    }
    printf("\n");
    for (int i = 0; i < b->nretardation; ++i) {
        printf("%s%.3g s", i == 0 ? "retardation       " : ", ", b->retardation[i]);
    }
    printf(b->nretardation > 0 ? "\n" : "");
}

static pm_status save_basis(const pm_basis *basis, const char *folder, const char *command) {
    pm_arena arena = {0};
    const char *path = pm_arena_printf(&arena, "%s/basis.h5", folder);
    const pm_status status = path == NULL ? pm_fail(PM_ENOMEM, "out of memory for a path")
                                          : pm_basis_save(basis, path, command);
    pm_arena_free(&arena);
    return status;
}

// Loads or makes the basis, and lists the trajectories.
static pm_status find_basis(const reduce_arguments *a, pm_yaml root, const pm_field *field,
                            const char *command, pm_basis **basis, pm_reduce_settings *settings,
                            int *trajectory, int *count) {
    pm_arena arena = {0};
    const char *range = a->trajectories;
    pm_status status = read_settings(root, &arena, settings);
    const pm_yaml value = pm_yaml_get(root, "trajectories");
    if (status == PM_OK && range == NULL && a->basis == NULL && pm_yaml_exists(value)) {
        status = pm_yaml_text(value, &arena, &range);
    }
    if (status == PM_OK) {
        status = pm_options_list(range, field->ntrajectory, trajectory, count);
    }
    if (status == PM_OK && a->basis != NULL) {
        status = pm_basis_load(basis, a->basis);
    } else if (status == PM_OK) {
        status = pm_reduce_fit(basis, field, *count, trajectory, settings);
        if (status == PM_OK) {
            print_basis(*basis);
            status = save_basis(*basis, a->output, command);
        }
    }
    pm_arena_free(&arena);
    return status;
}

static pm_status write_modes(const reduce_arguments *a, const pm_basis *basis,
                             const pm_field *field, int count, const int *trajectory, bool square,
                             const char *command) {
    pm_dataset *modes = NULL;
    PM_TRY(pm_reduce_project(&modes, basis, field, count, trajectory, square, PM_LOADS_OF_ALL));
    const pm_status status = pm_modes_save(modes, basis, a->data, "reduce", command, a->output);
    pm_dataset_free(modes);
    return status;
}

pm_status pm_command_reduce(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    reduce_arguments a;
    memset(&a, 0, sizeof a);
    bool helped = false;
    PM_TRY(read_arguments(&a, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_field *field = NULL;
    pm_basis *basis = NULL;
    pm_reduce_settings settings = {0};
    int count = 0, *trajectory = NULL;
    pm_status status;
    PM_TRY_DONE(pm_yaml_open(&document, a.configuration, &root));
    PM_TRY_DONE(pm_field_load(&field, a.data));
    PM_TRY_DONE(pm_options_folder(a.output));
    trajectory = calloc((size_t)field->ntrajectory, sizeof *trajectory);
    if (trajectory == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a list of trajectories");
        goto done;
    }
    PM_TRY_DONE(find_basis(&a, root, field, command, &basis, &settings, trajectory, &count));
    // A dataset to train on contains the symmetric copies; a mere projection does not.
    status = write_modes(&a, basis, field, count, trajectory, settings.square && a.basis == NULL,
                         command);
done:
    free(trajectory);
    pm_basis_free(basis);
    pm_field_free(field);
    pm_yaml_close(document);
    return status;
}
