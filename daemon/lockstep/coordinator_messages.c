// The messages that a coordinator handles: hellos, some of which it refuses, commands, reports,
// fluxes and requests. Handlers only store what a message says and note which answer it needs; the
// next poll acts on it. coordinator.h has the table of states.
#include "lockstep/coordinator.h"

#include <stdio.h>
#include <string.h>

static pm_remote_process *find_remote(const pm_lockstep_coordinator *c, const char *name) {
    for (int i = 0; i < c->nremote; ++i) {
        if (strcmp(c->remote[i].name, name) == 0) {
            return &c->remote[i];
        }
    }
    return NULL;
}

// --- hellos ---

// Answers the hello of a process with a command.
static void answer(pm_lockstep_coordinator *c, const portmet_hello_t *hello, int8_t kind,
                   pm_status code, const char *reason) {
    pm_coordinator_check(c, pm_identity_answer(&c->endpoint.identity, hello, c->endpoint.session,
                                               kind, code, reason));
}

// Refuses the sender of a hello. A node that does not fit ends a run that has not begun; a run that
// is under way (`late`) goes on without it.
static pm_drop refuse(pm_lockstep_coordinator *c, const portmet_hello_t *hello, const char *reason,
                      bool late) {
    answer(c, hello, PORTMET_COMMAND_T_REFUSE, PM_ENET, reason);
    if (!late) {
        pm_coordinator_check(c, pm_fail(PM_ENET, "%s", reason));
    }
    return PM_KEEP;
}

// Writes into `reason` [256] why a second instance of a process is refused. Without checkpoints no
// other instance can take the place of the one that has reported the initial state.
static void say_second(const pm_remote_process *remote, char *reason) {
    snprintf(reason, 256,
             "node %s: the run goes on without it; only runs with --checkpoint take a node back",
             remote->name);
}

// Notes that the next tick answers a hello. If there are too many, the sender repeats it.
static void answer_by_tick(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    int i = 0;
    while (i < c->nanswer && c->answer[i] != hello->nonce) {
        ++i;
    }
    if (i == c->nanswer && i < c->nremote) {
        c->answer[c->nanswer++] = hello->nonce;
    }
    c->tick_wanted = true;
}

static pm_drop greet_node(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    char reason[512];
    pm_remote_process *remote = find_remote(c, hello->sender);
    if (remote == NULL) {
        return PM_DROP_IMPLAUSIBLE; // no process has a channel for such a hello
    }
    const bool late = pm_report_window_has(&c->reports, 0, remote->id) || c->completed >= 0;
    if (pm_identity_mismatch(&c->endpoint.identity, hello, reason, sizeof reason)) {
        // An instance that has said otherwise before did not send this.
        return pm_remote_process_is_greeted(remote, hello->instance)
                   ? PM_DROP_CONFLICT
                   : refuse(c, hello, reason, late);
    }
    if (late && c->checkpoint == NULL && hello->instance != remote->instance) {
        say_second(remote, reason);
        return refuse(c, hello, reason, true);
    }
    pm_remote_process_greet(remote, hello->instance);
    remote->alive = true;
    answer_by_tick(c, hello);
    return PM_KEEP;
}

static pm_drop greet_coordinator(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    const pm_identity *own = &c->endpoint.identity;
    const bool first = c->completed >= 0 || pm_identity_is_older(own, hello->instance);
    if (first && pm_identity_is_rival(own, hello)) {
        char reason[256];
        snprintf(reason, sizeof reason, "there is a coordinator of scene %s already",
                 c->endpoint.system->scene->name);
        answer(c, hello, PORTMET_COMMAND_T_REFUSE, PM_ENET, reason);
    }
    return PM_KEEP;
}

// A process that joins or returns during the end of the run need not wait for a tick.
static pm_drop send_away(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    if (hello->sender[0] == 0 || c->phase != PM_COORDINATOR_CLOSING) {
        return PM_DROP_REPEATED;
    }
    answer(c, hello, c->endpoint.status != PM_OK ? PORTMET_COMMAND_T_REFUSE : PORTMET_COMMAND_T_END,
           c->endpoint.status, c->endpoint.message);
    return PM_KEEP;
}

