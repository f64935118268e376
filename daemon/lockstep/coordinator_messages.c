// What a coordinator hears: hellos, of which it refuses some, commands, reports and requests. Only
// stores and answers.
#include "lockstep/coordinator.h"

#include <stdio.h>
#include <string.h>

static pm_remote_process *find_member(const pm_lockstep_coordinator *c, const char *name) {
    for (int i = 0; i < c->nremote; ++i) {
        if (strcmp(c->remote[i].name, name) == 0) {
            return &c->remote[i];
        }
    }
    return NULL;
}

// --- hellos ---

// A node that cannot take part ends a run that has not begun, and is sent away from one that has.
static pm_drop refuse(pm_lockstep_coordinator *c, const portmet_hello_t *hello, const char *reason,
                      bool late) {
    pm_coordinator_check(c, pm_identity_refuse(&c->endpoint.identity, hello->session,
                                               hello->instance, PM_ENET, reason));
    if (!late) {
        pm_coordinator_check(c, pm_fail(PM_ENET, "%s", reason));
    }
    return PM_KEEP;
}

// Without checkpoints nobody can take the place of the node whose initial state was reported: sends
// another instance of it away.
static bool is_second(pm_lockstep_coordinator *c, const pm_remote_process *m, int64_t session,
                      int64_t instance) {
    if (instance == m->instance) {
        return false;
    }
    char reason[256];
    snprintf(reason, sizeof reason,
             "node %s: the run goes on without it; only runs with --checkpoint take a node back",
             m->name);
    pm_coordinator_check(
        c, pm_identity_refuse(&c->endpoint.identity, session, instance, PM_ENET, reason));
    return true;
}

static pm_drop greet_node(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    char reason[512];
    pm_remote_process *m = find_member(c, hello->sender);
    if (m == NULL) {
        snprintf(reason, sizeof reason, "scene %s has no process %.64s",
                 c->endpoint.system->scene->name, hello->sender);
        return refuse(c, hello, reason, true);
    }
    const bool late = pm_report_window_has(&c->window_reports, 0, m->id) || c->completed >= 0;
    if (pm_identity_differs(&c->endpoint.identity, hello, reason, sizeof reason)) {
        return refuse(c, hello, reason, late);
    }
    if (late && c->checkpoint == NULL) {
        return is_second(c, m, hello->session, hello->instance) ? PM_KEEP : PM_DROP_REPEATED;
    }
    m->alive = true;
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
        // It has not joined, and need not wait for it.
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
    const bool first = c->completed >= 0 || pm_identity_precedes(own, hello->instance);
    if (first && pm_identity_rivals(own, hello)) {
        char reason[256];
        snprintf(reason, sizeof reason, "there is a coordinator of scene %s already",
                 c->endpoint.system->scene->name);
        pm_coordinator_check(
            c, pm_identity_refuse(own, hello->session, hello->instance, PM_ENET, reason));
    }
    return PM_KEEP;
}

// --- commands ---

// Its own are heard, too.
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

static void note_done(pm_remote_process *m, int64_t steps) {
    m->done = steps > m->done ? steps : m->done;
}

// Takes what is new: steps beyond the last complete one. The later ones of a report may have been
// granted by a coordinator that died.
static pm_drop accept_done(pm_remote_process *m) {
    pm_lockstep_coordinator *c = m->coordinator;
    const int64_t first = m->scratch.step;
    const int rows = pm_remote_process_rows(m);
    if (first < 0 || first > c->granted) {
        return PM_DROP_RANGE;
    }
    m->moved = m->moved || first != m->reported;
    m->reported = first;
    pm_drop drop = PM_DROP_REPEATED;
    for (int row = 0; row < rows; ++row) {
        note_done(m, first + row);
        pm_sample *sample = pm_report_window_wants(&c->window_reports, first + row, m->id);
        if (sample != NULL) {
            pm_remote_process_fill(m, row, sample);
            pm_report_window_take(&c->window_reports, first + row, m->id);
            drop = PM_KEEP;
        }
    }
    return drop;
}

static pm_drop accept_report(pm_remote_process *m) {
    pm_lockstep_coordinator *c = m->coordinator;
    const portmet_report_t *report = &m->scratch;
    if (report->session != c->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (!pm_report_window_has(&c->window_reports, 0, m->id) && c->completed < 0) {
        m->instance = report->instance;
    }
    if (c->checkpoint == NULL && is_second(c, m, report->session, report->instance)) {
        return PM_DROP_REPEATED;
    }
    m->alive = true;
    switch (report->kind) {
    case PORTMET_REPORT_T_DONE:
        return accept_done(m);
    case PORTMET_REPORT_T_FAILED:
        pm_coordinator_check(c, pm_fail(pm_endpoint_code(report->code), "node %s failed: %s",
                                        m->name, report->message));
        return PM_KEEP;
    case PORTMET_REPORT_T_BYE:
        m->left = c->phase == PM_COORDINATOR_CLOSING;
        return m->left ? PM_KEEP : PM_DROP_RANGE;
    default:
        return PM_DROP_RANGE;
    }
}

static void on_report(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_remote_process *m = context;
    const pm_drop drop = pm_remote_process_decode(m, data, size, m->coordinator->want_state);
    pm_endpoint_count(&m->coordinator->endpoint, drop == PM_KEEP ? accept_report(m) : drop);
}

// --- fluxes ---

// Who shows its state at a step has completed those before.
static pm_drop accept_flux(pm_remote_process *m) {
    const portmet_flux_t *flux = &m->shown;
    if (flux->session != m->coordinator->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (flux->round != 0 || flux->step < 0 || flux->step > m->coordinator->granted) {
        return PM_DROP_RANGE;
    }
    m->alive = true;
    m->moved = m->moved || flux->step > m->done;
    note_done(m, flux->step);
    return PM_KEEP;
}

static void on_flux(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_remote_process *m = context;
    const pm_drop drop = pm_flux_decode(&m->shown, data, size);
    pm_endpoint_count(&m->coordinator->endpoint, drop == PM_KEEP ? accept_flux(m) : drop);
}

// --- requests ---

static pm_drop accept_request(void *context, const portmet_request_t *request) {
    pm_lockstep_coordinator *c = context;
    if (request->session != c->endpoint.session) {
        return PM_DROP_SESSION;
    }
    pm_remote_process *m = find_member(c, request->sender);
    if (m != NULL) {
        const int64_t asked[4] = {request->instance, request->attempt, request->step,
                                  request->round};
        m->alive = true;
        m->moved = m->moved || memcmp(m->asked, asked, sizeof asked) != 0;
        memcpy(m->asked, asked, sizeof asked);
    }
    if (strcmp(request->channel, c->endpoint.tick_channel) == 0 && request->step < c->granted) {
        c->tick_wanted = true;
    }
    return PM_KEEP;
}

// --- opening ---

pm_status pm_coordinator_listen(pm_lockstep_coordinator *c, int64_t asked) {
    static const pm_handlers handlers = {accept_hello, accept_command, accept_request};
    PM_TRY(pm_endpoint_open(&c->endpoint, &handlers, c, "", asked, c->checkpoint != NULL));
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *m = &c->remote[i];
        PM_TRY(pm_transport_subscribe(c->endpoint.transport, m->channel, on_report, m));
        if (c->hears_fluxes && m->shown.nend > 0) {
            PM_TRY(pm_transport_subscribe(c->endpoint.transport, m->flux_channel, on_flux, m));
        }
        // Who asks a neighbour is alive.
        PM_TRY(pm_endpoint_overhear(&c->endpoint, m->address));
    }
    return PM_OK;
}
