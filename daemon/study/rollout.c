// Rollouts in child processes that take one task after another.
#include "study/rollout.h"

#include <float.h>
#include <math.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"
#include "base/rng.h"
#include "model/training_range.h"
#include "sim/tally.h"

#define LOOK 20000000   // ns between two looks at the workers
#define MOST_WORKERS 64 // processes
#define TURN 10         // steps of a jump
#define ROUNDINGS 16    // of the total energy in a step

pm_status pm_rollout_open(pm_setup *setup, const pm_setup *base, const char *text,
                          const pm_stepping *stepping) {
    pm_scene *scene = NULL;
    char *changed = strdup(text);
    *setup = (pm_setup){0};
    pm_status status = pm_allocated(changed, "a scene");
    PM_TRY_DONE(status);
    PM_TRY_DONE(pm_scene_text_put_time(&changed, stepping));
    PM_TRY_DONE(pm_scene_parse(&scene, changed, base->scene->path));
    PM_TRY_DONE(pm_setup_open(setup, scene, base->weights));
    setup->system->compiled = base->system->compiled;
    bool follows = false;
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        const pm_scene_boundary_input *input = &scene->physics.boundary_input[i];
        for (int k = 0; k < 3 * input->layout.nz; ++k) {
            follows = follows || input->value[k].column != NULL;
        }
    }
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        scene->physics.subsystem[i].initial = base->initial + scene->physics.subsystem[i].first;
    }
    scene->run.reference = follows ? scene->run.reference : NULL;
    PM_TRY_DONE(pm_setup_complete(setup, PM_TO_SERVE));
done:
    free(changed);
    return status;
}

