// All subsystems of a scene stepped in one process by a plain loop: what the distributed run must
// reproduce bit by bit, and what evaluation uses.
#ifndef PM_SIM_ASSEMBLY_H
#define PM_SIM_ASSEMBLY_H

#include "sim/subsystem.h"

typedef struct pm_assembly pm_assembly;

pm_status pm_assembly_open(pm_assembly **assembly, const pm_system *system);
void pm_assembly_close(pm_assembly *assembly);

// As pm_subsystem_set_load.
void pm_assembly_set_load(pm_assembly *assembly, const pm_load *load);

// Starts from the concatenated state z [scene->nz], at step 0.
void pm_assembly_set_state(pm_assembly *assembly, const double *z);

// One step; the sample of the state reached (valid until the next call). PM_ENUMERIC.
pm_status pm_assembly_step(pm_assembly *assembly);
int pm_assembly_substeps(const pm_assembly *assembly); // of the next step
const pm_sample *pm_assembly_sample(const pm_assembly *assembly);

#endif
