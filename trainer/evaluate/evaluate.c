// Rolls out trajectories in several threads. Each thread has its own copy of the simulation
// (sim/monolithic.h) and takes the next trajectory, so that results do not depend on their number.
#include "evaluate/evaluate.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/progress.h"
#include "evaluate/inner_variables.h"
#include "sim/monolithic.h"

// Relative. The scene has dt as decimal text, the dataset as a double.
#define DT_TOLERANCE 1e-9
// The step of the central difference dE/ds, relative to the larger of s and SMALL_ENTROPY. Rounding
// and curvature then both cause relative errors of about 1e-8.
#define TEMPERATURE_STEP 1e-5
#define SMALL_ENTROPY 1e-3 // J/K
#define TEMPERATURES 10    // the approximate number of states of a trajectory with temperatures
#define MOST_ENTROPIES 16  // the most components of a group with temperatures

// --- one rollout ---

static void book(pm_rollout *rollout, pm_monolithic *assembly) {
    pm_sample sample = *pm_monolithic_sample(assembly);
    memcpy(rollout->outside, sample.outside,
           (size_t)rollout->ledger.system->scene->nsubsystem * sizeof *rollout->outside);
    if (pm_ledger_book(&rollout->ledger, &sample) != PM_OK && rollout->violation[0] == 0) {
        snprintf(rollout->violation, sizeof rollout->violation, "trajectory %d: %.200s",
                 rollout->trajectory, pm_error());
    }
}

// Stores energy and entropy of the subsystems in one state, predicted (which = 0) or true (1).
static void keep_parts(const pm_evaluation *e, pm_rollout *rollout, int which, int j,
                       const pm_sample *sample) {
    const size_t n = (size_t)e->system->scene->nsubsystem;
    const size_t at = ((size_t)which * (size_t)e->truth->ntime + (size_t)j) * n;
    memcpy(rollout->part_energy + at, sample->energy, n * sizeof(double));
    memcpy(rollout->part_entropy + at, sample->entropy, n * sizeof(double));
}

static double energy_of(pm_monolithic *assembly, const double *z, int subsystem) {
    pm_monolithic_set_state(assembly, z);
    return pm_monolithic_sample(assembly)->energy[subsystem];
}

// Computes the temperatures dE/ds at the state z by central differences. z is unchanged afterwards.
static void take_temperatures(const pm_evaluation *e, pm_rollout *rollout, pm_monolithic *assembly,
                              double *z) {
    for (int i = 0; i < e->system->scene->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &e->system->scene->subsystem[i];
        for (int c = 0; c < s->layout.nz; ++c) {
            const pm_group *group = s->layout.group;
            while (c >= group->first + group->size) {
                ++group;
            }
            if (strcmp(group->unit, "J/K") != 0 || group->size > MOST_ENTROPIES) {
                continue;
            }
            double *at = &z[s->first + c];
            const double before = *at, step = TEMPERATURE_STEP * fmax(fabs(before), SMALL_ENTROPY);
            *at = before + step;
            double T = energy_of(assembly, z, i);
            *at = before - step;
            T = (T - energy_of(assembly, z, i)) / (2 * step);
            *at = before;
            const bool first = rollout->coldest == 0 && rollout->warmest == 0;
            rollout->coldest = first ? T : fmin(rollout->coldest, T);
            rollout->warmest = first ? T : fmax(rollout->warmest, T);
        }
    }
}

// Evaluates energies, entropies and temperatures in the true states. `z` [nz] is work space.
static void look_at_truth(const pm_evaluation *e, pm_rollout *rollout, pm_monolithic *assembly,
                          pm_inner_variables *inner, double *z) {
    const int ntime = e->truth->ntime, stride = ntime / TEMPERATURES + 1;
    if (pm_system_without_energy(e->system) >= 0) {
        return;
    }
    for (int j = 0; j < ntime; ++j) {
        pm_columns_to_state(&e->columns, pm_dataset_state(e->truth, rollout->trajectory, j), z);
        if (j == 0) {
            pm_inner_variables_start(inner, z);
        } else {
            pm_inner_variables_follow(inner, e->truth->dt, z);
        }
        pm_monolithic_set_state(assembly, z);
        keep_parts(e, rollout, 1, j, pm_monolithic_sample(assembly));
        if (j % stride == 0) {
            take_temperatures(e, rollout, assembly, z);
        }
    }
}

