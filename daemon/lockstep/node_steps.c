// The steps of a process: rounds, reports, and the way back to a checkpoint.
#include "lockstep/node.h"

// Steps of one poll at most: then messages and the stop flag are looked at.
#define STEPS_AT_ONCE 16

#define REPORT_INTERVAL 0.02 // s between two reports at most, while steps are made

static double time_of(const pm_lockstep_node *node, int64_t step) {
    return node->t0 + (double)step * node->endpoint.system->scene->dt;
}

int64_t pm_node_key(const pm_lockstep_node *node) {
    return node->step * node->rounds + node->round;
}

bool pm_node_is_granted(const pm_lockstep_node *node) {
    return node->step < node->granted;
}

// What a state shows does not depend on the grant, unless that chooses the substeps: it is sent
// ahead, so that the neighbours have it when they are granted the step; the first one when all are
// there to hear it.
static bool may_show_ahead(const pm_lockstep_node *node) {
    return node->endpoint.system->scene->tolerance == 0 && node->granted > 0 &&
           node->step == node->granted && node->step < node->endpoint.steps;
}

bool pm_node_may_start(const pm_lockstep_node *node) {
    return !node->started && (pm_node_is_granted(node) || may_show_ahead(node));
}

// The books of the step just completed; published when enough of them are gathered, or for long
// enough, or the next grant waits for them.
static pm_status report(pm_lockstep_node *node) {
    PM_TRY(pm_reporter_done(&node->reporter, node->endpoint.session, node->step,
                            time_of(node, node->step), &node->group, node->want_state));
    const bool awaited = !pm_node_is_granted(node) && !(node->fluxes_tell && may_show_ahead(node));
    if (!awaited && node->endpoint.now < node->report_at) {
        return PM_OK;
    }
    node->report_at = node->endpoint.now + REPORT_INTERVAL;
    return pm_reporter_flush(&node->reporter);
}

pm_status pm_node_go_back(pm_lockstep_node *node, int64_t step) {
    // What was done up to now stays true.
    PM_TRY(pm_reporter_flush(&node->reporter));
    const int64_t found = pm_checkpoint_ring_go_back(&node->history, step, &node->group);
    if (found < 0) {
        return PM_OK;
    }
    node->endpoint.attempt += 1;
    node->step = found;
    node->round = 0;
    node->started = false;
    node->progressed = true;
    return found == 0 ? report(node) : PM_OK;
}

pm_status pm_node_begin(pm_lockstep_node *node) {
    if (node->history.path == NULL) {
        return report(node);
    }
    PM_TRY(pm_checkpoint_ring_begin(&node->history, node->endpoint.session));
    return pm_node_go_back(node, INT64_MAX);
}

static pm_status start_round(pm_lockstep_node *node) {
    if (node->round == 0) {
        pm_process_subsystems_set_substeps(&node->group, node->substeps);
    }
    const portmet_flux_t head = {
        .session = node->endpoint.session,
        .step = node->step,
        .round = node->round,
        .time = time_of(node, node->step),
    };
    PM_TRY(pm_process_subsystems_start_round(&node->group, node->endpoint.transport,
                                             pm_node_key(node), &head));
    node->started = true;
    node->progressed = true;
    return PM_OK;
}

static pm_status finish_round(pm_lockstep_node *node) {
    pm_process_subsystems_advance(&node->group);
    node->started = false;
    node->round += 1;
    if (node->round < pm_process_subsystems_rounds(&node->group)) {
        return PM_OK;
    }
    PM_TRY(pm_process_subsystems_end_step(&node->group));
    node->step += 1;
    node->round = 0;
    PM_TRY(
        pm_checkpoint_ring_note(&node->history, node->endpoint.session, node->step, &node->group));
    return report(node);
}

pm_status pm_node_compute(pm_lockstep_node *node) {
    const int64_t end = node->step + STEPS_AT_ONCE;
    while (node->step < end && (node->started || pm_node_may_start(node))) {
        if (!node->started) {
            PM_TRY(start_round(node));
        }
        if (!pm_node_is_granted(node)) {
            return PM_OK;
        }
        bool used;
        const bool coupled = pm_process_subsystems_couple(&node->group, pm_node_key(node), &used);
        node->progressed = node->progressed || used;
        if (!coupled) {
            return PM_OK;
        }
        PM_TRY(finish_round(node));
    }
    return PM_OK;
}
