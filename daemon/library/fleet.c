// Blocks of copies are loaded into the lanes of an engine, stepped, and stored, so that a block
// stays in the cache for all steps of a call, and memory for a copy is its state.
#include "library/fleet.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/lanes.h"
#include "library/fleet_gradient.h"

#define MOST_THREADS 256

// An engine for `copies` copies of the scene.
typedef struct engine {
    pm_monolithic *monolithic; // NULL: the fleet needs none
    pm_boundary_input input;
    int copies;
    double *z, *held; // [copies][nz], [copies][nprescribed]
} engine;

// Each thread has one of these, and steps blocks of copies with it.
struct pm_fleet_worker {
    pm_fleet *fleet;
    engine together, alone;
    pthread_t thread;
};

// --- opening ---

static pm_status open_engine(engine *e, pm_fleet *fleet, const pm_system *system, int copies) {
    const pm_physics *physics = &system->scene->physics; // of all copies
    e->copies = copies;
    e->z = pm_arena_array(&fleet->arena, (size_t)physics->nz, sizeof *e->z);
    e->held = pm_arena_array(&fleet->arena, (size_t)physics->nprescribed, sizeof *e->held);
    PM_TRY(pm_arena_status(&fleet->arena, "copies of a scene"));
    PM_TRY(pm_monolithic_open(&e->monolithic, system));
    e->input = fleet->setup->boundary_input;
    e->input.copies = copies;
    e->input.held = e->held;
    pm_monolithic_set_boundary_input(e->monolithic, &e->input);
    return PM_OK;
}

pm_status pm_fleet_open(pm_fleet *fleet, const pm_setup *setup, int64_t count, int threads) {
    *fleet = (pm_fleet){.setup = setup, .count = count};
    pthread_mutex_init(&fleet->lock, NULL);
    const pm_physics *physics = &setup->scene->physics;
    if (count < 1 || count > INT_MAX || threads < 0 || threads > MOST_THREADS) {
        return pm_fail(PM_EUSAGE,
                       "scene %s: %lld copies and %d threads: expected 1 to %d, and 0 to %d",
                       setup->scene->name, (long long)count, threads, INT_MAX, MOST_THREADS);
    }
    const pm_system *together = NULL;
    const size_t n = (size_t)count, nz = (size_t)physics->nz;
    const bool by_state =
        !pm_physics_is_adaptive(physics) && !pm_integrator_keeps_energy(physics->integrator);
    const int64_t nblock = (count + PM_MOST_LANES - 1) / PM_MOST_LANES;
    // Blocks of equal size, of whole vectors.
    fleet->lanes = count < PM_LANES
                       ? (int)count
                       : (int)((count + nblock * PM_LANES - 1) / (nblock * PM_LANES)) * PM_LANES;
    fleet->lanes = by_state ? fleet->lanes : 1;
    fleet->nworker = threads > 0 ? threads : (int)sysconf(_SC_NPROCESSORS_ONLN);
    fleet->nworker = fleet->nworker < 1 ? 1 : fleet->nworker;
    fleet->worker = pm_arena_array(&fleet->arena, (size_t)fleet->nworker, sizeof *fleet->worker);
    fleet->z = pm_arena_array(&fleet->arena, n * nz, sizeof *fleet->z);
    fleet->input =
        pm_arena_array(&fleet->arena, n * (size_t)physics->nprescribed, sizeof *fleet->input);
    fleet->energy =
        pm_arena_array(&fleet->arena, n * (size_t)physics->nsubsystem, sizeof *fleet->energy);
    fleet->entropy =
        pm_arena_array(&fleet->arena, n * (size_t)physics->nsubsystem, sizeof *fleet->entropy);
    fleet->step = pm_arena_array(&fleet->arena, n, sizeof *fleet->step);
    fleet->ended = pm_arena_array(&fleet->arena, n, sizeof *fleet->ended);
    fleet->chosen = pm_arena_array(&fleet->arena, n, sizeof *fleet->chosen);
    fleet->first = pm_arena_array(&fleet->arena, n + 1, sizeof *fleet->first);
    PM_TRY(pm_arena_status(&fleet->arena, "%lld copies of scene %s", (long long)count,
                           setup->scene->name));
    if (fleet->lanes > 1) {
        PM_TRY(pm_system_repeat(&together, setup->system, fleet->lanes, &fleet->arena));
    }
    for (int i = 0; i < fleet->nworker; ++i) {
        pm_fleet_worker *w = &fleet->worker[i];
        w->fleet = fleet;
        PM_TRY(open_engine(&w->alone, fleet, setup->system, 1));
        PM_TRY(pm_monolithic_keep_steps(w->alone.monolithic));
        PM_TRY(together == NULL ? PM_OK : open_engine(&w->together, fleet, together, fleet->lanes));
    }
    pm_serializer counter = pm_serializer_count("copy");
    pm_monolithic_record(fleet->worker[0].alone.monolithic, &counter);
    fleet->nrecord = by_state ? 0 : counter.count;
    fleet->record = pm_arena_array(&fleet->arena, n * (size_t)fleet->nrecord + 1, sizeof(double));
    PM_TRY(pm_arena_status(&fleet->arena, "%lld copies", (long long)count));
    fleet->row = physics->nz + 2 + fleet->nrecord; // the steps, and whether it has ended
    for (size_t i = 0; i < n; ++i) {
        memcpy(fleet->z + i * nz, setup->initial, nz * sizeof *fleet->z);
        for (int k = 0; k < fleet->nrecord; ++k) {
            fleet->record[i * (size_t)fleet->nrecord + (size_t)k] = NAN;
        }
    }
    for (size_t i = 0; i < n * (size_t)physics->nprescribed; ++i) {
        fleet->input[i] = NAN;
    }
    pm_fleet_step(fleet, 0); // computes what belongs to the initial states
    return PM_OK;
}

