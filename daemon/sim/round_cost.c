// Times rounds of subsystems that share a model. Neighbours that are not among them show ones.
#include "sim/round_cost.h"

#include <math.h>
#include <stdlib.h>
#include <time.h>

#include "sim/local_subsystems.h"

#define MEMBERS 64 // of a model, at most
#define ROUNDS 31  // of which the median counts
#define UNIT 8     // cost of the cheapest subsystem

// Returns the processor time of this process in s.
static double processor_time(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

// Returns the time of a round, in s. `ones` are as many numbers as any end exposes.
static double time_of_round(pm_local_subsystems *local, const pm_scene *scene, const double *z,
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
    const double start = processor_time();
    pm_local_subsystems_bulk(local);
    pm_local_subsystems_couple(local);
    pm_local_subsystems_advance(local);
    return processor_time() - start;
}

// Sets *seconds to the time of a round of each of the subsystems id [count].
static pm_status measure(const pm_system *system, int count, const int *id, const double *z,
                         const pm_boundary_input *boundary_input, const double *ones,
                         double *seconds) {
    pm_local_subsystems *local = NULL;
    double time[ROUNDS];
    PM_TRY(pm_local_subsystems_open(&local, system, count, id));
    pm_local_subsystems_set_boundary_input(local, boundary_input);
    for (int i = 0; i < ROUNDS; ++i) {
        time[i] = time_of_round(local, system->scene, z, ones);
    }
    qsort(time, ROUNDS, sizeof time[0], compare);
    *seconds = time[ROUNDS / 2] / count;
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
