// Decides when the iteration of an implicit step ends (scene/integrator.h, `discrete`). All
// subsystems must end it in the same round, wherever they live, and each hears only from its
// neighbours. Each therefore has a level, which it exposes with its values: 0 until its own iterate
// has converged; then one more than the lowest level that it and its neighbours had a round ago. A
// subsystem whose level has reached k knows that all subsystems at a distance of less than k ports
// have converged. With a bound D on the distance between any two, the level D + 1 is reached by all
// in the same round: D rounds after the last one has converged. The next round is the last.
#ifndef PM_SIM_ITERATION_H
#define PM_SIM_ITERATION_H

#include <stdbool.h>

// The change of an iterate, relative to the length of its group, at which it has converged. Near
// the limit of rounding the change may no longer fall; below ROUNDING that counts, too.
#define PM_ITERATION_CONVERGED 1e-14
#define PM_ITERATION_ROUNDING 1e-12

// The caller owns this storage.
typedef struct pm_iteration {
    double change; // of the last round; infinite before the first
    bool converged;
    int level, heard; // own level; the lowest of the neighbours in this round, INT_MAX if none
    bool last;        // the round that begins is the last one
} pm_iteration;

// Begins the iteration of a substep.
void pm_iteration_start(pm_iteration *iteration);

// Takes in the level of a neighbour in this round.
void pm_iteration_hear(pm_iteration *iteration, int level);

// Ends a round in which the iterate has changed by `change`. `diameter` bounds the distance between
// any two subsystems; `left` is the number of rounds that may follow. Returns true if this round
// was the last one; the caller then starts anew.
bool pm_iteration_end_round(pm_iteration *iteration, double change, int diameter, int left);

#endif
