// The subsystems that one process steps: all of a scene (monolithic.h), or those of one process of
// several (lockstep/process_subsystems.h). Each step integrates README.md, equation (1).
//
// A port between a subsystem here and one of another process has one end here, a *remote end*. In
// every round the owner passes on what the subsystems here show at the remote ends, and hands over
// what the subsystems at the other sides show.
//
// Life cycle: open; set_boundary_input if the scene has any; set_state; then steps; close. A step
// consists of rounds, one for each stage of each substep, until
// pm_local_subsystems_completes_step:
//     pm_local_subsystems_get_boundary  once per remote end: what others need
//     pm_local_subsystems_bulk          evaluates the bulk terms while these values travel
//     pm_local_subsystems_set_boundary  once per remote end: what the other side shows
//     pm_local_subsystems_couple        evaluates the laws of all ports
//     pm_local_subsystems_advance       computes the states of the next stage, and what they show
// and then pm_local_subsystems_end_step.
//
// The order of sums is fixed, so that the same calls give the same bits in one process and in many,
// and for any number of subsystems that are evaluated together. A graph is not run again while its
// inputs keep their bits, so that a subsystem at rest takes almost no time. The weights must
// therefore not change between two calls of pm_local_subsystems_set_state.
#ifndef PM_SIM_LOCAL_SUBSYSTEMS_H
#define PM_SIM_LOCAL_SUBSYSTEMS_H

#include "base/serializer.h"
#include "scene/boundary_input.h"
#include "scene/sample.h"
#include "scene/system.h"
#include "sim/tally.h"

// The largest number of subsystems of a kind that are evaluated together, the lanes of a block. So
// many lanes make the cost of starting an operation negligible, and so few keep the values of a
// graph in the cache.
#define PM_MOST_LANES 64

typedef struct pm_local_subsystems pm_local_subsystems;

// The numbers that one end of a port exposes at a stage. Each array has ny numbers and is borrowed.
typedef struct pm_port_values {
    int ny;
    const double *y;   // exposed components of the state
    const double *e;   // dE/dy
    const double *eta; // dS/dy; all zero without entropy
    // Change of e per unit of rate, with which an implicit method predicts e at the end of the step
    // (model/prediction.h); NULL for other methods.
    const double *response;
    uint64_t known; // of the convergence of an implicit method's iteration (iteration.h)
} pm_port_values;

// A remote end: position of the port in the scene, and the end at which the subsystem here is.
typedef struct pm_remote_end {
    int port_id;
    pm_end end;
} pm_remote_end;

// Opens `count` subsystems of the system, at the initial state of the scene or at zero. id [count]
// are their positions in the scene in ascending order; NULL: all subsystems of the scene. `system`
// and `id` are borrowed. The caller closes. PM_ECONFIG: the integrator cannot serve a subsystem, or
// the states have more components than an int can count. PM_ENOMEM.
pm_status pm_local_subsystems_open(pm_local_subsystems **local, const pm_system *system, int count,
                                   const int *id);
void pm_local_subsystems_close(pm_local_subsystems *local); // NULL is allowed

// Returns the number of remote ends, and one of them. They are ordered by subsystem, then by port,
// as in the scene.
int pm_local_subsystems_nremote(const pm_local_subsystems *local);
pm_remote_end pm_local_subsystems_remote(const pm_local_subsystems *local, int remote);

// Sets the source of the scene's boundary inputs, which is borrowed and must outlive the object.
void pm_local_subsystems_set_boundary_input(pm_local_subsystems *local,
                                            const pm_boundary_input *boundary_input);