// A process must name this coordinator: that shows that its hello is not one of an earlier run.
static pm_drop accept_hello(void *context, const portmet_hello_t *hello) {
    pm_lockstep_coordinator *c = context;
    const pm_identity *own = &c->endpoint.identity;
    if (hello->session != own->hello.session) {
        return PM_DROP_SESSION;
    }
    if (c->phase != PM_COORDINATOR_RUNNING) {
        return send_away(c, hello);
    }
    if (hello->sender[0] == 0) {
        return greet_coordinator(c, hello);
    }
    if (hello->coordinator != own->hello.instance) {
        c->hello_wanted = true;
        return PM_KEEP;
    }
    return greet_node(c, hello);
}

// --- commands ---

// Handles commands. A coordinator receives its own commands, too; it reacts only to a refusal that
// names it.
static pm_drop accept_command(void *context, const portmet_command_t *command) {
    pm_lockstep_coordinator *c = context;
    if (c->phase == PM_COORDINATOR_RUNNING && command->kind == PORTMET_COMMAND_T_REFUSE &&
        pm_identity_is_proven(&c->endpoint.identity, command)) {
        pm_endpoint_end(&c->endpoint, PM_ENET, command->reason);
        c->phase = PM_COORDINATOR_FINISHED;
    }
    return PM_KEEP;
}

// --- reports ---

static void note_done(pm_remote_process *remote, int64_t steps) {
    remote->done = steps > remote->done ? steps : remote->done;
}

// Takes the steps of a report that are still missing. Its first step must be granted; the later
// ones may have been granted by a coordinator that died since.
static pm_drop accept_done(pm_remote_process *remote) {
    pm_lockstep_coordinator *c = remote->coordinator;
    const int64_t first = remote->report.step;
    const int rows = pm_remote_process_rows(remote);
    if (first < 0 || first > c->endpoint.steps ||
        remote->report.time != pm_scene_time(remote->scene, 0, (long)first)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (first > c->granted) {
        return PM_DROP_RANGE;
    }
    remote->moved = remote->moved || first != remote->reported;
    remote->reported = first;
    pm_drop drop = PM_DROP_REPEATED;
    for (int row = 0; row < rows; ++row) {
        if (!pm_remote_process_agrees(remote, row, first + row)) {
            pm_coordinator_check(c, pm_fail(PM_ENET,
                                            "two reports of %s on step %lld contradict each other, "
                                            "so that one is forged: give the scene a key_file",
                                            remote->name, (long long)(first + row)));
            return PM_DROP_CONFLICT;
        }
        note_done(remote, first + row);
        pm_sample *sample = pm_report_window_missing(&c->reports, first + row, remote->id);
        if (sample != NULL) {
            pm_remote_process_fill(remote, row, sample);
            pm_remote_process_add_tally(remote, row,
                                        pm_report_window_tally(&c->reports, first + row));
            pm_report_window_mark(&c->reports, first + row, remote->id);
            // Processes may come one by one: the patience with the others begins anew.
            c->progressed = c->progressed || c->completed < 0;
            drop = PM_KEEP;
        }
    }
    if (drop == PM_KEEP) {
        pm_waiting_note_used(&c->endpoint.waiting);
    }
    return drop;
}

// True if a report may come from the instance that takes part in the run; without checkpoints there
// is only one. Another one that has said hello is refused.
static bool is_from_run(pm_remote_process *remote) {
    pm_lockstep_coordinator *c = remote->coordinator;
    const portmet_report_t *report = &remote->report;
    const bool greeted = pm_remote_process_is_greeted(remote, report->instance);
    if (!pm_report_window_has(&c->reports, 0, remote->id) && c->completed < 0 && greeted) {
        remote->instance = report->instance;
    }
    if (c->checkpoint != NULL || report->instance == remote->instance) {
        return true;
    }
    if (greeted) {
        char reason[256];
        say_second(remote, reason);
        pm_coordinator_check(c, pm_identity_refuse(&c->endpoint.identity, report->session,
                                                   report->instance, reason));
    }
    return false;
}

// A failure, or a BYE: only of a process that follows this coordinator, for it may be one of an
// earlier run. A process that leaves in the middle of the run was told to by somebody else.
static pm_drop accept_notice(pm_remote_process *remote) {
    pm_lockstep_coordinator *c = remote->coordinator;
    const portmet_report_t *report = &remote->report;
    const bool failed = report->kind == PORTMET_REPORT_T_FAILED;
    // Every process that fails says why.
    if ((!failed && report->kind != PORTMET_REPORT_T_BYE) || (failed && report->message[0] == 0) ||
        report->coordinator != c->endpoint.identity.hello.instance) {
        return PM_DROP_IMPLAUSIBLE;
    }
    const bool other = remote->instance != 0 && report->instance != remote->instance;
    if (c->checkpoint == NULL && other) {
        return PM_DROP_REPEATED; // a second instance of the process
    }
    if (failed) {
        pm_coordinator_check(c, pm_fail(pm_endpoint_code(report->code), "node %s failed: %s",
                                        remote->name, report->message));
        return PM_KEEP;
    }
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_coordinator_check(c, pm_fail(PM_ENET,
                                        "node %s left the run, because a command was forged: give "
                                        "the scene a key_file",
                                        remote->name));
    }
    remote->left = true;
    return PM_KEEP;
}

