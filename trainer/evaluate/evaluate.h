// Rollouts of a system from the first state of each trajectory of a dataset, scored against the
// rest of it. The numbers do not depend on the number of threads.
#ifndef PM_TRAINER_EVALUATE_EVALUATE_H
#define PM_TRAINER_EVALUATE_EVALUATE_H

#include <signal.h>
#include <stdbool.h>

#include "scene/columns.h"
#include "scene/system.h"
#include "sim/ledger.h"
#include "sim/score.h"
#include "store/dataset.h"

// What one rollout came to. Errors are relative L2 errors per group of columns (score.h).
typedef struct pm_rollout {
    int trajectory;   // of the dataset
    int reached;      // states that are finite; the dataset's ntime if it went all the way
    double *error;    // [ngroup] over the trajectory; infinite if it did not go all the way
    double *snapshot; // [ntime][ngroup] per state; infinite from `reached` on
    double *energy;   // [ntime] J, total per state, 0 from `reached` on; zero if not defined
    double *entropy;  // [ntime] J/K, likewise
    // Energy J and entropy J/K of each part, as the model has them, of the states predicted and of
    // the true ones: [2][ntime][nsubsystem] each. Zero where not reached or not defined.
    double *part_energy, *part_entropy;
    // K, dE/ds of each component of an entropy (unit J/K) at some of the true states: the lowest
    // and the highest; both 0 if there is none.
    double coldest, warmest;
    pm_ledger ledger;
    char violation[256];     // what the ledger says of a hard component that violates a law, or ""
    double seconds_per_step; // of the scene
} pm_rollout;

typedef struct pm_evaluation {
    pm_arena arena;
    const pm_system *system; // borrowed
    const pm_dataset *truth; // borrowed
    pm_columns columns;
    int count;           // rollouts
    int stride;          // scene steps from one state of the dataset to the next
    pm_rollout *rollout; // [count]
    // The rollouts, [count][ntime][ncolumn] in the dataset's coordinates. Columns that the scene
    // does not predict are those of the data; where a rollout did not go all the way, its last
    // finite state is repeated.
    pm_dataset *predicted;
    pm_box *trajectory; // [ngroup] of the rollouts' errors
    pm_box *snapshot;   // [ngroup] of their states' errors, the first state of each left out
} pm_evaluation;

// How to run an evaluation.
typedef struct pm_evaluate_how {
    int threads;                                  // at least 1
    const volatile sig_atomic_t *stop;            // NULL: never
    void (*progress)(void *context, int rollout); // NULL, or called by one thread at a time
    void *context;
} pm_evaluate_how;

// Evaluates trajectories first .. end-1. PM_ECONFIG (columns), PM_EDATA (columns, a time step that
// is no multiple of the scene's), PM_EINTERRUPTED, PM_ENOMEM. A rollout that becomes non-finite is
// a result, not a failure. The caller frees; system and dataset must outlive it.
pm_status pm_evaluate(pm_evaluation **evaluation, const pm_system *system, const pm_dataset *truth,
                      int first, int end, const pm_evaluate_how *how);
// The same of the `count` trajectories in `which`.
pm_status pm_evaluate_list(pm_evaluation **evaluation, const pm_system *system,
                           const pm_dataset *truth, int count, const int *which,
                           const pm_evaluate_how *how);
void pm_evaluation_free(pm_evaluation *evaluation); // NULL is allowed

// The first violation that a hard component should have made impossible; NULL: none.
const pm_rollout *pm_evaluation_violation(const pm_evaluation *evaluation);

// Number of rollouts that did not go all the way.
int pm_evaluation_failures(const pm_evaluation *evaluation);

#endif