// Returns the CPU time of a process, in s; 0: this one.
static double cpu_clock(pid_t process) {
    struct timespec now = {0};
    clockid_t clock;
    if (clock_getcpuclockid(process, &clock) == 0) {
        clock_gettime(clock, &now);
    }
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void pm_rollout_run(pm_setup *setup, const pm_start *start, const pm_rollout_spec *spec, double *z,
                    pm_rollout_result *result) {
    const pm_physics *physics = &setup->scene->physics;
    const size_t nz = (size_t)physics->nz, ninput = (size_t)setup->boundary_input.n;
    const bool driven = ninput > 0 && (spec->drive != PM_DRIVE_PLAIN || spec->factor != 1);
    double *held = calloc(2 * ninput + 1, sizeof *held), *value = held + ninput;
    double *first = calloc((size_t)physics->nsubsystem + nz, sizeof *first);
    double *state = first + physics->nsubsystem;
    pm_local_run run = {0};
    *result = (pm_rollout_result){0};
    if (setup->reference != NULL && start->trajectory >= 0) {
        pm_boundary_input_follow(&setup->boundary_input, setup->reference, start->trajectory);
    }
    const long last = setup->boundary_input.end < spec->stepping.steps ? setup->boundary_input.end
                                                                       : spec->stepping.steps;
    setup->boundary_input.held = NULL;
    pm_status status = held == NULL || first == NULL
                           ? pm_fail(PM_ENOMEM, "out of memory for a rollout")
                           : pm_local_run_open(&run, setup, PM_LOCAL_SAMPLES);
    if (status == PM_OK) {
        status = pm_local_run_start(&run, start->z);
    }
    if (status == PM_OK) {
        memcpy(first, run.sample.energy, (size_t)physics->nsubsystem * sizeof *first);
    }
    double size = 0; // J, of all energies
    const double started = cpu_clock(0);
    double warm = started; // after the first step, which finds nothing in the caches
    while (status == PM_OK) {
        const long step = run.sample.step;
        double moved = 0, least = 0, sum = 0;
        for (int i = 0; i < physics->nsubsystem; ++i) {
            moved += fabs(run.sample.energy[i] - first[i]);
            sum += fabs(run.sample.energy[i]);
        }
        size = fmax(size, sum);
        result->moved = fmax(result->moved, moved);
        if (z != NULL) {
            memcpy(z + (size_t)step * nz, run.sample.z, nz * sizeof *z);
        }
        const double used = spec->seconds > 0 ? cpu_clock(0) - started : 0;
        if (step >= last ||
            (used > spec->seconds && used * spec->stepping.steps > spec->most * (double)step)) {
            break;
        }
        if (spec->set != NULL && step == spec->stepping.steps / 2) {
            const pm_scene_subsystem *s = &physics->subsystem[spec->subsystem];
            pm_tally tally = {0};
            memcpy(state, run.sample.z, nz * sizeof *state);
            memcpy(state + s->first, spec->set + s->first, (size_t)s->layout.nz * sizeof *state);
            pm_monolithic_set_state(run.monolithic, state);
            pm_monolithic_set_step(run.monolithic, step);
            run.sample = *pm_monolithic_sample(run.monolithic);
            pm_tally_add_subsystems(&tally, setup->system, &run.sample);
            pm_ledger_note_outside(&run.ledger, &tally);
            memcpy(first, run.sample.energy, (size_t)physics->nsubsystem * sizeof *first);
        }
        if (driven) {
            const bool turns = (spec->drive == PM_DRIVE_JUMP && step / TURN % 2 == 1) ||
                               (spec->drive == PM_DRIVE_OSCILLATE && step % 2 == 1);
            const bool off = spec->drive == PM_DRIVE_VANISH && step >= spec->stepping.steps / 2;
            setup->boundary_input.held = NULL;
            pm_boundary_input_at(&setup->boundary_input, step, 0.5, value);
            for (size_t i = 0; i < ninput; ++i) {
                const double times = off ? 0 : turns ? -spec->factor : spec->factor;
                held[i] = times * value[i];
            }
            for (int k = 0; k < physics->nboundary_input; ++k) { // temperatures stay
                const pm_scene_boundary_input *input = &physics->boundary_input[k];
                for (int i = 0; i < 3 * input->layout.ngroup; ++i) {
                    const pm_group *group = &input->layout.group[i % input->layout.ngroup];
                    double *at = held + input->first + group->first +
                                 i / input->layout.ngroup * input->layout.nz;
                    for (int c = 0; c < group->size && strcmp(group->unit, "J/K") == 0; ++c) {
                        at[c] = NAN;
                    }
                }
            }
            setup->boundary_input.held = held;
        }
        status = pm_local_run_step(&run);
        for (int i = 0; i < physics->nsubsystem && status == PM_OK; ++i) {
            const pm_departure departure =
                pm_training_range_departure(pm_training_range_of(setup->system->part[i]),
                                            run.sample.z + physics->subsystem[i].first);
            least = fmax(least, departure.widths);
        }
        result->outside += least > 0;
        result->steps += status == PM_OK;
        warm = result->steps == 1 ? cpu_clock(0) : warm;
    }
    result->seconds = cpu_clock(0) - (result->steps > 1 ? warm : started);
    result->seconds *= result->steps > 1 ? (double)result->steps / (double)(result->steps - 1) : 1;
    result->status = status;
    snprintf(result->why, sizeof result->why, "%s", status == PM_OK ? "" : pm_error());
    result->drift = run.ledger.energy_drift;
    result->rounding = ROUNDINGS * DBL_EPSILON * size * (double)(result->steps + 1);
    result->fall = run.ledger.worst_entropy_fall;
    result->produced = run.ledger.entropy - run.ledger.first_entropy;
    result->violations = run.ledger.violations;
    setup->boundary_input.held = NULL;
    pm_local_run_close(&run);
    free(held);
    free(first);
}

int pm_rollout_starts(const pm_setup *setup, uint64_t seed, int trajectories, int count,
                      double widths, pm_arena *arena, pm_start *start) {
    const pm_physics *physics = &setup->scene->physics;
    const size_t nz = (size_t)physics->nz;
    const int own = setup->reference == NULL ? -1 : setup->scene->run.reference_trajectory;
    pm_rng rng;
    int n = 0;
    bool ranges = false;
    pm_rng_init(&rng, seed, 0);
    for (int i = 0; i < physics->nsubsystem; ++i) {
        ranges = ranges || pm_training_range_of(setup->system->part[i]).low != NULL;
    }
    const int others = own < 0 ? 0 : setup->reference->ntrajectory - 1;
    const int known = 1 + (trajectories < others ? trajectories : others);
    count = !ranges && known < count ? known : count;
    for (; n < count; ++n) {
        double *z = pm_arena_array(arena, nz, sizeof *z);
        if (z == NULL) {
            return -1;
        }
        memcpy(z, setup->initial, nz * sizeof *z);
        start[n] = (pm_start){.trajectory = own, .z = z, .widths = n < known ? 0 : widths};
        if (n > 0 && n < known) {
            start[n].trajectory =
                (own + 1 + (int)((seed + (uint64_t)n * 7) % (uint64_t)others)) % (others + 1);
            pm_columns_to_state(&setup->columns,
                                pm_dataset_state(setup->reference, start[n].trajectory, 0), z);
        }
    }
    // The random ones make a Latin hypercube (McKay, Beckman and Conover, Technometrics 21, 1979):
    // each group has one value in each of as many equal parts of its range as there are starts, so
    // that other seeds lead to almost the same medians.
    const int nrandom = count > known ? count - known : 0;
    int *part = pm_arena_array(arena, (size_t)nrandom, sizeof *part);
    if (part == NULL) {
        return -1;
    }
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_training_range range = pm_training_range_of(setup->system->part[i]);
        const pm_layout *layout = &physics->subsystem[i].layout;
        for (int g = 0; g < layout->ngroup && range.low != NULL; ++g) {
            // The group's value, or the length of a vector with a random direction.
            const pm_group *group = &layout->group[g];
            const double low = range.low[g], width = range.high[g] - low;
            for (int k = 0; k < nrandom; ++k) { // a random order
                const int at = (int)pm_rng_below(&rng, (uint64_t)k + 1);
                part[k] = part[at];
                part[at] = k;
            }
            for (int k = 0; k < nrandom; ++k) {
                double *z = (double *)start[known + k].z + physics->subsystem[i].first;
                const double share = (part[k] + pm_rng_uniform(&rng)) / nrandom;
                double size = low + width * share, length = 0;
                if (widths > 0) { // on either side of the range
                    const double beyond = width * widths * share;
                    size = pm_rng_uniform(&rng) < 0.5 ? low - beyond : low + width + beyond;
                }
                for (int c = group->first; c < group->first + group->size; ++c) {
                    z[c] = pm_rng_normal(&rng);
                    length += z[c] * z[c];
                }
                for (int c = group->first; c < group->first + group->size; ++c) {
                    z[c] = group->size == 1 ? size : z[c] * fabs(size) / sqrt(length);
                }
            }
        }
    }
    return count;
}