// Stores the predicted state. Columns that the scene does not predict, such as boundary inputs,
// keep their data.
static void keep_state(const pm_evaluation *e, pm_rollout *rollout, int index,
                       const pm_sample *sample) {
    const int j = rollout->reached++;
    double *row = pm_dataset_state(e->predicted, index, j);
    memcpy(row, pm_dataset_state(e->truth, rollout->trajectory, j),
           (size_t)e->truth->ncolumn * sizeof *row);
    pm_columns_to_row(&e->columns, sample->z, row);
    rollout->energy[j] = rollout->ledger.energy;
    rollout->entropy[j] = rollout->ledger.entropy;
    keep_parts(e, rollout, 0, j, sample);
}

// Steps to the next state of the dataset; false once the state is not finite.
static bool advance(pm_rollout *rollout, pm_monolithic *assembly, int stride) {
    for (int i = 0; i < stride; ++i) {
        const double before = pm_clock();
        if (pm_monolithic_step(assembly) != PM_OK) {
            return false;
        }
        rollout->seconds_per_step += pm_clock() - before;
        book(rollout, assembly);
    }
    return true;
}

// Computes the errors of a rollout. They are infinite from its first state that is not finite.
static void score(const pm_evaluation *e, pm_rollout *rollout, const double *predicted) {
    const int ngroup = e->columns.ngroup, ntime = e->truth->ntime;
    pm_score(&e->columns, ntime, e->truth->ncolumn, predicted,
             pm_dataset_state(e->truth, rollout->trajectory, 0), rollout->error, rollout->snapshot);
    for (int i = 0; i < ngroup; ++i) {
        if (rollout->reached < ntime || isnan(rollout->error[i])) {
            rollout->error[i] = INFINITY;
        }
    }
    for (int i = 0; i < ntime * ngroup; ++i) {
        if (i >= rollout->reached * ngroup || isnan(rollout->snapshot[i])) {
            rollout->snapshot[i] = INFINITY;
        }
    }
}

// Rolls out one trajectory. `z` [nz] is work space.
static void roll(const pm_evaluation *e, pm_monolithic *assembly, pm_boundary_input *boundary_input,
                 pm_inner_variables *inner, int index, double *z) {
    pm_rollout *rollout = &e->rollout[index];
    pm_boundary_input_follow(boundary_input, e->truth, rollout->trajectory);
    pm_monolithic_set_boundary_input(assembly, boundary_input);
    const size_t row_size = (size_t)e->truth->ncolumn * sizeof *z;
    look_at_truth(e, rollout, assembly, inner, z);
    pm_columns_to_state(&e->columns, pm_dataset_state(e->truth, rollout->trajectory, 0), z);
    pm_monolithic_set_state(assembly, z);
    pm_ledger_init(&rollout->ledger, e->system);
    book(rollout, assembly);
    keep_state(e, rollout, index, pm_monolithic_sample(assembly));
    while (rollout->reached < e->truth->ntime && advance(rollout, assembly, e->stride)) {
        keep_state(e, rollout, index, pm_monolithic_sample(assembly));
    }
    for (int i = rollout->reached; i < e->truth->ntime; ++i) {
        memcpy(pm_dataset_state(e->predicted, index, i),
               pm_dataset_state(e->predicted, index, i - 1), row_size);
    }
    const long steps = rollout->ledger.steps;
    rollout->seconds_per_step /= steps > 0 ? (double)steps : 1;
    score(e, rollout, pm_dataset_state(e->predicted, index, 0));
}

// --- all rollouts ---

typedef struct pool {
    pm_evaluation *evaluation;
    const pm_evaluate_how *how;
    pthread_mutex_t lock; // protects the members below
    int next, done;
    pm_status status; // the first failure, with its description
    char error[512];
} pool;

// Returns the next rollout, or -1.
static int take(pool *p) {
    pthread_mutex_lock(&p->lock);
    if (p->how->stop != NULL && *p->how->stop && p->status == PM_OK) {
        p->status = PM_EINTERRUPTED;
        snprintf(p->error, sizeof p->error, "evaluate: interrupted");
    }
    const bool more = p->status == PM_OK && p->next < p->evaluation->count;
    const int index = more ? p->next++ : -1;
    pthread_mutex_unlock(&p->lock);
    return index;
}

