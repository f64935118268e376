// Blocks of copies are loaded into the lanes of a program, stepped, and stored, so that a block
// stays in the cache for all steps of a call, and memory for a copy is its state.
#include "library/fleet.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/lanes.h"
#include "library/rates.h"
#include "sim/lanes.h"

#define MOST_THREADS 256
#define MOST_STEPS 9e15 // that a double counts

// A scene of more subsystems and ports has lanes of its own in the engine.
#define MOST_COMPONENTS 100

// Each thread has one of these, and steps blocks of copies with it.
struct pm_fleet_worker {
    pm_fleet *fleet;
    pm_monolithic *alone; // steps one copy
    pm_boundary_input input;
    pm_rates rates, potentials; // of all lanes; without programs: copies are stepped alone
    double *z, *k, *stage;      // [nz][lanes], [nstage][nz][lanes], [nz][lanes]
    double *row;                // [nprescribed] work space, as is `changed` [lanes]
    uint64_t *changed;
    pthread_t thread;
};

// --- opening ---

static pm_status open_worker(pm_fleet *fleet, pm_fleet_worker *w, int lanes) {
    const pm_setup *setup = fleet->setup;
    const pm_physics *physics = &setup->scene->physics;
    const size_t size = (size_t)physics->nz * (size_t)lanes;
    w->fleet = fleet;
    w->z = pm_arena_array(&fleet->arena, size, sizeof *w->z);
    w->k = pm_arena_array(&fleet->arena, size * PM_MAX_STAGES, sizeof *w->k);
    w->stage = pm_arena_array(&fleet->arena, size, sizeof *w->stage);
    w->row = pm_arena_array(&fleet->arena, (size_t)physics->nprescribed, sizeof *w->row);
    w->changed = pm_arena_array(&fleet->arena, (size_t)lanes, sizeof *w->changed);
    PM_TRY(pm_arena_status(&fleet->arena, "copies of a scene"));
    PM_TRY(pm_monolithic_open(&w->alone, setup->system));
    PM_TRY(pm_monolithic_keep_steps(w->alone));
    w->input = setup->boundary_input;
    pm_monolithic_set_boundary_input(w->alone, &w->input);
    if (fleet->lanes > 0) {
        PM_TRY(pm_rates_open(&w->rates, setup->system, PM_RATES, lanes, 0, NULL));
        PM_TRY(pm_rates_open(&w->potentials, setup->system, PM_POTENTIALS, lanes, 0, NULL));
    }
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
    const size_t n = (size_t)count, nz = (size_t)physics->nz;
    const bool by_state =
        !pm_physics_is_adaptive(physics) && !pm_integrator_keeps_energy(physics->integrator);
    if (by_state && physics->nsubsystem + physics->nport <= MOST_COMPONENTS) {
        fleet->lanes = pm_rates_lanes(count);
    }
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
    PM_TRY(pm_arena_status(&fleet->arena, "%lld copies of scene %s", (long long)count,
                           setup->scene->name));
    for (int i = 0; i < fleet->nworker; ++i) {
        PM_TRY(open_worker(fleet, &fleet->worker[i], fleet->lanes > 0 ? fleet->lanes : 1));
    }
    pm_serializer counter = pm_serializer_count("copy");
    pm_monolithic_record(fleet->worker[0].alone, &counter);
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
        pm_monolithic_close(fleet->worker[i].alone);
        pm_rates_close(&fleet->worker[i].rates);
        pm_rates_close(&fleet->worker[i].potentials);
    }
    if (fleet->gradient != NULL) {
        fleet->close_gradient(fleet->gradient);
    }
    pthread_mutex_destroy(&fleet->lock);
    pm_arena_free(&fleet->arena);
}

// --- steps ---

// Takes over the state and the inputs of a copy. It continues its run unless the caller has changed
// its state, from which a run then begins.
static void load(pm_fleet_worker *w, int64_t copy) {
    const pm_fleet *fleet = w->fleet;
    const pm_physics *physics = &fleet->setup->scene->physics;
    const double *z = fleet->z + copy * physics->nz,
                 *record = fleet->record + copy * fleet->nrecord;
    w->input.held = fleet->input + copy * physics->nprescribed;
    if (fleet->nrecord > 0 && memcmp(record, z, (size_t)physics->nz * sizeof *z) == 0) {
        pm_serializer restore = pm_serializer_restore("copy", record);
        pm_monolithic_record(w->alone, &restore);
    } else {
        pm_monolithic_set_state(w->alone, z);
    }
    pm_monolithic_set_step(w->alone, (long)fleet->step[copy]);
}

