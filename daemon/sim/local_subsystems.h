// The subsystems that one process steps: all of a scene (monolithic.h), or those of one process of
// several (lockstep/process_subsystems.h). Many subsystems with few models are a batch (batch.h);
// others are stepped one by one (subsystem.h). The bits are the same.
//
// A port between a subsystem here and one of another process has one end here, a *remote end*. In
// every round the owner passes on what the subsystems here show at the remote ends, and hands over
// what the subsystems at the other sides show.
//
// Life cycle: open; set_boundary_input if the scene has any; set_state; then steps; close. A step
// consists of rounds, one for each stage of each substep, until
// pm_local_subsystems_completes_step:
//     pm_local_subsystems_expose    evaluates what all ports show
//     pm_local_subsystems_show      once per remote end: what others need
//     pm_local_subsystems_bulk      evaluates the bulk terms while these values travel
//     pm_local_subsystems_hear      once per remote end: what the other side shows
//     pm_local_subsystems_couple    evaluates the laws of all ports
//     pm_local_subsystems_advance   combines the stages so far
// and then pm_local_subsystems_end_step.
#ifndef PM_SIM_LOCAL_SUBSYSTEMS_H
#define PM_SIM_LOCAL_SUBSYSTEMS_H

#include "sim/subsystem.h"
#include "sim/tally.h"

typedef struct pm_local_subsystems pm_local_subsystems;

// A remote end: position of the port in the scene, and the end at which the subsystem here is.
typedef struct pm_remote_end {
    int port_id;
    pm_end end;
} pm_remote_end;

// Opens `count` subsystems of the system, at the initial state of the scene or at zero. id [count]
// are their positions in the scene in ascending order; NULL: all subsystems of the scene. `system`
// and `id` are borrowed. The caller closes. Fails as pm_subsystem_open does.
pm_status pm_local_subsystems_open(pm_local_subsystems **local, const pm_system *system, int count,
                                   const int *id);
void pm_local_subsystems_close(pm_local_subsystems *local); // NULL is allowed

// Returns the number of remote ends, and one of them. They are ordered by subsystem, then by port,
// as in the scene.
int pm_local_subsystems_nremote(const pm_local_subsystems *local);
pm_remote_end pm_local_subsystems_remote(const pm_local_subsystems *local, int remote);

// Do for all subsystems what the functions of subsystem.h with these names do for one. z
// [scene->nz] is the state of the whole scene.
void pm_local_subsystems_set_boundary_input(pm_local_subsystems *local,
                                            const pm_boundary_input *boundary_input);
void pm_local_subsystems_set_state(pm_local_subsystems *local, const double *z);
void pm_local_subsystems_set_substeps(pm_local_subsystems *local, int substeps);
int pm_local_subsystems_most_rounds(const pm_local_subsystems *local);
bool pm_local_subsystems_completes_step(const pm_local_subsystems *local);

void pm_local_subsystems_expose(pm_local_subsystems *local);
// Writes what a subsystem here shows at a remote end to y, e and eta [ny], where ny is the number
// of components that this end exposes, and `response` [ny] (NULL: not wanted) and `known`, as in
// pm_port_values. Returns the flux through this end into the subsystem during the last step.
pm_flux pm_local_subsystems_show(const pm_local_subsystems *local, int remote, double *y, double *e,
                                 double *eta, double *response, int64_t *known);
void pm_local_subsystems_bulk(pm_local_subsystems *local);
// Takes what the subsystem at the other side of a remote end shows in this round. The arrays are
// borrowed until pm_local_subsystems_couple.
void pm_local_subsystems_hear(pm_local_subsystems *local, int remote, const pm_port_values *values);
void pm_local_subsystems_couple(pm_local_subsystems *local);
void pm_local_subsystems_advance(pm_local_subsystems *local);
pm_status pm_local_subsystems_end_step(pm_local_subsystems *local);

// Return the books of the last step of subsystem number `i` of those here, and write its state to z
// [nz]. The fluxes of the books are owned by the object, and valid until the next call.
pm_books pm_local_subsystems_books(const pm_local_subsystems *local, int i);
void pm_local_subsystems_state(const pm_local_subsystems *local, int i, double *z);
// Copies states and books of all subsystems here into their places of the sample.
void pm_local_subsystems_fill_sample(const pm_local_subsystems *local, pm_sample *sample);

// Copies states and books of the first `count` subsystems into their places of the sample.
void pm_local_subsystems_fill_first(const pm_local_subsystems *local, int count, pm_sample *sample);
// Adds the last step of all subsystems here, and of the ports between two of them, to the tally.
void pm_local_subsystems_tally(const pm_local_subsystems *local, pm_tally *tally);

// Puts all numbers with which the subsystems continue from the end of a step, with the same bits,
// into the record (base/record.h).
void pm_local_subsystems_record(pm_local_subsystems *local, pm_record *record);

#endif