static pm_drop accept_report(pm_remote_process *remote) {
    pm_lockstep_coordinator *c = remote->coordinator;
    const portmet_report_t *report = &remote->report;
    if (report->session != c->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (report->digest != (int64_t)c->endpoint.system->digest) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (report->kind == PORTMET_REPORT_T_DONE && !is_from_run(remote)) {
        return PM_DROP_REPEATED;
    }
    if (report->kind != PORTMET_REPORT_T_DONE) {
        return accept_notice(remote);
    }
    remote->alive = true;
    return accept_done(remote);
}

static void on_report(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_remote_process *remote = context;
    const pm_drop drop =
        pm_remote_process_decode(remote, data, size, remote->coordinator->want_state);
    pm_endpoint_count(&remote->coordinator->endpoint,
                      drop == PM_KEEP ? accept_report(remote) : drop);
}

// --- fluxes ---

// A process that publishes a flux of step n has completed n steps.
static pm_drop accept_flux(pm_remote_process *remote) {
    const portmet_flux_t *flux = &remote->flux;
    if (flux->session != remote->coordinator->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (flux->round != 0 || flux->step < 0 ||
        flux->time != pm_scene_time(remote->scene, 0, (long)flux->step)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (flux->step > remote->coordinator->granted) {
        return PM_DROP_RANGE;
    }
    remote->alive = true;
    remote->moved = remote->moved || flux->step > remote->done;
    note_done(remote, flux->step);
    return PM_KEEP;
}

static void on_flux(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_remote_process *remote = context;
    const pm_drop drop = pm_flux_decode(&remote->flux, data, size);
    pm_endpoint_count(&remote->coordinator->endpoint, drop == PM_KEEP ? accept_flux(remote) : drop);
}

// --- requests ---

static pm_drop accept_request(void *context, const portmet_request_t *request) {
    pm_lockstep_coordinator *c = context;
    if (request->session != c->endpoint.session) {
        return PM_DROP_SESSION;
    }
    pm_remote_process *remote = find_remote(c, request->sender);
    if (remote != NULL) {
        const int64_t asked[4] = {request->instance, request->attempt, request->step,
                                  request->round};
        remote->alive = true;
        remote->moved = remote->moved || memcmp(remote->asked, asked, sizeof asked) != 0;
        memcpy(remote->asked, asked, sizeof asked);
    }
    if (strcmp(request->channel, c->endpoint.tick_channel) == 0 && request->step < c->granted) {
        c->tick_wanted = true;
    }
    return PM_KEEP;
}

// --- vitals ---

static void on_vitals(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_coordinator *c = context;
    const pm_drop drop = pm_health_take(&c->health, data, size, c->endpoint.now);
    if (drop == PM_KEEP) {
        // A process that waits among many others asks rarely.
        c->remote[c->health.vitals.process].alive = true;
    }
    pm_endpoint_count(&c->endpoint, drop);
}

// --- opening ---

pm_status pm_coordinator_listen(pm_lockstep_coordinator *c, int64_t session) {
    static const pm_handlers handlers = {accept_hello, accept_command, accept_request};
    PM_TRY(pm_endpoint_open(&c->endpoint, &handlers, c, "", session, c->checkpoint != NULL));
    PM_TRY(pm_transport_subscribe(c->endpoint.transport, c->health.vitals_channel, on_vitals, c));
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *remote = &c->remote[i];
        PM_TRY(pm_transport_subscribe(c->endpoint.transport, remote->channel, on_report, remote));
        if (c->hears_fluxes && remote->flux.nend > 0) {
            PM_TRY(pm_transport_subscribe(c->endpoint.transport, remote->flux_channel, on_flux,
                                          remote));
        }
        // A request to a neighbour shows that its sender is alive.
        PM_TRY(pm_endpoint_listen_to(&c->endpoint, remote->name, remote->address));
    }
    return PM_OK;
}