static void store(pm_fleet_worker *w, int64_t copy, int64_t steps) {
    pm_fleet *fleet = w->fleet;
    const pm_sample *sample = pm_monolithic_sample(w->alone);
    const size_t nz = (size_t)fleet->setup->scene->physics.nz;
    const size_t count = (size_t)fleet->setup->scene->physics.nsubsystem, at = (size_t)copy;
    memcpy(fleet->z + at * nz, sample->z, nz * sizeof *sample->z);
    memcpy(fleet->energy + at * count, sample->energy, count * sizeof *sample->energy);
    memcpy(fleet->entropy + at * count, sample->entropy, count * sizeof *sample->entropy);
    fleet->step[copy] += steps;
    if (fleet->nrecord > 0) {
        pm_serializer save = pm_serializer_save("copy", fleet->record + copy * fleet->nrecord);
        pm_monolithic_record(w->alone, &save);
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
        load(w, copy);
        while (steps < fleet->steps && (status = pm_monolithic_step(w->alone)) == PM_OK) {
            ++steps;
        }
        store(w, copy, steps);
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

// Returns true if nothing speaks against the states of a worker's copies after `step` steps, and
// against `more` to come. Where something may, the engine decides.
static bool are_good(pm_fleet_worker *w, const pm_copies *c, int64_t step, bool more) {
    const pm_fleet *fleet = w->fleet;
    const pm_scene *scene = fleet->setup->scene;
    const pm_physics *physics = &scene->physics;
    const int64_t size = (int64_t)physics->nsubsystem * c->lanes;
    bool good = !pm_lanes_any_not_finite((int64_t)physics->nz * c->lanes, w->z) &&
                !pm_lanes_any_not_finite(size, w->potentials.E) &&
                !pm_lanes_any_not_finite(size, w->potentials.S);
    for (int i = 0; i < physics->nsubsystem && scene->run.largest_departure < INFINITY; ++i) {
        pm_lanes_outside(pm_training_range_of(fleet->setup->system->part[i]), c->lanes,
                         w->z + (ptrdiff_t)physics->subsystem[i].first * c->lanes, w->changed);
        good = good && !pm_lanes_any(c->lanes, w->changed);
    }
    for (int l = 0; l < c->used && more && fleet->setup->boundary_input.end < LONG_MAX; ++l) {
        w->input.held = c->held + c->copy[l] * physics->nprescribed;
        good = good && pm_boundary_input_covers(&w->input, (long)(c->step[c->copy[l]] + step));
    }
    return good;
}

// Takes the steps of a block of copies in lanes. Returns false if a copy may not be able to take
// them all; all copies are then as they were.
static bool step_together(pm_fleet_worker *w, const pm_copies *c) {
    pm_fleet *fleet = w->fleet;
    const pm_physics *physics = &fleet->setup->scene->physics;
    pm_copies_gather(c, physics->nz, fleet->z, w->z);
    w->rates.shown = NULL;
    for (int64_t step = 0; step <= fleet->steps; ++step) {
        pm_rates_run(&w->potentials, c, 0, 0, w->z);
        if (!are_good(w, c, step, step < fleet->steps)) {
            return false;
        }
        for (int s = 0; s < physics->substeps && step < fleet->steps; ++s) {
            pm_rates_substep(&w->rates, c, step * physics->substeps + s, w->z, w->k, w->stage, 0);
        }
    }
    pm_copies_scatter(c, physics->nz, w->z, fleet->z);
    pm_copies_scatter(c, physics->nsubsystem, w->potentials.E, fleet->energy);
    pm_copies_scatter(c, physics->nsubsystem, w->potentials.S, fleet->entropy);
    for (int l = 0; l < c->used; ++l) {
        fleet->step[c->copy[l]] += fleet->steps;
    }
    return true;
}

static void step_block(void *context, int worker, int64_t block) {
    pm_fleet *fleet = context;
    pm_fleet_worker *w = &fleet->worker[worker];
    const int lanes = w->rates.program != NULL ? fleet->lanes : 1;
    const int64_t first = block * lanes, left = fleet->nchosen - first;
    const pm_copies copies = {.setup = fleet->setup,
                              .lanes = lanes,
                              .used = left < lanes ? (int)left : lanes,
                              .copy = fleet->chosen + first,
                              .step = fleet->step,
                              .held = fleet->input,
                              .row = w->row,
                              .changed = w->changed};
    if (w->rates.program == NULL || w->potentials.program == NULL || !step_together(w, &copies)) {
        for (int l = 0; l < copies.used; ++l) {
            step_alone(w, copies.copy[l]);
        }
    }
}

void pm_fleet_step(pm_fleet *fleet, int64_t steps) {
    const int lanes = fleet->worker[0].rates.program != NULL ? fleet->lanes : 1;
    fleet->nchosen = 0;
    for (int64_t i = 0; i < fleet->count; ++i) {
        if (fleet->ended[i] == 0) {
            fleet->chosen[fleet->nchosen++] = i;
        }
    }
    fleet->steps = steps;
    fleet->failed = fleet->count;
    fleet->why[0] = '\0';
    pm_fleet_share(fleet, (fleet->nchosen + lanes - 1) / lanes, step_block, fleet);
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
    for (int64_t i = 0; restore && i < n; ++i) {
        const double *count = rows + i * size + nz; // steps, ended
        if (!(count[0] >= 0 && count[0] <= MOST_STEPS && count[0] == floor(count[0]) &&
              fabs(count[1]) <= INT_MAX && count[1] == floor(count[1]))) {
            return pm_fail(PM_EUSAGE,
                           "scene %s: row %lld of saved copies has %g steps and the end %g: "
                           "expected whole numbers, as saved",
                           fleet->setup->scene->name, (long long)i, count[0], count[1]);
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
