// Stress test: runs the shipped double pendula and chains with time steps, states, conductances,
// lengths and weights far from those of training. Every run must complete all steps or end with a
// clear error. In both cases energy must be conserved, entropy must not fall, and the recording
// must be complete.
//   run_stress CONFIGS EFFORT [CSV]
// EFFORT 0 is the test stress, a quarter of 1, the test stress_long; 10 takes some minutes. Exits
// with 10 if a trial finds a fault (trial.h).
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "scene/columns.h"
#include "store/dataset.h"
#include "tests/support/scratch.h"
#include "trial.h"

#define SEED 5
#define LINK_SIZE 5 // q[2] p[2] s

typedef struct stress {
    const char *configs;
    int effort;
    FILE *csv;
    scratch folder;
    const char *recording;
    int faults;
} stress;

// A shipped scene with its weights, and where its reference begins.
typedef struct subject {
    pm_scene *scene;
    pm_system *system;
    pm_dataset *reference;
    double *start; // [scene->nz]
} subject;

static const char *const methods[] = {"rk4", "rk4_balanced", "discrete_gradient"};
#define METHODS (sizeof methods / sizeof *methods)

// How many there are of what is to be `count` for effort 1.
static int times(const stress *t, int count) {
    return t->effort == 0 ? (count + 3) / 4 : count * t->effort;
}

// --- subjects ---

static void subject_close(subject *s) {
    free(s->start);
    pm_dataset_free(s->reference);
    pm_system_free(s->system);
    pm_scene_free(s->scene);
}

// The scene in a file, with `from` replaced by `to` where it first stands.
static pm_status load_edited(pm_scene **scene, const char *path, const char *from, const char *to) {
    char *text = NULL, *edited = NULL;
    size_t size = 0;
    FILE *file = fopen(path, "r");
    const bool read = file != NULL && getdelim(&text, &size, '\0', file) > 0;
    const char *place = read ? strstr(text, from) : NULL;
    pm_status status = pm_fail(PM_EFILE, "%s: cannot be read, or lacks \"%s\"", path, from);
    if (place != NULL &&
        asprintf(&edited, "%.*s%s%s", (int)(place - text), text, to, place + strlen(from)) > 0) {
        status = pm_scene_parse(scene, edited, path);
    }
    if (file != NULL) {
        fclose(file);
    }
    free(text);
    free(edited);
    return status;
}

// With `from` replaced by `to` in its file.
static pm_status subject_open_edited(subject *s, const stress *t, const char *name,
                                     const char *from, const char *to) {
    char path[4096];
    pm_columns columns;
    snprintf(path, sizeof path, "%s/%s.yaml", t->configs, name);
    PM_TRY(load_edited(&s->scene, path, from, to));
    PM_TRY(pm_system_load(&s->system, s->scene, NULL));
    PM_TRY(pm_dataset_load(&s->reference, s->scene->run.reference));
    PM_TRY(pm_columns_bind(&columns, s->scene, s->reference, &s->reference->arena));
    s->start = calloc((size_t)s->scene->physics.nz, sizeof *s->start);
    if (s->start == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a state");
    }
    pm_columns_to_state(&columns, pm_dataset_state(s->reference, 0, 0), s->start);
    return PM_OK;
}

static pm_status subject_open(subject *s, const stress *t, const char *name) {
    return subject_open_edited(s, t, name, "", "");
}

static void set_time(const subject *s, double dt, const char *integrator, int substeps) {
    s->scene->physics.dt = dt;
    s->scene->physics.integrator = pm_integrator_find(integrator);
    s->scene->physics.substeps = substeps;
    s->scene->physics.tolerance = 0;
}

static void finish(stress *t, const trial_row *row) {
    trial_print(row, t->csv);
    t->faults += row->fault[0] != 0;
}

// --- kinds of stress ---

