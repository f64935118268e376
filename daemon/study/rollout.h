// Rollouts of one scene from many starts and with other steps, in parallel, for `portmetd bench`
// and `stress`.
#ifndef PM_STUDY_ROLLOUT_H
#define PM_STUDY_ROLLOUT_H

#include <signal.h>

#include "library/local_run.h"
#include "study/scene_text.h"

// A state to start from.
typedef struct pm_start {
    int trajectory;  // of the reference, which boundary inputs follow; -1: none
    double widths;   // how far it may lie beyond the training range, in widths of the range
    const double *z; // [scene->nz]
} pm_start;

// How a rollout changes the boundary inputs. Temperatures, which are the inputs of entropies, stay
// as they are.
typedef enum pm_drive {
    PM_DRIVE_PLAIN,     // times `factor`
    PM_DRIVE_VANISH,    // zero from the middle of the run on
    PM_DRIVE_JUMP,      // times -factor and factor, by turns of ten steps
    PM_DRIVE_OSCILLATE, // times -factor and factor, by turns of one step
    PM_NDRIVE
} pm_drive;

typedef struct pm_rollout_spec {
    pm_stepping stepping; // `steps` are taken
    pm_drive drive;
    double factor; // of the inputs; 1: as the scene says
    // [scene->nz] In the middle of the run the subsystem number `subsystem` takes its state from
    // here, as if somebody had set it (SERVING.md). NULL: nobody does.
    const double *set;
    int subsystem;
    double seconds; // of CPU time after which the rollout stops; 0: none
    double most; // s of CPU time; one that is on the way to take all its steps in so many goes on
} pm_rollout_spec;

// How a rollout went.
typedef struct pm_rollout_result {
    pm_status status; // PM_OK: it has taken all its steps, or its time was over
    char why[200];    // the error
    long steps;       // taken
    double seconds;   // of CPU time, for all steps as for those after the first one
    double drift;     // J, largest drift of the total energy
    double moved;     // J, largest sum over the subsystems of how far their energies have moved
    double rounding;  // J, that rounding alone may add to the drift
    double fall;      // J/K, largest fall of the total entropy over one step
    double produced;  // J/K, of entropy in all
    long violations;  // steps that violate a law, or on which an integrator that promises to keep
                      // the energy has not
    long outside;     // steps that ended with a subsystem outside its training range
} pm_rollout_result;

// Loads the scene at `path` with other steps; fails if the scene, the weights or the integrator do
// not allow them. States come from starts, so that a reference whose times do not fit the steps is
// no obstacle unless boundary inputs follow it. `base` is the setup of the scene as it is, whose
// initial state the setup takes over. The caller frees the setup, on failure too.
pm_status pm_rollout_open(pm_setup *setup, const pm_setup *base, const char *text,
                          const pm_stepping *stepping);

// Takes the steps of `spec` from a start. z [steps + 1][nz] receives the states; NULL: they are not
// wanted. Never fails: `result` says how it went.
void pm_rollout_run(pm_setup *setup, const pm_start *start, const pm_rollout_spec *spec, double *z,
                    pm_rollout_result *result);

// Makes `count` starts in the arena: the scene's own first, then those of up to `trajectories`
// others of the reference, then random ones within the training ranges and up to `widths` widths
// beyond. The same seed gives the same starts. Without training ranges there are no random ones.
// Returns their number; -1: out of memory.
int pm_rollout_starts(const pm_setup *setup, uint64_t seed, int trajectories, int count,
                      double widths, pm_arena *arena, pm_start *start);

// Returns the number of child processes that pm_rollout_parallel starts, one for each core.
int pm_rollout_nworker(void);

// Calls work(context, i) for i = first, ..., first + count - 1, in as many child processes as there
// are cores. Results must lie in memory from pm_rollout_shared. The busiest process may use *left
// seconds of CPU time; numbers that have not begun by then are left out. Subtracts what it has used
// from *left. `label` names the progress bar.
// PM_EINTERRUPTED; PM_ENOMEM.
pm_status pm_rollout_parallel(int first, int count, void (*work)(void *context, int i),
                              void *context, double *left, const char *label,
                              const volatile sig_atomic_t *stop);

// Returns zeroed memory that child processes share, or NULL. It is freed at the end of the program.
void *pm_rollout_shared(size_t count, size_t size);

#endif