void *pm_rollout_shared(size_t count, size_t size) {
    void *memory =
        mmap(NULL, count * size + 1, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    return memory == MAP_FAILED ? NULL : memory;
}

int pm_rollout_nworker(void) {
    const long cores = sysconf(_SC_NPROCESSORS_ONLN);
    return (int)(cores < 1 ? 1 : cores > MOST_WORKERS ? MOST_WORKERS : cores);
}

pm_status pm_rollout_parallel(int first, int count, void (*work)(void *context, int i),
                              void *context, double *left, const char *label,
                              const volatile sig_atomic_t *stop) {
    const int nworker = pm_rollout_nworker();
    atomic_int *next = pm_rollout_shared(1, sizeof *next);
    pid_t worker[MOST_WORKERS];
    pm_progress progress;
    PM_TRY(pm_allocated(next, "a study"));
    fflush(NULL);
    const pid_t parent = getpid();
    for (int k = 0; k < nworker; ++k) {
        worker[k] = fork();
        if (worker[k] == 0) {
            prctl(PR_SET_PDEATHSIG, SIGKILL);
            for (int i = 0; getppid() == parent && (i = atomic_fetch_add(next, 1)) < count;) {
                work(context, first + i);
            }
            _exit(0);
        }
    }
    int alive = nworker;
    double used = 0; // by the busiest worker
    pm_progress_init(&progress, label, count);
    while (alive > 0) {
        const int done = atomic_load(next);
        for (int k = 0; k < nworker; ++k) {
            used = worker[k] > 0 ? fmax(used, cpu_clock(worker[k])) : used;
        }
        const bool ended = *stop != 0 || used > *left;
        alive = 0;
        for (int k = 0; k < nworker; ++k) {
            if (worker[k] > 0 && ended) {
                kill(worker[k], SIGKILL);
            }
            if (worker[k] > 0 && waitpid(worker[k], NULL, ended ? 0 : WNOHANG) != 0) {
                worker[k] = 0;
            }
            alive += worker[k] > 0;
        }
        pm_progress_update(&progress, done < count ? done : count, NULL);
        nanosleep(&(struct timespec){.tv_nsec = alive > 0 ? LOOK : 0}, NULL);
    }
    pm_progress_finish(&progress);
    *left -= used;
    munmap(next, sizeof *next + 1);
    return *stop != 0 ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK;
}