void pm_fleet_close(pm_fleet *fleet) {
    for (int i = 0; i < fleet->nworker && fleet->worker != NULL; ++i) {
        pm_monolithic_close(fleet->worker[i].together.monolithic);
        pm_monolithic_close(fleet->worker[i].alone.monolithic);
    }
    pm_fleet_gradient_close(fleet->gradient);
    pthread_mutex_destroy(&fleet->lock);
    pm_arena_free(&fleet->arena);
}

// --- steps ---

// Takes over state and inputs of n copies; lanes behind the last repeat it. A copy continues its
// run unless the caller has changed its state, from which a run then begins.
static void load(engine *e, const pm_fleet *fleet, const int64_t *copy, int64_t n) {
    const pm_physics *physics = &fleet->setup->scene->physics;
    const size_t nz = (size_t)physics->nz, ninput = (size_t)physics->nprescribed;
    for (int c = 0; c < e->copies; ++c) {
        const size_t from = (size_t)copy[c < n ? c : n - 1];
        memcpy(e->z + (size_t)c * nz, fleet->z + from * nz, nz * sizeof *e->z);
        if (ninput > 0) {
            memcpy(e->held + (size_t)c * ninput, fleet->input + from * ninput,
                   ninput * sizeof *e->held);
        }
    }
    const double *record = fleet->record + copy[0] * fleet->nrecord;
    if (fleet->nrecord > 0 && memcmp(record, e->z, nz * sizeof *record) == 0) {
        pm_serializer restore = pm_serializer_restore("copy", record);
        pm_monolithic_record(e->monolithic, &restore);
    } else {
        pm_monolithic_set_state(e->monolithic, e->z);
    }
    pm_monolithic_set_step(e->monolithic, (long)fleet->step[copy[0]]);
}

static void store(engine *e, pm_fleet *fleet, const int64_t *copy, int64_t n, int64_t steps) {
    const pm_sample *sample = pm_monolithic_sample(e->monolithic);
    const int nz = fleet->setup->scene->physics.nz, count = fleet->setup->scene->physics.nsubsystem;
    for (int c = 0; c < n; ++c) {
        memcpy(fleet->z + copy[c] * nz, sample->z + (ptrdiff_t)c * nz, (size_t)nz * sizeof *e->z);
        for (int i = 0; i < count; ++i) {
            fleet->energy[copy[c] * count + i] = sample->energy[(ptrdiff_t)i * e->copies + c];
            fleet->entropy[copy[c] * count + i] = sample->entropy[(ptrdiff_t)i * e->copies + c];
        }
        fleet->step[copy[c]] += steps;
    }
    if (fleet->nrecord > 0) {
        pm_serializer save = pm_serializer_save("copy", fleet->record + copy[0] * fleet->nrecord);
        pm_monolithic_record(e->monolithic, &save);
    }
}

// Takes the steps of one copy, as many as succeed.
static void step_alone(pm_fleet_worker *w, int64_t copy) {
    pm_fleet *fleet = w->fleet;
    const int nz = fleet->setup->scene->physics.nz;
    pm_status status = PM_OK;
    int64_t steps = 0;
    for (int i = 0; i < nz && status == PM_OK; ++i) {
        if (!isfinite(fleet->z[copy * nz + i])) {
            status = pm_fail(PM_ENUMERIC, "its state number %d is %g", i, fleet->z[copy * nz + i]);
        }
    }
    if (status == PM_OK) {
        load(&w->alone, fleet, &copy, 1);
        while (steps < fleet->steps &&
               (status = pm_monolithic_step(w->alone.monolithic)) == PM_OK) {
            ++steps;
        }
        store(&w->alone, fleet, &copy, 1, steps);
    }
    if (status != PM_OK) {
        fleet->ended[copy] = (int)status;
        pthread_mutex_lock(&fleet->lock);
        if (copy < fleet->failed) {
            fleet->failed = copy;
            snprintf(fleet->why, sizeof fleet->why, "copy %lld: step %lld: %s", (long long)copy,
                     (long long)fleet->step[copy] + 1, pm_error());
        }
        pthread_mutex_unlock(&fleet->lock);
    }
}

