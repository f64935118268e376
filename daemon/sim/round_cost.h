// Measures how long a round of each subsystem takes, for a cut of the scene by cost. Subsystems
// with one model take the same time, so that each model is measured once, with up to 64 subsystems
// that have it. A round is what they show, the bulk term, the laws of their ports, and the next
// state with its co-energies.
#ifndef PM_SIM_ROUND_COST_H
#define PM_SIM_ROUND_COST_H

#include "sim/subsystem.h"

// Sets cost [scene->nsubsystem] to the time that a round of each subsystem takes on this processor,
// in 1/8 of the shortest one. Times are rounded to multiples of the fourth root of two, so that
// repeated measurements mostly agree. z [scene->nz] is the state at which they are measured, and
// `boundary_input` may be NULL if the scene has none. PM_ENOMEM, and what
// pm_local_subsystems_open returns.
pm_status pm_round_cost_measure(const pm_system *system, const double *z,
                                const pm_boundary_input *boundary_input, int *cost);

#endif