static void report_done(pool *p) {
    pthread_mutex_lock(&p->lock);
    ++p->done;
    if (p->how->progress != NULL) {
        p->how->progress(p->how->context, p->done);
    }
    pthread_mutex_unlock(&p->lock);
}

static void report_failure(pool *p, pm_status status) {
    pthread_mutex_lock(&p->lock);
    if (p->status == PM_OK) {
        p->status = status;
        snprintf(p->error, sizeof p->error, "%s", pm_error());
    }
    pthread_mutex_unlock(&p->lock);
}

static void *work(void *context) {
    pool *p = context;
    const pm_system *system = p->evaluation->system;
    const pm_evaluation *e = p->evaluation;
    pm_arena arena = {0};
    pm_boundary_input boundary_input;
    pm_inner_variables inner = {0};
    pm_monolithic *assembly = NULL;
    double *z = pm_arena_array(&arena, (size_t)system->scene->nz, sizeof *z);
    pm_status status = z == NULL ? pm_fail(PM_ENOMEM, "evaluate: out of memory") : PM_OK;
    PM_TRY_DONE(status);
    PM_TRY_DONE(
        pm_boundary_input_bind(&boundary_input, system->scene, e->truth, e->stride, &arena));
    PM_TRY_DONE(pm_inner_variables_open(&inner, &arena, system, &e->columns));
    PM_TRY_DONE(pm_monolithic_open(&assembly, system));
    for (int index = take(p); index >= 0; index = take(p)) {
        roll(e, assembly, &boundary_input, &inner, index, z);
        report_done(p);
    }
done:
    if (status != PM_OK) {
        report_failure(p, status);
    }
    pm_monolithic_close(assembly);
    pm_inner_variables_close(&inner);
    pm_arena_free(&arena);
    return NULL;
}

// The calling thread works as well, so that the evaluation succeeds if no thread can be started.
static pm_status run_pool(pm_evaluation *e, const pm_evaluate_how *how) {
    enum { MOST = 64 };
    pthread_t thread[MOST];
    pool p = {.evaluation = e, .how = how};
    pthread_mutex_init(&p.lock, NULL);
    int started = 0;
    while (started < how->threads - 1 && started < MOST && started < e->count - 1 &&
           pthread_create(&thread[started], NULL, work, &p) == 0) {
        ++started;
    }
    work(&p);
    for (int i = 0; i < started; ++i) {
        pthread_join(thread[i], NULL);
    }
    pthread_mutex_destroy(&p.lock);
    return p.status == PM_OK ? PM_OK : pm_fail(p.status, "%s", p.error);
}

// --- before and after ---

static pm_status find_stride(pm_evaluation *e) {
    const pm_scene *scene = e->system->scene;
    const double ratio = e->truth->dt / scene->dt;
    const double whole = round(ratio);
    if (!(whole >= 1 && whole < 1e6 && fabs(ratio - whole) <= DT_TOLERANCE * whole)) {
        return pm_fail(PM_EDATA,
                       "%s: dt is %.12g s, and the dataset's %.12g s is no multiple of it",
                       scene->path, scene->dt, e->truth->dt);
    }
    e->stride = (int)whole;
    return PM_OK;
}

static pm_status allocate(pm_evaluation *e, const int *which) {
    const size_t ngroup = (size_t)e->columns.ngroup, ntime = (size_t)e->truth->ntime;
    const size_t npart = (size_t)e->system->scene->nsubsystem;
    e->rollout = pm_arena_array(&e->arena, (size_t)e->count, sizeof *e->rollout);
    e->trajectory = pm_arena_array(&e->arena, ngroup, sizeof *e->trajectory);
    e->snapshot = pm_arena_array(&e->arena, ngroup, sizeof *e->snapshot);
    bool made = e->rollout != NULL && e->trajectory != NULL && e->snapshot != NULL;
    for (int i = 0; made && i < e->count; ++i) {
        pm_rollout *rollout = &e->rollout[i];
        rollout->trajectory = which[i];
        rollout->error = pm_arena_array(&e->arena, ngroup, sizeof(double));
        rollout->snapshot = pm_arena_array(&e->arena, ntime * ngroup, sizeof(double));
        rollout->energy = pm_arena_array(&e->arena, ntime, sizeof(double));
        rollout->outside = pm_arena_array(&e->arena, npart, sizeof *rollout->outside);
        rollout->entropy = pm_arena_array(&e->arena, ntime, sizeof(double));
        rollout->part_energy = pm_arena_array(&e->arena, 2 * ntime * npart, sizeof(double));
        rollout->part_entropy = pm_arena_array(&e->arena, 2 * ntime * npart, sizeof(double));
        made = rollout->error != NULL && rollout->snapshot != NULL && rollout->energy != NULL &&
               rollout->entropy != NULL && rollout->outside != NULL &&
               rollout->part_energy != NULL && rollout->part_entropy != NULL;
    }
    if (!made) {
        return pm_fail(PM_ENOMEM, "evaluate: out of memory");
    }
    PM_TRY(pm_dataset_new(&e->predicted, e->count, e->truth->ntime, e->truth->ncolumn, e->truth->dt,
                          e->truth->column));
    memcpy(e->predicted->t, e->truth->t, ntime * sizeof(double));
    return PM_OK;
}