// From a hundredth of the default step to ten times as long.
static pm_status stress_steps(stress *t, const subject *s, const char *name) {
    static const double factor[] = {0.01, 0.1, 1, 3, 10};
    const double dt = s->scene->physics.dt;
    const int substeps = s->scene->physics.substeps;
    for (size_t m = 0; m < METHODS; ++m) {
        for (size_t i = 0; i < sizeof factor / sizeof *factor; ++i) {
            trial_row row = {.count = 0};
            snprintf(row.name, sizeof row.name, "%s, step x %g, %s", name, factor[i], methods[m]);
            set_time(s, dt * factor[i], methods[m], substeps);
            PM_TRY(trial_run(&row, s->system, s->start, times(t, 100), t->recording));
            finish(t, &row);
        }
    }
    set_time(s, dt, "rk4", substeps);
    return PM_OK;
}

// From the edge of what a trajectory passes through to three times beyond: every component by
// itself at up to `reach` half ranges from the middle.
static pm_status stress_states(stress *t, const subject *s, const char *name) {
    static const double reach[] = {1, 2, 3};
    const int nz = s->scene->physics.nz, substeps = s->scene->physics.substeps;
    pm_columns columns;
    PM_TRY(pm_columns_bind(&columns, s->scene, s->reference, &s->reference->arena));
    for (size_t i = 0; i < 2 * sizeof reach / sizeof *reach; ++i) {
        trial_row row = {.count = 0};
        const char *method = methods[1 + i % 2];
        snprintf(row.name, sizeof row.name, "%s, starts x %g of the data, %s", name, reach[i / 2],
                 method);
        set_time(s, s->scene->physics.dt, method, substeps);
        pm_rng rng;
        pm_rng_init(&rng, SEED, i / 2);
        for (int k = 0; k < times(t, 5); ++k) {
            double z[2 * LINK_SIZE], low[2 * LINK_SIZE], high[2 * LINK_SIZE];
            for (int j = 0; j < s->reference->ntime; ++j) {
                pm_columns_to_state(&columns, pm_dataset_state(s->reference, 0, j), z);
                for (int c = 0; c < nz; ++c) {
                    low[c] = j == 0 ? z[c] : fmin(low[c], z[c]);
                    high[c] = j == 0 ? z[c] : fmax(high[c], z[c]);
                }
            }
            for (int c = 0; c < nz; ++c) {
                const double side = pm_rng_below(&rng, 2) == 0 ? -1 : 1;
                z[c] = 0.5 * (low[c] + high[c]) + 0.5 * side * reach[i / 2] * (high[c] - low[c]);
            }
            PM_TRY(trial_run(&row, s->system, z, t->effort == 0 ? 50 : 100, t->recording));
        }
        finish(t, &row);
    }
    set_time(s, s->scene->physics.dt, "rk4", substeps);
    return PM_OK;
}

// The learned conduction of 0.5 W/K made up to 6000 times as strong.
static pm_status stress_conduction(stress *t, const subject *s) {
    static const double K[] = {0.5, 5, 50, 300, 3000};
    pm_param_entry *factor =
        pm_params_find(&s->system->port[0]->params, "irreversible.matrix.constant");
    const int size = factor->rows * factor->cols;
    const int substeps = s->scene->physics.substeps;
    double before = 0.5;
    for (size_t i = 0; i < sizeof K / sizeof *K; ++i) {
        for (int c = 0; c < size; ++c) {
            factor->value[c] *= sqrt(K[i] / before);
        }
        before = K[i];
        for (size_t m = 1; m < METHODS; ++m) {
            trial_row row = {.count = 0};
            const int n = m == 2 ? 1 : substeps;
            snprintf(row.name, sizeof row.name, "K = %g W/K, %s, %d substeps", K[i], methods[m], n);
            set_time(s, s->scene->physics.dt, methods[m], n);
            PM_TRY(trial_run(&row, s->system, s->start, times(t, 200), t->recording));
            finish(t, &row);
        }
    }
    set_time(s, s->scene->physics.dt, "rk4", substeps);
    return PM_OK;
}

// The pendula from formulas, their conduction up to 6000 times as strong, in single steps.
static pm_status stress_known(stress *t, const char *K) {
    subject s = {.scene = NULL};
    trial_row row = {.count = 0};
    char constant[32];
    pm_status status;
    snprintf(constant, sizeof constant, "{K: %s}", K);
    snprintf(row.name, sizeof row.name, "known, K = %s W/K, discrete_gradient, 1 substep", K);
    PM_TRY_DONE(subject_open_edited(&s, t, "analytic_double_pendulum", "{K: 0.5}", constant));
    set_time(&s, s.scene->physics.dt, "discrete_gradient", 1);
    PM_TRY_DONE(trial_run(&row, s.system, s.start, times(t, 200), t->recording));
    finish(t, &row);
done:
    subject_close(&s);
    return status;
}

