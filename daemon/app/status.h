// Prints how a run is doing, for `portmetd status` and for whoever sends SIGUSR1 to a coordinator.
#ifndef PM_APP_STATUS_H
#define PM_APP_STATUS_H

#include <stdio.h>

#include "base/journal.h"
#include "lockstep/health.h"

// Prints one line for the run, which names the process that all others wait for, and one line for
// each process: its steps per second, the peer that it waits for most, its requests for lost
// messages, the messages that it dropped, and its CPU time and memory. The lines are a table in
// `file`, or lines of `log` with the numbers as fields, if it is not NULL and wants JSON.
void pm_status_print(FILE *file, const pm_journal *log, const pm_scene *scene,
                     const portmet_health_t *health);

#endif
