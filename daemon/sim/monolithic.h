// Steps all subsystems of a scene in one process by a plain loop. `portmet-train evaluate` uses it.
// A run over several processes must give the same bits.
//
// Life cycle: open; set_boundary_input if the scene has any; set_state; step, and read the sample
// after each step; close.
#ifndef PM_SIM_MONOLITHIC_H
#define PM_SIM_MONOLITHIC_H

#include "sim/local_subsystems.h"

typedef struct pm_monolithic pm_monolithic;

// Opens all subsystems of the system, which is borrowed. The caller closes. Fails as
// pm_subsystem_open and pm_step_controller_init do.
pm_status pm_monolithic_open(pm_monolithic **monolithic, const pm_system *system);
void pm_monolithic_close(pm_monolithic *monolithic); // NULL is allowed

// Sets the source of the boundary inputs of all subsystems. It is borrowed.
void pm_monolithic_set_boundary_input(pm_monolithic *monolithic,
                                      const pm_boundary_input *boundary_input);

// Starts a run at step 0 from the concatenated state z [scene->nz].
void pm_monolithic_set_state(pm_monolithic *monolithic, const double *z);

// Checks a state from which a run could be started, as pm_local_subsystems_check_state does.
pm_status pm_monolithic_check_state(pm_monolithic *monolithic, const double *z);
// Lets a run that was just started begin at `step` instead of 0.
void pm_monolithic_set_step(pm_monolithic *monolithic, long step);
// Counts, saves or restores all numbers with which a run continues with the same bits. The first
// ones are the state z of a scene whose subsystems have it in their order.
void pm_monolithic_record(pm_monolithic *monolithic, pm_serializer *serializer);

// Takes one step. Fails as pm_local_subsystems_end_step does; the step is then not taken.
pm_status pm_monolithic_step(pm_monolithic *monolithic);
// Keeps from now on what a step overwrites (local_subsystems.h). PM_ENOMEM.
pm_status pm_monolithic_keep_steps(pm_monolithic *monolithic);
// Undoes the last step, which pm_monolithic_step has taken since the last call. Steps are kept.
void pm_monolithic_undo_step(pm_monolithic *monolithic);
// Takes over state, step, counts and fluxes of another run of the same system, whose boundary
// inputs may differ: both go on with the same bits. PM_ENOMEM.
pm_status pm_monolithic_copy(pm_monolithic *monolithic, pm_monolithic *from);
// Writes efforts and flows at the present state, as pm_local_subsystems_efforts does.
void pm_monolithic_efforts(pm_monolithic *monolithic, double *dE, double *reaction);
// Returns the number of substeps of the next step.
int pm_monolithic_substeps(const pm_monolithic *monolithic);
// Returns the sample of the state reached. It is owned by the object. A caller asks for it after
// every step whose sample it needs: a sample that nobody asks for is not filled.
const pm_sample *pm_monolithic_sample(pm_monolithic *monolithic);
// Sums up the last step in the tally, which it sets, and returns a sample that holds no more than
// the first PM_SCENE_LISTED subsystems and their ports. This costs much less where there are many.
const pm_sample *pm_monolithic_sums(pm_monolithic *monolithic, pm_tally *tally);

#endif
