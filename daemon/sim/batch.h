// Integrates many subsystems in one process. Subsystems with the same model are evaluated together,
// and so are ports with the same model. They are divided into blocks, and each subsystem or port is
// one lane of a block. Arrays of states, co-energies and rates have the lane as their last index,
// so that one run of a graph serves all lanes of a block. Indices, not pointers, lead from a port
// to its ends. Every subsystem has the same bits, fluxes, and counts of evaluated and skipped
// graphs as if it were stepped alone (subsystem.h). A block is not evaluated if no input of its
// lanes has changed.
//
// A batch serves explicit Runge-Kutta methods with fixed substeps and ports between two subsystems.
// It serves no scene with contact, boundary inputs or laws that compute the two ends separately;
// monolithic.h steps the subsystems of such a scene one by one.
//
// Life cycle: open; set_state; then steps; close. Samples are filled on demand, since they cost as
// much as a good part of a step.
#ifndef PM_SIM_BATCH_H
#define PM_SIM_BATCH_H

#include "scene/recording.h"
#include "scene/system.h"

typedef struct pm_batch pm_batch;

// Builds the graphs and arrays of all subsystems of the system, which is borrowed. *batch is NULL
// if a batch cannot serve the scene. The caller closes. PM_ENOMEM.
pm_status pm_batch_open(pm_batch **batch, const pm_system *system);
void pm_batch_close(pm_batch *batch); // NULL is allowed

// Returns the number of lanes in all blocks of subsystems, used or not.
int pm_batch_lanes(const pm_batch *batch);

// Starts a run at step 0 from the concatenated state z [scene->nz].
void pm_batch_set_state(pm_batch *batch, const double *z);
// Takes a step. PM_ENUMERIC: a state or a potential is not finite, or a state is further outside
// the training range than the scene's guard allows; all states are then those of the last
// successful step.
pm_status pm_batch_step(pm_batch *batch);
// Fills the sample of the state reached, except its step and time, with the fluxes of the last
// step.
void pm_batch_fill_sample(const pm_batch *batch, pm_sample *sample);

#endif
