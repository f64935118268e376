// Copies of one scene that differ in their states and boundary inputs, for Monte Carlo, control by
// sampling and learning. Copies are lanes of a program of the rates of the whole scene (rates.h),
// in blocks that threads share, and every copy has the bits of a run alone (local_run.h), for any
// number of copies and threads. Scenes whose steps depend on more than their state (an adaptive or
// implicit or balanced integrator), and scenes of many parts, are stepped copy by copy by the
// engine, and the fleet keeps what their runs continue with.
//
// A fleet has no ledger, so that the guard `energy_drift` and the tolerances of both laws do not
// end a copy. A copy whose step fails for another reason ends in the state before that step.
//
// Life cycle: open; write states and inputs, and step; close.
#ifndef PM_LIBRARY_FLEET_H
#define PM_LIBRARY_FLEET_H

#include <pthread.h>
#include <stdatomic.h>

#include "library/setup.h"
#include "sim/monolithic.h"

typedef struct pm_fleet_worker pm_fleet_worker;
struct pm_fleet_gradient;

// The caller owns this storage, and may write to the arrays between two calls.
typedef struct pm_fleet {
    const pm_setup *setup; // borrowed
    int64_t count;
    double *z;                // [count][nz]
    double *input;            // [count][nprescribed] NaN: the scene's own value
    double *energy, *entropy; // [count][nsubsystem] J, J/K, of the states after the last step
    int64_t *step;            // [count] steps taken
    int *ended;               // [count] 0: the copy takes steps. Else it rests: the number is the
                              // status that ended it, or any other that the caller has written
    char why[512]; // of the last call: which of the copies that ended is the first, and its failure
    int row;       // numbers of a saved copy
    // The rest belongs to the fleet.
    pm_arena arena;
    int lanes;      // copies that are stepped together
    int nrecord;    // numbers with which a run continues beside its state
    double *record; // [count][nrecord]
    int nworker;
    pm_fleet_worker *worker; // [nworker]
    int64_t *chosen;         // [count] the copies that take the steps of a call
    int64_t nchosen, steps;  // of the present call
    int64_t failed;          // the first copy that has ended in the present call
    pthread_mutex_t lock;    // protects `failed` and `why`
    // The blocks that the workers share at present (pm_fleet_share).
    void (*work)(void *context, int worker, int64_t block);
    void *context;
    int64_t nshared;
    atomic_llong next;
    // The programs and space of derivatives of rollouts (fleet_gradient.h), and the function that
    // closes them; NULL: nobody has asked for derivatives.
    struct pm_fleet_gradient *gradient;
    void (*close_gradient)(struct pm_fleet_gradient *gradient);
} pm_fleet;

// Opens `count` copies of a completed setup, which is borrowed, at its initial state. `threads`
// share them; 0: as many as there are processors. The caller closes, on failure too. PM_EUSAGE: a
// number is out of range. Otherwise fails as pm_monolithic_open does.
pm_status pm_fleet_open(pm_fleet *fleet, const pm_setup *setup, int64_t count, int threads);
void pm_fleet_close(pm_fleet *fleet);

// Takes `steps` steps, 0 or more, of every copy that has not ended. Never fails: a copy whose step
// fails ends. A copy with a number that is not finite in z ends with PM_ENUMERIC.
void pm_fleet_step(pm_fleet *fleet, int64_t steps);

// Calls work(context, worker, block) for each of `nblock` blocks, in the threads of the fleet's
// workers, and returns when all have ended.
void pm_fleet_share(pm_fleet *fleet, int64_t nblock,
                    void (*work)(void *context, int worker, int64_t block), void *context);

// Return the numbers of a saved copy, and save to or restore from rows [n][pm_fleet_row] the copies
// copy [n], or all if `copy` is NULL: state, steps, whether it has ended, and what its run
// continues with, but not its inputs. PM_EUSAGE: there is no such copy.
int pm_fleet_row(const pm_fleet *fleet);
pm_status pm_fleet_copy(pm_fleet *fleet, bool restore, int64_t n, const int64_t *copy,
                        double *rows);

#endif