static pm_status fill_boxes(pm_evaluation *e) {
    const int ngroup = e->columns.ngroup, ntime = e->truth->ntime;
    double *value = calloc((size_t)e->count * (size_t)ntime, sizeof *value);
    if (value == NULL) {
        return pm_fail(PM_ENOMEM, "evaluate: out of memory");
    }
    for (int g = 0; g < ngroup; ++g) {
        for (int i = 0; i < e->count; ++i) {
            value[i] = e->rollout[i].error[g];
        }
        e->trajectory[g] = pm_box_of(e->count, value);
        int n = 0;
        for (int i = 0; i < e->count; ++i) {
            for (int j = 1; j < ntime; ++j) {
                value[n++] = e->rollout[i].snapshot[j * ngroup + g];
            }
        }
        e->snapshot[g] = pm_box_of(n, value);
    }
    free(value);
    return PM_OK;
}

pm_status pm_evaluate_list(pm_evaluation **evaluation, const pm_system *system,
                           const pm_dataset *truth, int count, const int *which,
                           const pm_evaluate_how *how) {
    if (truth->ntime < 2) {
        return pm_fail(PM_EDATA, "evaluate: a trajectory of %d states leaves nothing to predict",
                       truth->ntime);
    }
    pm_evaluation *e = calloc(1, sizeof *e);
    if (e == NULL) {
        return pm_fail(PM_ENOMEM, "evaluate: out of memory");
    }
    *e = (pm_evaluation){.system = system, .truth = truth, .count = count};
    pm_status status;
    PM_TRY_DONE(find_stride(e));
    PM_TRY_DONE(pm_columns_bind(&e->columns, system->scene, truth, &e->arena));
    PM_TRY_DONE(allocate(e, which));
    PM_TRY_DONE(run_pool(e, how));
    PM_TRY_DONE(fill_boxes(e));
    *evaluation = e;
    e = NULL;
done:
    pm_evaluation_free(e);
    return status;
}

pm_status pm_evaluate(pm_evaluation **evaluation, const pm_system *system, const pm_dataset *truth,
                      int first, int end, const pm_evaluate_how *how) {
    int *which = malloc((size_t)(end - first) * sizeof *which);
    if (which == NULL) {
        return pm_fail(PM_ENOMEM, "evaluate: out of memory");
    }
    for (int i = first; i < end; ++i) {
        which[i - first] = i;
    }
    const pm_status status = pm_evaluate_list(evaluation, system, truth, end - first, which, how);
    free(which);
    return status;
}

void pm_evaluation_free(pm_evaluation *evaluation) {
    if (evaluation != NULL) {
        pm_dataset_free(evaluation->predicted);
        pm_arena_free(&evaluation->arena);
        free(evaluation);
    }
}

const pm_rollout *pm_evaluation_violation(const pm_evaluation *evaluation) {
    for (int i = 0; i < evaluation->count; ++i) {
        if (evaluation->rollout[i].violation[0] != 0) {
            return &evaluation->rollout[i];
        }
    }
    return NULL;
}

int pm_evaluation_failures(const pm_evaluation *evaluation) {
    int count = 0;
    for (int i = 0; i < evaluation->count; ++i) {
        count += evaluation->rollout[i].reached < evaluation->truth->ntime;
    }
    return count;
}
