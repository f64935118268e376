// Passes samples from the coordinator to the terminal and to a file.
#include "app/observer.h"

#include <stddef.h>
#include <stdio.h>

#include "app/health_table.h"
#include "app/notify.h"
#include "app/status_request.h"

pm_status pm_observer_check_recording(const pm_setup *setup, const pm_run_options *options) {
    if (options->record == NULL) {
        return PM_OK;
    }
    const char *input = pm_setup_input(setup, options->record);
    if (input != NULL) {
        return pm_fail(PM_EUSAGE, "--record %s: the run reads this file (%s)", options->record,
                       input);
    }
    return pm_recording_check(options->record, options->overwrite);
}

pm_status pm_observer_open(pm_observer *observer, const pm_setup *setup,
                           const pm_run_options *options) {
    *observer = (pm_observer){.options = options, .scene = setup->scene, .started = pm_clock()};
    PM_TRY(pm_report_open(&observer->report, setup));
    return pm_observer_check_recording(setup, options);
}

// Appends every so many samples, as the scene asks, from step 0 on.
static pm_status record(pm_observer *observer, const pm_sample *sample) {
    if (sample->step % observer->scene->record_every != 0) {
        return PM_OK;
    }
    if (observer->recording == NULL) {
        PM_TRY(pm_recording_open(&observer->recording, observer->options->record, observer->scene));
    }
    return pm_recording_append(observer->recording, sample);
}

// Passes on the status of the recording, unless the scene wants the run to go on without it.
static pm_status outlive(pm_observer *observer, pm_status status) {
    if (status != PM_EFILE || !observer->scene->outlives_recording) {
        return status;
    }
    pm_journal_write(&observer->options->log, PM_JOURNAL_NOTICE, 0, NULL,
                     "the run goes on without its recording: %s", pm_error());
    (void)pm_recording_close(observer->recording);
    observer->recording = NULL;
    observer->unrecorded = true;
    return PM_OK;
}

static pm_status observe(void *context, const pm_sample *sample) {
    pm_observer *observer = context;
    pm_report_add(observer->report, sample);
    pm_progress_update(&observer->progress, sample->step, NULL);
    return observer->options->record == NULL || observer->unrecorded
               ? PM_OK
               : outlive(observer, record(observer, sample));
}

static void tell_pause(void *context, const char *silent) {
    const pm_observer *observer = context;
    if (observer->options->quiet) {
        return;
    }
    const pm_journal *log = &observer->options->log;
    const long step = pm_report_steps(observer->report);
    const pm_journal_field field[] = {{.name = "step", .number = (double)step},
                                      {.name = "silent", .text = silent}};
    if (silent[0] == 0) {
        pm_journal_write(log, PM_JOURNAL_NOTICE, 1, field, "the run goes on");
    } else {
        pm_journal_write(log, PM_JOURNAL_NOTICE, 2, field,
                         "the run pauses after step %ld: no word from %s", step, silent);
    }
}

static void tell_hold(void *context, long step) {
    const pm_observer *observer = context;
    if (!observer->options->quiet) {
        const pm_journal_field field = {.name = "step", .number = (double)step};
        pm_journal_write(&observer->options->log, PM_JOURNAL_NOTICE, 1, &field,
                         "held after step %ld by %s", step, observer->options->gate);
    }
}

static void tell_health(void *context, const portmet_health_t *health) {
    const pm_observer *observer = context;
    if (pm_status_request_take()) {
        if (observer->options->log.json) {
            pm_health_table_log(&observer->options->log, observer->scene, health);
        } else {
            pm_health_table_print(stderr, observer->scene, health);
        }
    }
    pm_notify("WATCHDOG=1\nSTATUS=step %lld of %lld, %.3g steps/s",
              (long long)(health->step < 0 ? 0 : health->step), (long long)health->steps,
              health->rate);
}

static void warn(void *context, const char *text) {
    const pm_observer *observer = context;
    if (!observer->options->quiet) {
        pm_journal_write(&observer->options->log, PM_JOURNAL_WARNING, 0, NULL, "%s", text);
    }
}

static void put_record(void *context, pm_record *record) {
    const pm_observer *observer = context;
    pm_report_record(observer->report, record);
}

static pm_status flush(void *context) {
    pm_observer *observer = context;
    return observer->recording == NULL ? PM_OK
                                       : outlive(observer, pm_recording_flush(observer->recording));
}

static pm_status resume(void *context, long step) {
    pm_observer *observer = context;
    return observer->options->record == NULL
               ? PM_OK
               : outlive(observer, pm_recording_reopen(&observer->recording,
                                                       observer->options->record, observer->scene,
                                                       step / observer->scene->record_every + 1));
}

pm_lockstep_coordinator_options pm_observer_attach(pm_observer *observer, const pm_setup *setup) {
    pm_progress_init(&observer->progress, setup->scene->name, setup->scene->steps);
    observer->progress.enabled =
        observer->progress.enabled && !observer->options->quiet && !observer->options->log.json;
    return (pm_lockstep_coordinator_options){
        .steps = setup->scene->steps,
        .session = observer->options->session,
        .want_state = observer->options->record != NULL || setup->reference != NULL,
        .gate = observer->options->gate,
        .replay = setup->replay,
        .replayed = setup->replayed,
        .observer = {.context = observer,
                     .step = observe,
                     .pause = tell_pause,
                     .hold = tell_hold,
                     .health = tell_health,
                     .warn = warn,
                     .record = put_record,
                     .flush = flush,
                     .resume = resume},
    };
}

// Fails if the integrator promises to keep the energy and has not kept it on every step.
static pm_status check_promise(const pm_observer *observer, const pm_ledger *ledger) {
    return ledger->unbalanced == 0
               ? PM_OK
               : pm_fail(PM_ELAW,
                         "the energy was not kept on %ld of %ld steps, because %s has not "
                         "converged there: take a smaller dt or more substeps",
                         ledger->unbalanced, ledger->steps, observer->scene->integrator->name);
}

pm_status pm_observer_finish(pm_observer *observer, pm_status status, const pm_ledger *ledger,
                             const pm_pace *pace, const char *how) {
    pm_progress_finish(&observer->progress);
    pm_recording *recording = observer->recording;
    observer->recording = NULL;
    const pm_status closed = outlive(observer, pm_recording_close(recording));
    if (!observer->options->quiet && ledger->steps > 0) {
        pm_report_print(observer->report, ledger, how, pm_clock() - observer->started);
        pm_report_print_pace(observer->report, pace);
    }
    if (status != PM_OK || closed != PM_OK) {
        return status != PM_OK ? status : closed;
    }
    return check_promise(observer, ledger);
}

void pm_observer_close(pm_observer *observer) {
    pm_recording_close(observer->recording);
    pm_report_close(observer->report);
}
