// A scene whose subsystems are divided among processes that exchange their values in memory.
#ifndef PM_TESTS_SUPPORT_DIVIDED_H
#define PM_TESTS_SUPPORT_DIVIDED_H

#include "sim/local_subsystems.h"

typedef struct divided {
    const pm_system *system;
    int count;                   // of processes
    int *id;                     // [nsubsystem] those of process 0, then those of process 1, ...
    int *first;                  // [count + 1] where those of each process begin
    pm_local_subsystems **local; // [count]
} divided;

// Opens `count` processes; subsystem i belongs to process number process[i]. NULL: each subsystem
// has a process of its own. Fails the test on errors. The caller closes.
void divided_open(divided *d, const pm_system *system, int count, const int *process);
void divided_close(divided *d);
void divided_set_state(divided *d, const double *z);
// Takes a step. Returns the first failure.
pm_status divided_step(divided *d);
// Copies states, books and fluxes of all subsystems into the sample.
void divided_fill_sample(const divided *d, pm_sample *sample);
// Opens other processes of the same division that continue from the checkpoints of these.
void divided_return(divided *to, const divided *from);

#endif
