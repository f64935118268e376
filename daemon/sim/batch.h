// Integrates the subsystems of one process. Subsystems with the same model are evaluated together,
// and so are ports with the same model. They are divided into blocks, and each subsystem or port is
// one lane of a block. Arrays of states, co-energies and rates have the lane as their last index,
// so that one run of a graph serves all lanes of a block. Indices, not pointers, lead from a port
// to its ends. Every subsystem has the same bits, fluxes, and counts of evaluated and skipped
// graphs as if it were stepped alone (subsystem.h). A block is not evaluated if no input of its
// lanes has changed.
//
// A port may join a subsystem of the batch with one of another process, which is its remote end.
// The batch keeps what the remote end shows in a *ghost*: a lane that no graph computes.
//
// A batch serves explicit Runge-Kutta methods and ports between two subsystems.
// It serves no scene with contact, boundary inputs or laws that compute the two ends separately;
// local_subsystems.h steps the subsystems of such a scene one by one.
//
// Life cycle: open; set_state; then steps; close. A step consists of rounds, one for each stage of
// each substep, until pm_batch_completes_step:
//     pm_batch_show      what the batch shows at its remote ends, which others need
//     pm_batch_bulk      evaluates the bulk terms
//     pm_batch_hear      once per remote end: takes what the subsystem there shows
//     pm_batch_couple    evaluates the laws of all ports
//     pm_batch_advance   computes the states of the next stage, and their co-energies
// and then pm_batch_end_step. Samples are filled on demand, since they cost as much as a good part
// of a step.
#ifndef PM_SIM_BATCH_H
#define PM_SIM_BATCH_H

#include "scene/recording.h"
#include "scene/system.h"
#include "sim/subsystem.h"
#include "sim/tally.h"

typedef struct pm_batch pm_batch;

// Builds the graphs and arrays of the subsystems id [count], which are positions in the scene in
// ascending order. `id` and `system` are borrowed. *batch is NULL if a batch cannot serve the
// scene. The caller closes. PM_ENOMEM.
pm_status pm_batch_open(pm_batch **batch, const pm_system *system, int count, const int *id);
void pm_batch_close(pm_batch *batch); // NULL is allowed

// Returns the number of lanes in all blocks of subsystems, used or not.
int pm_batch_lanes(const pm_batch *batch);

// Starts a run at step 0 from the concatenated state z [scene->nz].
void pm_batch_set_state(pm_batch *batch, const double *z);

// Sets the number of substeps of the next step. Until then it is the scene's.
void pm_batch_set_substeps(pm_batch *batch, int substeps);

// Writes what the batch shows at its remote end number `end` since the last pm_batch_advance to
// values->y, e and eta [values->ny], and returns the energy and entropy flux through this end
// during the last step. The remote ends are counted by subsystem, then by port, as in the scene.
pm_flux pm_batch_show(const pm_batch *batch, int end, double *y, double *e, double *eta);
void pm_batch_bulk(pm_batch *batch);
// Takes what the subsystem at the other side of remote end number `end` shows at this stage.
void pm_batch_hear(pm_batch *batch, int end, const pm_port_values *values);
void pm_batch_couple(pm_batch *batch);
void pm_batch_advance(pm_batch *batch);
bool pm_batch_completes_step(const pm_batch *batch);
// Ends a step after its last round. PM_ENUMERIC: a state or a potential is not finite, or a state
// is further outside the training range than the scene's guard allows; all states are then those of
// the last successful step.
pm_status pm_batch_end_step(pm_batch *batch);
// Takes a step of a batch without remote ends. Fails as pm_batch_end_step does.
pm_status pm_batch_step(pm_batch *batch);

// Return the quantities of the last step that enter the report of subsystem number `i` of the batch
// (subsystem.h), and write its state to z [nz]. The batch owns the fluxes of the books, which are
// valid until the next call.
pm_books pm_batch_books(pm_batch *batch, int i);
void pm_batch_state(const pm_batch *batch, int i, double *z);
// Fills the sample of the state reached, except its step and time, with the fluxes of the last
// step.
void pm_batch_fill_sample(const pm_batch *batch, pm_sample *sample);

// Adds the last step of all subsystems, and of the ports between two of them, to the tally.
void pm_batch_tally(pm_batch *batch, pm_tally *tally);

// Counts, saves or restores, as `record` demands (base/record.h), all numbers that the batch needs
// to continue from the end of a step with the same bits. Saving is allowed between two steps,
// restoring at any time.
void pm_batch_record(pm_batch *batch, pm_record *record);

#endif
