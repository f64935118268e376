// Handles the samples of a run for `run` and `coordinator`: progress, recording and tables. A
// recording that cannot be written ends the run, unless the scene says `record: {on_error: go_on}`:
// then a line on stderr says so, and the run goes on without its recording.
#ifndef PM_APP_OBSERVER_H
#define PM_APP_OBSERVER_H

#include "app/command.h"
#include "base/progress.h"
#include "library/setup.h"
#include "lockstep/coordinator.h"
#include "scene/recording.h"

typedef struct pm_report pm_report; // the sums for the tables

// Installs a handler of SIGUSR1, which asks for the state of the run.
void pm_status_install(void);

// Returns true if SIGUSR1 has come since the last call.
bool pm_status_requested(void);

// The caller owns the storage.
typedef struct pm_observer {
    pm_arena arena;
    const pm_run_options *options;
    const pm_scene *scene;
    pm_report *report;
    pm_recording *recording; // NULL: no recording is wanted, or there was no sample yet
    bool unrecorded;         // the recording has failed, and the run goes on without it
    pm_progress progress;
    double started; // s of pm_clock
} pm_observer;

// Checks that the recording, if one is wanted, can be made. It must not replace a file that the run
// reads. It may replace an older recording, and any other file only if the options allow it.
// PM_EUSAGE, PM_EFILE.
pm_status pm_observer_check_recording(const pm_run_options *options);

// Opens an observer and checks its recording (pm_observer_check_recording). The recording is made
// when the first sample arrives, so that a run that never begins does not destroy an older file.
// `setup` and `options` must outlive the observer. PM_EUSAGE, PM_EFILE, PM_ENOMEM.
pm_status pm_observer_open(pm_observer *observer, const pm_setup *setup,
                           const pm_run_options *options);

// Returns options with which a coordinator calls this observer. They hold the address of the
// observer, which must not move before the coordinator is closed. They do not refer to `setup`.
pm_lockstep_coordinator_options pm_observer_attach(pm_observer *observer, const pm_setup *setup);

// Closes the recording after a run that ended with `status`, and prints the tables of the steps
// done, unless --quiet. `pace` tells how the run kept its pace; `how` names the transport for the
// tables. Returns `status`. If the run succeeded: PM_EFILE if the recording cannot be completed,
// and PM_ELAW if the integrator promises to keep the energy and has not kept it on every step.
pm_status pm_observer_finish(pm_observer *observer, pm_status status, const pm_ledger *ledger,
                             const pm_pace *pace, const char *how);

// Releases all memory of the observer. It may be called for a zeroed observer.
void pm_observer_close(pm_observer *observer);

#endif
