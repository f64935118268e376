// Times rounds of subsystems that share a model. Neighbours that are not among them show ones.
#include "sim/round_cost.h"

#include <math.h>
#include <time.h>

#include "sim/local_subsystems.h"

#define MEMBERS 64      // of a model, at most
#define BATCHES 9       // of rounds, of which the fastest counts
#define SHORTEST 1e-4   // s that a batch takes at least, so that reading the clock costs nothing
#define MOST_ROUNDS 512 // in a batch
#define UNIT 8          // cost of the cheapest subsystem

// Returns the processor time of this process in s.
static double processor_time(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

// Computes a round. `ones` are as many numbers as any end exposes.
static void compute_round(pm_local_subsystems *local, const pm_scene *scene, const double *z,
                          const double *ones) {
    pm_local_subsystems_set_state(local, z);
    pm_local_subsystems_expose(local);
    for (int i = 0; i < pm_local_subsystems_nremote(local); ++i) {
        const pm_remote_end end = pm_local_subsystems_remote(local, i);
        const int ny = scene->port[end.port_id].layout[1 - (int)end.end].nz;
        const pm_port_values values = {
            .ny = ny, .y = ones, .e = ones, .eta = ones, .response = ones};
        pm_local_subsystems_hear(local, i, &values);
    }
    pm_local_subsystems_bulk(local);
    pm_local_subsystems_couple(local);
    pm_local_subsystems_advance(local);
}

// Returns the time of `rounds` rounds, in s.
static double time_of_batch(pm_local_subsystems *local, const pm_scene *scene, const double *z,
                            const double *ones, int rounds) {
    const double start = processor_time();
    for (int i = 0; i < rounds; ++i) {
        compute_round(local, scene, z, ones);
    }
    return processor_time() - start;
}

// Sets *seconds to the time of a round of each of the subsystems id [count].
static pm_status measure(const pm_system *system, int count, const int *id, const double *z,
                         const pm_boundary_input *boundary_input, const double *ones,
                         double *seconds) {
    pm_local_subsystems *local = NULL;
    int rounds = 1;
    PM_TRY(pm_local_subsystems_open(&local, system, count, id));
    pm_local_subsystems_set_boundary_input(local, boundary_input);
    double time = time_of_batch(local, system->scene, z, ones, rounds);
    while (time < SHORTEST && rounds < MOST_ROUNDS) {
        rounds *= 2;
        time = time_of_batch(local, system->scene, z, ones, rounds);
    }
    for (int i = 1; i < BATCHES; ++i) {
        time = fmin(time, time_of_batch(local, system->scene, z, ones, rounds));
    }
    *seconds = time / (rounds * (double)count);
    pm_local_subsystems_close(local);
    return PM_OK;
}

// Measures each model, into the place of its owner.
static pm_status measure_all(const pm_system *system, const double *z,
                             const pm_boundary_input *boundary_input, const double *ones,
                             double *seconds) {
    const pm_scene *scene = system->scene;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        if (system->part_owner[i] != i) {
            continue;
        }
        int id[MEMBERS], count = 0;
        for (int k = i; k < scene->nsubsystem && count < MEMBERS; ++k) {
            if (system->part_owner[k] == i) {
                id[count++] = k;
            }
        }
        PM_TRY(measure(system, count, id, z, boundary_input, ones, &seconds[i]));
    }
    return PM_OK;
}

// Returns a time as a cost.
static int cost_of(double seconds, double shortest) {
    const double steps = round(4 * log2(seconds / shortest));
    return (int)round(UNIT * exp2(steps / 4));
}

pm_status pm_round_cost_measure(const pm_system *system, const double *z,
                                const pm_boundary_input *boundary_input, int *cost) {
    const pm_scene *scene = system->scene;
    pm_arena arena = {0};
    double shortest = INFINITY;
    double *seconds = pm_arena_array(&arena, (size_t)scene->nsubsystem, sizeof *seconds);
    double *ones = pm_arena_array(&arena, (size_t)scene->nz + 1, sizeof *ones);
    pm_status status = pm_fail(PM_ENOMEM, "out of memory for costs");
    if (seconds != NULL && ones != NULL) {
        for (int i = 0; i < scene->nz; ++i) {
            ones[i] = 1;
        }
        status = measure_all(system, z, boundary_input, ones, seconds);
    }
    for (int i = 0; i < scene->nsubsystem && status == PM_OK; ++i) {
        const double own = seconds[system->part_owner[i]];
        shortest = own > 0 && own < shortest ? own : shortest;
    }
    for (int i = 0; i < scene->nsubsystem && status == PM_OK; ++i) {
        const double own = seconds[system->part_owner[i]];
        cost[i] = own > shortest ? cost_of(own, shortest) : UNIT;
    }
    pm_arena_free(&arena);
    return status;
}