// Masses that fall towards the pivot and pass it at ever smaller distances.
static pm_status stress_passes(stress *t, const subject *s, const char *name) {
    static const double distance[] = {1, 0.1, 0.01, 1e-3, 1e-6, 0};
    const int substeps = s->scene->physics.substeps;
    for (size_t i = 0; i < 2 * sizeof distance / sizeof *distance; ++i) {
        trial_row row = {.count = 0};
        const char *method = methods[1 + i % 2];
        const double d = distance[i / 2];
        snprintf(row.name, sizeof row.name, "%s, passing at %g m, %s", name, d, method);
        set_time(s, s->scene->physics.dt, method, substeps);
        const double z[2 * LINK_SIZE] = {2, d, -1, 0, 0, d, -2, 0, 1, 0};
        PM_TRY(trial_run(&row, s->system, z, times(t, 100), t->recording));
        finish(t, &row);
    }
    set_time(s, s->scene->physics.dt, "rk4", substeps);
    return PM_OK;
}

// Weights as they would be read from files of single precision.
static pm_status stress_single_precision(stress *t, const subject *s, const char *name) {
    for (int i = 0; i < pm_system_components(s->system); ++i) {
        const pm_params *params = pm_system_params(s->system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            for (int c = 0; c < entry->rows * entry->cols; ++c) {
                entry->value[c] = (float)entry->value[c];
            }
        }
    }
    trial_row row = {.count = 0};
    snprintf(row.name, sizeof row.name, "%s, weights in single precision", name);
    PM_TRY(trial_run(&row, s->system, s->start, times(t, 200), t->recording));
    finish(t, &row);
    return PM_OK;
}

// The shipped structure, with random numbers of the size that training starts from added to its
// weights.
static pm_status stress_weights(stress *t, const char *name) {
    for (size_t m = 0; m < METHODS; ++m) {
        trial_row row = {.count = 0};
        snprintf(row.name, sizeof row.name, "%s, random weights, %s", name, methods[m]);
        for (int i = 0; i < times(t, 10) * (t->effort == 0 ? 1 : t->effort); ++i) {
            subject s = {.scene = NULL};
            pm_rng rng;
            pm_rng_init(&rng, SEED, (uint64_t)i);
            pm_status status = subject_open(&s, t, name);
            for (int k = 0; status == PM_OK && k < pm_system_components(s.system); ++k) {
                pm_params_randomise(pm_system_params(s.system, k), &rng);
            }
            if (status == PM_OK) {
                set_time(&s, 0.3, methods[m], 4);
                status = trial_run(&row, s.system, s.start, 20, t->recording);
            }
            subject_close(&s);
            PM_TRY(status);
        }
        finish(t, &row);
    }
    return PM_OK;
}

// --- chains ---

// Makes a hanging, bent chain of n links from the subsystems that were learned for chains.
static char *chain_text(const stress *t, int n) {
    char *text = NULL;
    size_t size = 0;
    FILE *out = open_memstream(&text, &size);
    if (out == NULL) {
        return NULL;
    }
    fprintf(out, "scene: chain\ntime: {dt: 0.2, steps: 1, integrator: rk4, substeps: 6}\n"
                 "subsystems:\n");
    for (int k = 1; k <= n; ++k) {
        fprintf(out,
                "  link%d: {weights: %s/weights/double_pendulum_wide/%s.h5, state: {q: {unit: m, "
                "size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n",
                k, t->configs, k == 1 ? "upper" : "lower");
    }
    fprintf(out, "ports:\n");
    for (int k = 1; k < n; ++k) {
        fprintf(out,
                "  joint%d: {law: bracket, between: [link%d, link%d], expose: {link%d: [q, p, s], "
                "link%d: [q, p, s]}, weights: %s/weights/double_pendulum_wide/joint.h5}\n",
                k, k, k + 1, k, k + 1, t->configs);
    }
    fclose(out);
    return text;
}

