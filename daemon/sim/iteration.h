// Decides when the iteration of an implicit step ends (scene/integrator.h, `discrete`). All
// subsystems must end it in the same round, wherever they live, and each hears only from its
// neighbours. Each therefore exposes with its values what it knows of the others, as a set of bits:
// bit k says that all subsystems at a distance of at most k ports had converged k rounds before.
// Bit 0 is its own convergence, and bit k + 1 follows from bit k of itself and of its neighbours,
// one round later. With a bound D on the distance between any two subsystems, bit D says of a
// single round whether all had converged in it. It is therefore the same for all of them, and the
// round after it was set is the last one.
//
// The last rounds that an iteration may have accept more: a change of PM_ITERATION_ACCEPTED, if it
// leaves no energy open that counts beside the largest energy of a subsystem, and does not grow
// round by round. The subsystems expose the exponent of the largest energy that they know of, too.
// If bit D says then that not all have converged, all of them give up in the same round. Where D is
// so large that the bits do not reach all of them in time, only a subsystem that has not converged
// itself knows it: it is stuck, which ends the run.
#ifndef PM_SIM_ITERATION_H
#define PM_SIM_ITERATION_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

// The change of an iterate, relative to the length of its group, at which it has converged. Near
// the limit of rounding the change may no longer fall; below ROUNDING that counts, too.
#define PM_ITERATION_CONVERGED 1e-14
#define PM_ITERATION_ROUNDING 1e-12
// The change that is accepted in the last rounds. A group of variables that begins to move has a
// length of nearly zero, and the rounding of a stiff neighbour may be so much of it.
#define PM_ITERATION_ACCEPTED 1e-6

// The caller owns this storage.
typedef struct pm_iteration {
    double change; // of the last round; infinite before the first
    // The caller keeps these, in J: the energy at the start of the substep, what the last rates
    // took in, and the sum of the magnitudes of that.
    double start, taken, gross;
    bool keeps_energy; // no iterate has converged while open energy counts; the caller says so
    uint64_t known;    // the bits
    uint64_t heard;    // those that all neighbours have exposed in this round
    uint64_t scale, heard_scale; // exponents of the largest energies; see iteration.c
    int rising;                  // rounds, up to the last one, in which the change has grown
    bool last;                   // the round that begins is the last one
    bool gave_up; // it is the last one although not all have converged, as all of them know
    bool stuck;   // it is the last one although this subsystem has not converged
} pm_iteration;

// Begins the iteration of a substep.
static inline void pm_iteration_start(pm_iteration *iteration) {
    *iteration = (pm_iteration){.change = INFINITY, .heard = UINT64_MAX};
}

// Takes in what a neighbour has exposed in this round.
void pm_iteration_hear(pm_iteration *iteration, uint64_t known);

// Ends a round in which the iterate has changed by `change`. The iterate before left energy open:
// it counts unless some subsystem has an energy of at least `open`, in J, at the start of the
// substep. `diameter` bounds the distance between any two subsystems; `left` is the number of
// rounds that may follow. Returns true if this round was the last one; the caller then starts anew.
bool pm_iteration_end_round(pm_iteration *iteration, double change, double open, int diameter,
                            int left);

#endif
