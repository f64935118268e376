// Transitions of a coordinator's state machine that both messages and polls cause, and functions
// that tell its state. coordinator.h has the table of states.
#include "lockstep/coordinator.h"

void pm_coordinator_close_run(pm_lockstep_coordinator *c) {
    c->phase = PM_COORDINATOR_CLOSING;
    c->next = c->endpoint.now;
}

void pm_lockstep_coordinator_fail(pm_lockstep_coordinator *c, pm_status code, const char *message) {
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_endpoint_end(&c->endpoint, code, message);
        pm_coordinator_close_run(c);
    }
}

void pm_coordinator_check(pm_lockstep_coordinator *c, pm_status status) {
    if (status != PM_OK) {
        pm_lockstep_coordinator_fail(c, status, pm_error());
    }
}

static int64_t least(int64_t a, int64_t b) {
    return a < b ? a : b;
}

int64_t pm_coordinator_grant_limit(const pm_lockstep_coordinator *c, int64_t complete) {
    const int window = c->endpoint.system->scene->window;
    int64_t limit = least(complete + c->lookahead, c->endpoint.steps);
    limit = least(limit, c->gate.steps > complete ? c->gate.steps : complete);
    limit = least(limit, pm_pace_limit(&c->pace, c->endpoint.now));
    if (pm_live_inputs_awaited(&c->live) != NULL) {
        limit = least(limit, c->granted);
    }
    for (int i = 0; c->hears_fluxes && i < c->nremote; ++i) {
        const int64_t done = c->remote[i].done;
        limit = least(limit, (done > complete ? done : complete) + window);
    }
    return limit;
}

int64_t pm_coordinator_steps_shown(const pm_lockstep_coordinator *c) {
    int64_t shown = INT64_MAX;
    for (int i = 0; i < c->nremote; ++i) {
        shown = least(shown, c->remote[i].done);
    }
    return shown > c->completed ? shown : c->completed;
}

bool pm_coordinator_is_at_gate(const pm_lockstep_coordinator *c) {
    return c->granted >= c->gate.steps;
}

pm_status pm_coordinator_enter(pm_lockstep_coordinator *c, pm_sample *sample) {
    if (!c->sums) {
        return pm_ledger_book(&c->ledger, sample);
    }
    pm_tally *tally = pm_report_window_tally(&c->reports, sample->step);
    pm_tally_add_ports(tally, c->endpoint.system, sample, c->nbetween, c->between);
    return pm_ledger_enter(&c->ledger, sample, tally);
}

// --- questions ---

bool pm_lockstep_coordinator_finished(const pm_lockstep_coordinator *c) {
    return c->phase == PM_COORDINATOR_FINISHED;
}

pm_status pm_lockstep_coordinator_result(const pm_lockstep_coordinator *c) {
    return pm_endpoint_result(&c->endpoint);
}

const pm_pace *pm_lockstep_coordinator_pace(const pm_lockstep_coordinator *c) {
    return &c->pace;
}

const pm_ledger *pm_lockstep_coordinator_ledger(const pm_lockstep_coordinator *c) {
    return &c->ledger;
}

pm_transport *pm_lockstep_coordinator_transport(const pm_lockstep_coordinator *c) {
    return c->endpoint.transport;
}

const pm_drops *pm_lockstep_coordinator_drops(const pm_lockstep_coordinator *c) {
    return &c->endpoint.drops;
}
