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

// Refuses the sender of a hello. This ends a run that has not begun; a run that is under way
// (`late`) continues without the sender.
static pm_drop refuse(pm_lockstep_coordinator *c, const portmet_hello_t *hello, const char *reason,
                      bool late) {
    pm_coordinator_check(c, pm_identity_refuse(&c->endpoint.identity, hello->session,
                                               hello->instance, PM_ENET, reason));
    if (!late) {
        pm_coordinator_check(c, pm_fail(PM_ENET, "%s", reason));
    }
    return PM_KEEP;
}

// Refuses a second instance of a process. Without checkpoints no other instance can take the place
// of the one that has reported the initial state.
static bool is_second(pm_lockstep_coordinator *c, const pm_remote_process *remote, int64_t session,
                      int64_t instance) {
    if (instance == remote->instance) {
        return false;
    }
    char reason[256];
    snprintf(reason, sizeof reason,
             "node %s: the run goes on without it; only runs with --checkpoint take a node back",
             remote->name);
    pm_coordinator_check(
        c, pm_identity_refuse(&c->endpoint.identity, session, instance, PM_ENET, reason));
    return true;
}

static pm_drop greet_node(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    char reason[512];
    pm_remote_process *remote = find_remote(c, hello->sender);
    if (remote == NULL) {
        snprintf(reason, sizeof reason, "scene %s has no process %.64s",
                 c->endpoint.system->scene->name, hello->sender);
        return refuse(c, hello, reason, true);
    }
    const bool late = pm_report_window_has(&c->reports, 0, remote->id) || c->completed >= 0;
    if (pm_identity_mismatch(&c->endpoint.identity, hello, reason, sizeof reason)) {
        return refuse(c, hello, reason, late);
    }
    if (late && c->checkpoint == NULL) {
        return is_second(c, remote, hello->session, hello->instance) ? PM_KEEP : PM_DROP_REPEATED;
    }
    remote->alive = true;
    c->tick_wanted = true;
    return PM_KEEP;
}

static pm_drop accept_hello(void *context, const portmet_hello_t *hello) {
    pm_lockstep_coordinator *c = context;
    const pm_identity *own = &c->endpoint.identity;
    if (hello->session != own->hello.session) {
        return PM_DROP_SESSION;
    }
    if (c->phase == PM_COORDINATOR_CLOSING && c->endpoint.status != PM_OK &&
        hello->sender[0] != 0) {
        // The run has failed before this process could join: it need not wait for a tick.
        pm_coordinator_check(c, pm_identity_refuse(own, hello->session, hello->instance,
                                                   c->endpoint.status, c->endpoint.message));
        return PM_KEEP;
    }
    if (c->phase != PM_COORDINATOR_RUNNING) {
        return PM_DROP_REPEATED;
    }
    if (hello->sender[0] != 0) {
        return greet_node(c, hello);
    }
    const bool first = c->completed >= 0 || pm_identity_is_older(own, hello->instance);
    if (first && pm_identity_is_rival(own, hello)) {
        char reason[256];
        snprintf(reason, sizeof reason, "there is a coordinator of scene %s already",
                 c->endpoint.system->scene->name);
        pm_coordinator_check(
            c, pm_identity_refuse(own, hello->session, hello->instance, PM_ENET, reason));
    }
    return PM_KEEP;
}

// --- commands ---

// Handles commands. A coordinator receives its own commands, too; it reacts only to a refusal that
// names it.
static pm_drop accept_command(void *context, const portmet_command_t *command) {
    pm_lockstep_coordinator *c = context;
    if (c->phase == PM_COORDINATOR_RUNNING &&
        pm_identity_is_refused(&c->endpoint.identity, c->endpoint.session, command)) {
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
    if (first < 0 || first > c->granted) {
        return PM_DROP_RANGE;
    }
    remote->moved = remote->moved || first != remote->reported;
    remote->reported = first;
    pm_drop drop = PM_DROP_REPEATED;
    for (int row = 0; row < rows; ++row) {
        note_done(remote, first + row);
        pm_sample *sample = pm_report_window_missing(&c->reports, first + row, remote->id);
        if (sample != NULL) {
            pm_remote_process_fill(remote, row, sample);
            pm_report_window_mark(&c->reports, first + row, remote->id);
            drop = PM_KEEP;
        }
    }
    return drop;
}

static pm_drop accept_report(pm_remote_process *remote) {
    pm_lockstep_coordinator *c = remote->coordinator;
    const portmet_report_t *report = &remote->report;
    if (report->session != c->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (!pm_report_window_has(&c->reports, 0, remote->id) && c->completed < 0) {
        remote->instance = report->instance;
    }
    if (c->checkpoint == NULL && is_second(c, remote, report->session, report->instance)) {
        return PM_DROP_REPEATED;
    }
    remote->alive = true;
    switch (report->kind) {
    case PORTMET_REPORT_T_DONE:
        return accept_done(remote);
    case PORTMET_REPORT_T_FAILED:
        pm_coordinator_check(c, pm_fail(pm_endpoint_code(report->code), "node %s failed: %s",
                                        remote->name, report->message));
        return PM_KEEP;
    case PORTMET_REPORT_T_BYE:
        remote->left = c->phase == PM_COORDINATOR_CLOSING;
        return remote->left ? PM_KEEP : PM_DROP_RANGE;
    default:
        return PM_DROP_RANGE;
    }
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
    if (flux->round != 0 || flux->step < 0 || flux->step > remote->coordinator->granted) {
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

// --- opening ---

pm_status pm_coordinator_listen(pm_lockstep_coordinator *c, int64_t session) {
    static const pm_handlers handlers = {accept_hello, accept_command, accept_request};
    PM_TRY(pm_endpoint_open(&c->endpoint, &handlers, c, "", session, c->checkpoint != NULL));
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *remote = &c->remote[i];
        PM_TRY(pm_transport_subscribe(c->endpoint.transport, remote->channel, on_report, remote));
        if (c->hears_fluxes && remote->flux.nend > 0) {
            PM_TRY(pm_transport_subscribe(c->endpoint.transport, remote->flux_channel, on_flux,
                                          remote));
        }
        // A request to a neighbour shows that its sender is alive.
        PM_TRY(pm_endpoint_listen_to(&c->endpoint, remote->address));
    }
    return PM_OK;
}
