// Prints how a run is doing (health_t in lcmtypes/portmet.lcm) as a table.
#ifndef PM_APP_HEALTH_TABLE_H
#define PM_APP_HEALTH_TABLE_H

#include <stdio.h>

#include "lockstep/health.h"

// Prints one line for the run, which names the process that the others wait for, and one for each
// process: its pace, for whom it waits, what it requests again, and what the system says of it.
void pm_health_table_print(FILE *file, const pm_scene *scene, const portmet_health_t *health);

#endif