// Takes the steps of a block of copies.
static void step_block(void *context, int worker, int64_t block) {
    pm_fleet *fleet = context;
    pm_fleet_worker *w = &fleet->worker[worker];
    const int64_t *copy = fleet->chosen + fleet->first[block];
    const int64_t n = fleet->first[block + 1] - fleet->first[block];
    pm_status status = n > 1 ? PM_OK : PM_ENUMERIC;
    if (n > 1) {
        load(&w->together, fleet, copy, n);
    }
    for (int64_t k = 0; k < fleet->steps && status == PM_OK; ++k) {
        status = pm_monolithic_step(w->together.monolithic);
    }
    if (status == PM_OK) {
        store(&w->together, fleet, copy, n, fleet->steps);
    }
    for (int64_t k = 0; k < n && status != PM_OK; ++k) { // some of them cannot take all steps
        step_alone(w, copy[k]);
    }
}

void pm_fleet_step(pm_fleet *fleet, int64_t steps) {
    const bool times = fleet->setup->boundary_input.end < LONG_MAX; // inputs follow the time
    int64_t n = 0;
    fleet->nblock = 0;
    for (int64_t i = 0; i < fleet->count; ++i) {
        if (fleet->ended[i] == 0) {
            const int64_t begin = fleet->nblock > 0 ? fleet->first[fleet->nblock - 1] : 0;
            if (n == 0 || n - begin == fleet->lanes ||
                (times && fleet->step[i] != fleet->step[fleet->chosen[begin]])) {
                fleet->first[fleet->nblock++] = n;
            }
            fleet->chosen[n++] = i;
        }
    }
    fleet->first[fleet->nblock] = n;
    fleet->steps = steps;
    fleet->failed = fleet->count;
    fleet->why[0] = '\0';
    pm_fleet_share(fleet, fleet->nblock, step_block, fleet);
}

// --- threads ---

static void *work(void *context) {
    const pm_fleet_worker *w = context;
    pm_fleet *fleet = w->fleet;
    for (int64_t i; (i = atomic_fetch_add(&fleet->next, 1)) < fleet->nshared;) {
        fleet->work(fleet->context, (int)(w - fleet->worker), i);
    }
    return NULL;
}

void pm_fleet_share(pm_fleet *fleet, int64_t nblock,
                    void (*work_on)(void *context, int worker, int64_t block), void *context) {
    fleet->work = work_on;
    fleet->context = context;
    fleet->nshared = nblock;
    atomic_store(&fleet->next, 0);
    int started = 1;
    while (started < fleet->nworker && started < nblock &&
           pthread_create(&fleet->worker[started].thread, NULL, work, &fleet->worker[started]) ==
               0) {
        ++started;
    }
    work(&fleet->worker[0]);
    while (--started > 0) {
        pthread_join(fleet->worker[started].thread, NULL);
    }
}

// --- saved copies ---

pm_status pm_fleet_copy(pm_fleet *fleet, bool restore, int64_t n, const int64_t *copy,
                        double *rows) {
    const int nz = fleet->setup->scene->physics.nz, size = fleet->row;
    for (int64_t i = 0; i < n; ++i) {
        const int64_t at = copy == NULL ? i : copy[i];
        if (at < 0 || at >= fleet->count) {
            return pm_fail(PM_EUSAGE, "scene %s: copy %lld: expected 0 to %lld",
                           fleet->setup->scene->name, (long long)at, (long long)fleet->count - 1);
        }
    }
    for (int64_t i = 0; i < n; ++i) {
        const int64_t at = copy == NULL ? i : copy[i];
        long step = (long)fleet->step[at];
        pm_serializer s = restore ? pm_serializer_restore("copy", rows + i * size)
                                  : pm_serializer_save("copy", rows + i * size);
        pm_serializer_put(&s, "z", fleet->z + at * nz, nz);
        pm_serializer_put_long(&s, "step", &step);
        pm_serializer_put_int(&s, "ended", &fleet->ended[at]);
        pm_serializer_put(&s, "record", fleet->record + at * fleet->nrecord, fleet->nrecord);
        fleet->step[at] = step;
    }
    return PM_OK;
}
