// Prints how a run is doing (health_t in lcmtypes/portmet.lcm) as a table.
#ifndef PM_APP_HEALTH_TABLE_H
#define PM_APP_HEALTH_TABLE_H

#include <stdio.h>

#include "base/journal.h"
#include "lockstep/health.h"

// Prints one line for the run, which names the process that all others wait for, and one line for
// each process: its steps per second, the peer that it waits for most, its requests for lost
// messages, the messages that it dropped, and its CPU time and memory.
void pm_health_table_print(FILE *file, const pm_scene *scene, const portmet_health_t *health);

// Writes a line for the run and one for each process, with the numbers as fields, to `log`.
void pm_health_table_log(const pm_journal *log, const pm_scene *scene,
                         const portmet_health_t *health);

#endif