// Starts a run at step 0 from the concatenated state z [scene->nz] of the whole scene. All fluxes
// and counts of pm_books are zero there.
void pm_local_subsystems_set_state(pm_local_subsystems *local, const double *z);
// Checks the state z [scene->nz] of the whole scene, from which a run could be started. To be
// called between two steps, of which it keeps the bits, if steps are kept. PM_ENUMERIC: an energy,
// an entropy or a co-energy is not finite there.
pm_status pm_local_subsystems_check_state(pm_local_subsystems *local, const double *z);
// Lets a run that was just started begin at `step` instead of 0: boundary inputs have the values of
// that step.
void pm_local_subsystems_set_step(pm_local_subsystems *local, long step);
// Sets the number of substeps of every step from the next one on (step_controller.h), until it is
// called again. It may only be called between two steps.
void pm_local_subsystems_set_substeps(pm_local_subsystems *local, int substeps);
// Returns the largest number of rounds that a step can have.
int pm_local_subsystems_most_rounds(const pm_local_subsystems *local);
// Returns true after the last round of a step. It is the same round for all subsystems of a scene.
bool pm_local_subsystems_completes_step(const pm_local_subsystems *local);

// Writes what a subsystem here shows at a remote end to y, e and eta [ny], where ny is the number
// of components that this end exposes, and with an implicit method to `response` [ny] and `known`,
// as in pm_port_values. Returns the flux through this end into the subsystem during the last step.
pm_flux pm_local_subsystems_get_boundary(const pm_local_subsystems *local, int remote, double *y,
                                         double *e, double *eta, double *response, int64_t *known);
void pm_local_subsystems_bulk(pm_local_subsystems *local);
// Takes what the subsystem at the other side of a remote end shows in this round.
void pm_local_subsystems_set_boundary(pm_local_subsystems *local, int remote,
                                      const pm_port_values *values);
void pm_local_subsystems_couple(pm_local_subsystems *local);
void pm_local_subsystems_advance(pm_local_subsystems *local);
// Ends a step after its last round. PM_ENUMERIC: a state or a potential is not finite, a state is
// further outside the training range than the scene's guard allows, or a solid found no balance of
// forces. PM_EDATA: the dataset behind a boundary input is over. On failure all states are those of
// the last successful step, and if steps are kept, the step is undone.
pm_status pm_local_subsystems_end_step(pm_local_subsystems *local);
// Keeps from now on what a step overwrites. This takes a copy of all counts in each step, and
// memory for a second set of fluxes. To be called between two steps. PM_ENOMEM.
pm_status pm_local_subsystems_keep_steps(pm_local_subsystems *local);
// Undoes the step that was begun or completed last, if steps are kept: states, books, counts, and
// all that a later step depends on have the bits that they had before it. Does nothing if no step
// was begun since the start of the run, or since the last call.
void pm_local_subsystems_undo_step(pm_local_subsystems *local);

// Return the books of the last step of subsystem number `i` of those here, and write its state to z
// [nz]. The fluxes of the books are owned by the object, and valid until the next call.
pm_books pm_local_subsystems_books(const pm_local_subsystems *local, int i);
void pm_local_subsystems_state(const pm_local_subsystems *local, int i, double *z);
// Writes the co-energies dE/dz of all subsystems here to dE [scene->nz], those of energy variables
// where a group is shown by its co-energy. To `reaction` [scene->nprescribed / 3], unless it is
// NULL, it writes the rates that the laws give to what boundary inputs prescribe, at the present
// states and time. To be called between two steps, of which it keeps the bits, if steps are kept.
void pm_local_subsystems_efforts(pm_local_subsystems *local, double *dE, double *reaction);
// Takes the fluxes of the last step from others of the same system.
void pm_local_subsystems_take_fluxes(pm_local_subsystems *local, const pm_local_subsystems *from);
// Copies states and books of the first `count` subsystems here, and the fluxes through their ports,
// into their places of the sample.
void pm_local_subsystems_fill_sample(const pm_local_subsystems *local, int count,
                                     pm_sample *sample);
// Adds the last step of all subsystems here, and of the ports between two of them, to the tally.
void pm_local_subsystems_tally(const pm_local_subsystems *local, pm_tally *tally);

// Counts, saves or restores, as `record` demands (base/serializer.h), all numbers with which the
// subsystems continue from the end of a step with the same bits. Saving is allowed between two
// steps, restoring at any time.
void pm_local_subsystems_record(pm_local_subsystems *local, pm_serializer *serializer);

#endif
