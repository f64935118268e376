// portmet-train reduce: finds the modes of a body, and writes its fields as trajectories of their
// amplitudes.
#include <float.h>
#include <math.h>
#include <stdio.h>

#include "base/options.h"
#include "bodies/bodies.h"
#include "bodies/command/fields.h"
#include "bodies/modal/reduce.h"
#include "store/yaml.h"

static pm_status read_settings(pm_yaml root, pm_arena *arena, pm_reduce_settings *settings) {
    static const char *const sections[] = {"any", "square", NULL};
    pm_reduce_settings *s = settings;
    pm_yaml state, leading, turned, relaxation;
    double *tau = NULL;
    int section = 0;
    const pm_yaml_key keys[] = {
        {PM_YAML_INT("modes", &s->nmode, 1, PM_BASIS_MAX_MODES), .required = true},
        {PM_YAML_VALUE("state", &state), .required = true},
        {PM_YAML_VALUE("leading", &leading), .required = true},
        {PM_YAML_VALUE("turned", &turned)},
        {PM_YAML_VALUE("relaxation", &relaxation)},
        {PM_YAML_DOUBLE("inertia_time", &s->inertia_time, DBL_MIN, INFINITY), .required = true},
        {PM_YAML_DOUBLE("temperature", &s->temperature, DBL_MIN, INFINITY), .required = true},
        {PM_YAML_INT("displacement", &s->displacement_rank, 1, PM_BASIS_MAX_RANK),
         .required = true},
        {PM_YAML_INT("stress", &s->stress_rank, 1, PM_BASIS_MAX_RANK), .required = true},
        {PM_YAML_CHOICE("symmetry", &section, sections)},
        {PM_YAML_INT("reach", &s->reach, 0, PM_LOCAL_MAX_REACH)},
        {PM_YAML_VALUE("trajectories", NULL)}, // the command reads it
        {0}};
    PM_TRY(pm_yaml_read(root, arena, keys));
    PM_TRY(pm_yaml_int(state, 1, s->nmode, &s->nstate));
    PM_TRY(pm_yaml_int(leading, 1, s->nmode, &s->nlead));
    if (pm_yaml_exists(turned)) {
        PM_TRY(pm_yaml_int(turned, s->nstate, s->nmode, &s->nturned));
    }
    if (pm_yaml_exists(relaxation)) {
        PM_TRY(pm_yaml_doubles(relaxation, arena, &s->nbranch, &tau));
        if (s->nbranch > PM_BASIS_MAX_BRANCHES) {
            return pm_yaml_fail(relaxation, "expected at most %d times", PM_BASIS_MAX_BRANCHES);
        }
        for (int i = 0; i < s->nbranch; ++i) {
            if (!(tau[i] > 0)) {
                return pm_yaml_fail(relaxation, "expected times > 0");
            }
            s->tau[i] = tau[i];
        }
    }
    s->square = section == 1;
    return PM_OK;
}

pm_status pm_command_reduce(int argc, char **argv, const volatile sig_atomic_t *stop) {
    (void)stop;
    const char *configuration = NULL, *data = NULL, *given = NULL, *trajectories = NULL;
    const char *output = NULL;
    const pm_option table[] = {
        {"--data", "-d", "FILE", NULL, &data, true, .help = "fields of the body (HDF5)"},
        {"--basis", "-b", "FILE", NULL, &given, false,
         .help = "project on this basis instead of making one as CONFIG says"},
        {"--trajectories", NULL, "LIST", NULL, &trajectories, false,
         .help = "only these, such as 0:40 (not including 40), 0,3,6:9, or 40: (to the last)"},
        {"--output", "-o", "DIR", NULL, &output, true,
         .help = "write modes.h5 into DIR, and basis.h5 unless --basis is given"},
    };
    const pm_options options = {
        .usage = "portmet-train reduce CONFIG --data FIELDS -o DIR [options]",
        .summary =
            "Finds the modes in which a body moves, and writes its fields as trajectories of "
            "their\n"
            "amplitudes: a dataset for `fit` and `evaluate`. `reconstruct` turns amplitudes into\n"
            "fields again.",
        .examples = "portmet-train reduce configs/modes/beam.yaml --data beam.h5 -o reduced",
        .positional_name = "CONFIG",
        .positional = &configuration,
        PM_OPTION_TABLE(table),
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    char command[1024];
    pm_options_line(argc, argv, command, sizeof command);
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_field *field = NULL;
    pm_basis *basis = NULL;
    pm_dataset *modes = NULL;
    pm_arena arena = {0};
    pm_reduce_settings settings = {0};
    int count = 0, *trajectory = NULL;
    pm_status status;
    PM_TRY_DONE(pm_yaml_open(&document, configuration, &root));
    PM_TRY_DONE(pm_field_load(&field, data));
    PM_TRY_DONE(pm_options_folder(output));
    PM_TRY_DONE(read_settings(root, &arena, &settings));
    const pm_yaml own = pm_yaml_get(root, "trajectories");
    if (trajectories == NULL && given == NULL && pm_yaml_exists(own)) {
        PM_TRY_DONE(pm_yaml_text(own, &arena, &trajectories));
    }
    PM_TRY_DONE(
        pm_trajectories_list(trajectories, field->ntrajectory, &arena, &trajectory, &count));
    if (given != NULL) {
        PM_TRY_DONE(pm_basis_load(&basis, given));
    } else {
        PM_TRY_DONE(pm_reduce_fit(&basis, field, count, trajectory, &settings));
        printf("modes             %d, of which %d carry the energy; %d features\n", basis->nmode,
               basis->nstate, pm_basis_features(basis));
        printf("stiffness         ");
        for (int i = 0; i < basis->nmode; ++i) {
            printf("%s%.3g", i == 0 ? "" : i == basis->nstate ? " | " : " ", basis->stiffness[i]);
        }
        printf("\n");
        for (int i = 0; i < basis->nretardation; ++i) {
            printf("%s%.3g s", i == 0 ? "retardation       " : ", ", basis->retardation[i]);
        }
        printf(basis->nretardation > 0 ? "\n" : "");
        const char *path = pm_arena_printf(&arena, "%s/basis.h5", output);
        PM_TRY_DONE(pm_arena_status(&arena, "a path"));
        PM_TRY_DONE(pm_basis_save(basis, path, command));
    }
    // A dataset to train on contains the symmetric copies; a mere projection does not.
    PM_TRY_DONE(pm_reduce_project(&modes, basis, field, count, trajectory,
                                  settings.square && given == NULL, PM_LOADS_OF_ALL));
    status = pm_modes_save(modes, basis, data, "reduce", command, output);
done:
    pm_dataset_free(modes);
    pm_arena_free(&arena);
    pm_basis_free(basis);
    pm_field_free(field);
    pm_yaml_close(document);
    return status;
}