static pm_status stress_chain(stress *t, int n, const char *method) {
    subject s = {.scene = NULL};
    trial_row row = {.count = 0};
    char *text = chain_text(t, n);
    pm_status status = text == NULL ? pm_fail(PM_ENOMEM, "out of memory for a chain") : PM_OK;
    PM_TRY_DONE(status);
    PM_TRY_DONE(pm_scene_parse(&s.scene, text, "chain.yaml"));
    PM_TRY_DONE(pm_system_load(&s.system, s.scene, NULL));
    s.start = calloc((size_t)s.scene->physics.nz, sizeof *s.start);
    status = s.start == NULL ? pm_fail(PM_ENOMEM, "out of memory for a chain") : PM_OK;
    PM_TRY_DONE(status);
    for (int k = 0; k < n; ++k) {
        const double z[LINK_SIZE] = {k == 0 ? 2 : 0.8, 1.2, k % 2 == 0 ? 0.1 : -0.1, 0.2, 0};
        memcpy(s.start + k * LINK_SIZE, z, sizeof z);
    }
    snprintf(row.name, sizeof row.name, "chain of %d links, %s", n, method);
    set_time(&s, 0.2, method, 6);
    // A step of discrete_gradient takes longer in proportion to the square of the length, at least.
    const long steps = t->effort > 1 || n <= 10 ? times(t, 50) : times(t, 500 / n);
    PM_TRY_DONE(trial_run(&row, s.system, s.start, steps, t->recording));
    finish(t, &row);
done:
    free(text);
    subject_close(&s);
    return status;
}

static pm_status stress_chains(stress *t) {
    static const int links[] = {3, 10, 32, 64};
    for (size_t i = 0; i < sizeof links / sizeof *links; ++i) {
        PM_TRY(stress_chain(t, links[i], "rk4_balanced"));
        PM_TRY(stress_chain(t, links[i], "discrete_gradient"));
    }
    return PM_OK;
}

// --- all of it ---

static pm_status stress_pendulum(stress *t, const char *name, bool conduction) {
    subject s = {.scene = NULL};
    pm_status status;
    PM_TRY_DONE(subject_open(&s, t, name));
    PM_TRY_DONE(stress_steps(t, &s, name));
    PM_TRY_DONE(stress_states(t, &s, name));
    PM_TRY_DONE(stress_passes(t, &s, name));
    PM_TRY_DONE(stress_single_precision(t, &s, name));
    if (conduction) {
        PM_TRY_DONE(stress_conduction(t, &s));
    }
done:
    subject_close(&s);
    return status;
}

static pm_status stress_all(stress *t) {
    PM_TRY(stress_pendulum(t, "double_pendulum", true));
    PM_TRY(stress_pendulum(t, "double_pendulum_fast", false));
    static const char *const K[] = {"0.5", "5", "50", "300", "3000"};
    for (size_t i = 0; i < sizeof K / sizeof *K; ++i) {
        PM_TRY(stress_known(t, K[i]));
    }
    PM_TRY(stress_chains(t));
    return stress_weights(t, "double_pendulum");
}

int main(int argc, char **argv) {
    if (argc < 3 || argc > 4 || atoi(argv[2]) < 0) {
        fprintf(stderr, "usage: run_stress CONFIGS EFFORT [CSV]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    stress t = {.configs = argv[1], .effort = atoi(argv[2])};
    if (argc == 4 && (t.csv = fopen(argv[3], "w")) == NULL) {
        fprintf(stderr, "stress: %s: %s\n", argv[3], strerror(errno));
        return PM_EFILE;
    }
    scratch_open(&t.folder);
    char recording[128];
    snprintf(recording, sizeof recording, "%s", scratch_path(&t.folder, "run.h5"));
    t.recording = recording;
    trial_print_header(t.csv);
    const pm_status status = stress_all(&t);
    if (status != PM_OK) {
        fprintf(stderr, "stress: %s\n", pm_error());
    }
    scratch_close(&t.folder);
    if (t.csv != NULL) {
        fclose(t.csv);
    }
    printf("%d faults\n", t.faults);
    return status == PM_OK && t.faults > 0 ? (int)PM_ELAW : (int)status;
}
