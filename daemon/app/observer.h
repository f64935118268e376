// What `run` and `coordinator` do with the samples of a run: progress, recording, tables.
#ifndef PM_APP_OBSERVER_H
#define PM_APP_OBSERVER_H

#include "app/report.h"
#include "base/progress.h"
#include "lockstep/lockstep_coordinator.h"

// Storage the caller owns.
typedef struct pm_observer {
    const pm_run_options *options;
    const pm_scene *scene;
    pm_report *report;
    pm_recording *recording; // NULL: nobody records, or there was no sample yet
    pm_progress progress;
    double started; // s, monotonic
} pm_observer;

// Checks that the recording, if one is wanted, can be made. The first sample makes it, so that a
// run that never begins leaves an older file alone. `setup` and `options` must outlive it.
// PM_EFILE, PM_ENOMEM.
pm_status pm_observer_open(pm_observer *observer, const pm_setup *setup,
                           const pm_run_options *options);

// The coordinator's options that make it call this observer, which must stay where it is.
pm_lockstep_coordinator_options pm_observer_attach(pm_observer *observer, const pm_setup *setup);

// After the run, whatever `status` it ended with: closes the recording and prints the tables of the
// steps that were computed, unless --quiet. `how` names the transport. Returns `status`, or
// PM_EFILE if that was PM_OK and the recording cannot be completed.
pm_status pm_observer_finish(pm_observer *observer, pm_status status, const pm_ledger *ledger,
                             const char *how);

// Releases what _finish did not. Allowed on a zeroed observer.
void pm_observer_close(pm_observer *observer);

#endif
