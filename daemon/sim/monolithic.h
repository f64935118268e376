// All subsystems of a scene stepped in one process by a plain loop: what the distributed run must
// reproduce bit by bit, and what evaluation uses.
#ifndef PM_SIM_MONOLITHIC_H
#define PM_SIM_MONOLITHIC_H

#include "sim/subsystem.h"

typedef struct pm_monolithic pm_monolithic;

pm_status pm_monolithic_open(pm_monolithic **assembly, const pm_system *system);
void pm_monolithic_close(pm_monolithic *assembly);

// As pm_subsystem_set_boundary_input.
void pm_monolithic_set_boundary_input(pm_monolithic *assembly,
                                      const pm_boundary_input *boundary_input);

// Starts from the concatenated state z [scene->nz], at step 0.
void pm_monolithic_set_state(pm_monolithic *assembly, const double *z);

// One step; the sample of the state reached (valid until the next call). PM_ENUMERIC.
pm_status pm_monolithic_step(pm_monolithic *assembly);
int pm_monolithic_substeps(const pm_monolithic *assembly); // of the next step
const pm_sample *pm_monolithic_sample(const pm_monolithic *assembly);

#endif
