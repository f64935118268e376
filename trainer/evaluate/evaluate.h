// Rollouts of a system from the first state of each trajectory of a dataset, scored against the
// rest of the trajectory. The results do not depend on the number of threads.
#ifndef PM_TRAINER_EVALUATE_EVALUATE_H
#define PM_TRAINER_EVALUATE_EVALUATE_H

#include <signal.h>
#include <stdbool.h>

#include "scene/columns.h"
#include "scene/system.h"
#include "sim/ledger.h"
#include "sim/score.h"
#include "store/dataset.h"

// The result of one rollout. Errors are relative L2 errors for each group of columns (sim/score.h).
typedef struct pm_rollout {
    int trajectory;   // its number in the dataset
    int length;       // the number of states of the trajectory
    int reached;      // the number of finite states; `length` if all are
    double *error;    // [ngroup] over the trajectory; infinite if not all states are finite
    double *snapshot; // [ntime][ngroup] error of each state alone; infinite from `reached` on
    double *energy;   // [ntime] J, total; zero from `reached` on, or if energy is not defined
    double *entropy;  // [ntime] J/K, total; zero where `energy` is
    // [2][ntime][nsubsystem] energy J and entropy J/K of each subsystem by the model, in the
    // predicted states and in the true states. Zero where not reached or not defined.
    double *part_energy, *part_entropy;
    long *nout_of_range; // [nsubsystem] steps that ended outside the training range of the weights
    // The lowest and highest temperature dE/ds in K of all entropies, at some of the true states;
    // both 0 if there is none.
    double coldest, warmest;
    pm_ledger ledger;
    char violation[256];     // the message of the first violated law of a hard component, or ""
    double seconds_per_step; // wall time of one step of the scene
} pm_rollout;

typedef struct pm_evaluation {
    pm_arena arena;
    const pm_system *system; // borrowed
    const pm_dataset *truth; // borrowed
    pm_columns columns;
    int count;                // the number of rollouts
    int stride;               // steps of the scene between two states of the dataset
    const pm_dataset *inputs; // that boundary inputs follow, borrowed: truth, or as asked
    const int *inputs_of;     // [count] its trajectories, while the rollouts are made
    pm_rollout *rollout;      // [count]
    // The rollouts as a dataset [count][ntime][ncolumn] in the coordinates of the given one.
    // Columns that the scene does not predict are copied. The last finite state is repeated up to
    // the end.
    pm_dataset *predicted;
    pm_box *trajectory; // [ngroup] the distribution of the errors over trajectories
    pm_box *snapshot;   // [ngroup] the distribution of the errors of states, first states left out
    // [ngroup] medians over trajectories: the error of a first state that stays as it is, and the
    // error of the rollout divided by the deviation of the truth from its mean over time.
    double *persistence, *of_deviation;
} pm_evaluation;

// How an evaluation runs.
typedef struct pm_evaluate_how {
    int threads;                       // at least 1
    const volatile sig_atomic_t *stop; // ends the evaluation when nonzero; or NULL
    // Called after each rollout with the number done so far, by one thread at a time; or NULL.
    void (*progress)(void *context, int done);
    void *context;
    // Measurements that boundary inputs follow in place of the dataset, and the number of the
    // trajectory for each rollout [count]; NULL: the dataset has the inputs.
    const pm_dataset *inputs;
    const int *inputs_of;
} pm_evaluate_how;

// Rolls out trajectories first to end-1. A rollout that becomes non-finite is a result, not a
// failure. `system` and `truth` must outlive the evaluation; the caller frees it. PM_ECONFIG
// (columns), PM_EDATA (missing columns, too few states, a time step that is no multiple of the
// scene's), PM_EINTERRUPTED, PM_ENOMEM.
pm_status pm_evaluate(pm_evaluation **evaluation, const pm_system *system, const pm_dataset *truth,
                      int first, int end, const pm_evaluate_how *how);
// Does the same as pm_evaluate for the trajectories whose numbers are `which` [count].
pm_status pm_evaluate_list(pm_evaluation **evaluation, const pm_system *system,
                           const pm_dataset *truth, int count, const int *which,
                           const pm_evaluate_how *how);
void pm_evaluation_free(pm_evaluation *evaluation); // NULL is allowed

// Makes an evaluation without rollouts, whose predictions the caller fills: `predicted` and, of
// each rollout, `reached`. Nothing else is known of them. Fails like pm_evaluate.
pm_status pm_evaluation_new(pm_evaluation **evaluation, const pm_system *system,
                            const pm_dataset *truth, int count, const int *which);

// Returns the first rollout in which a component in the hard form violated a law, or NULL.
const pm_rollout *pm_evaluation_violation(const pm_evaluation *evaluation);

// Returns the number of rollouts that became non-finite.
int pm_evaluation_failures(const pm_evaluation *evaluation);

// Chooses which [*count] trajectories of a dataset are scored: those of `list` (base/options.h), or
// if it is NULL those that training has not used, or all if it has used all. Unless `quiet`, prints
// whether the weights know some of them. Weights files store a digest of each trajectory on which
// they were trained or validated, so that names of files and the order of trajectories do not
// matter: *known is false if no weights of the system store digests. seen [dataset->ntrajectory]
// receives for each trajectory whether some weights have seen it. PM_EUSAGE: the list is wrong.
pm_status pm_seen_choose(const pm_system *system, const pm_dataset *dataset, const char *list,
                         bool quiet, bool *seen, bool *known, int *which, int *count);

#endif
