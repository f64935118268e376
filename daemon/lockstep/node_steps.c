// The steps of a process: rounds of exposing, publishing and coupling (sim/subsystem.h), the report
// after each step, and the return to a checkpoint.
#include <math.h>

#include "lockstep/node.h"

// The most steps of one poll. The loop then handles messages and reads the stop flag.
#define STEPS_AT_ONCE 16

// The time between two reports at most, while steps are computed: the larger of these two. Among
// many processes a report costs as much as a flux, which every step has anyway.
#define REPORT_INTERVAL 0.02 // s
#define REPORT_PAIR 0.000004 // s for each pair of a sender and a receiver

double pm_node_time(const pm_lockstep_node *node, int64_t step) {
    return pm_scene_time(node->endpoint.system->scene, node->t0, step);
}

int64_t pm_node_round_key(const pm_lockstep_node *node) {
    return node->step * node->rounds + node->round;
}

static bool is_granted(const pm_lockstep_node *node) {
    return node->step < node->granted;
}

// Returns true if the flux of the next step's first round may be published before the step is
// granted, so that the neighbours have it when they are granted the step. This is impossible if the
// tick chooses the substeps. The flux of step 0 waits for the first grant, which shows that every
// process listens.
static bool may_publish_ahead(const pm_lockstep_node *node) {
    return node->endpoint.system->scene->tolerance == 0 && node->granted > 0 &&
           node->step == node->granted && node->step < node->endpoint.steps;
}

bool pm_node_may_start(const pm_lockstep_node *node) {
    return !node->started && (is_granted(node) || may_publish_ahead(node));
}

// Adds the step just completed to the report, which is published when it is full, when the last one
// is REPORT_INTERVAL old, or when the next grant waits for it.
static pm_status report(pm_lockstep_node *node) {
    const portmet_report_t head = {
        .session = node->endpoint.session,
        .coordinator = node->coordinator,
        .step = node->step,
        .time = pm_node_time(node, node->step),
    };
    PM_TRY(pm_reporter_add_step(&node->reporter, &head, &node->subsystems, node->want_state));
    const bool awaited =
        !is_granted(node) && !(node->fluxes_show_progress && may_publish_ahead(node));
    if (!awaited && node->endpoint.now < node->report_at) {
        return PM_OK;
    }
    const double n = node->endpoint.system->scene->nprocess;
    node->report_at = node->endpoint.now + fmax(REPORT_INTERVAL, REPORT_PAIR * n * n);
    return pm_reporter_flush(&node->reporter);
}

pm_status pm_node_roll_back(pm_lockstep_node *node, int64_t step) {
    // The steps completed so far stay valid: report them.
    PM_TRY(pm_reporter_flush(&node->reporter));
    const int64_t found = pm_checkpoint_ring_roll_back(&node->checkpoints, step, &node->subsystems);
    if (found < 0) {
        return PM_OK;
    }
    node->endpoint.attempt += 1;
    node->step = found;
    node->furthest = found > node->furthest ? found : node->furthest;
    node->round = 0;
    node->started = false;
    node->progressed = true;
    return found == 0 ? report(node) : PM_OK;
}

pm_status pm_node_start_run(pm_lockstep_node *node) {
    if (node->checkpoints.path == NULL) {
        return report(node);
    }
    PM_TRY(pm_checkpoint_ring_load_or_create(&node->checkpoints, node->endpoint.session));
    return pm_node_roll_back(node, INT64_MAX);
}

static pm_status start_round(pm_lockstep_node *node) {
    if (node->round == 0) {
        pm_local_subsystems_set_substeps(node->subsystems.local, node->substeps);
    }
    const portmet_flux_t head = {
        .session = node->endpoint.session,
        .step = node->step,
        .round = node->round,
        .time = pm_node_time(node, node->step),
    };
    PM_TRY(pm_process_subsystems_start_round(&node->subsystems, node->endpoint.transport,
                                             pm_node_round_key(node), &head));
    node->started = true;
    node->progressed = true;
    return PM_OK;
}

static pm_status finish_round(pm_lockstep_node *node) {
    bool complete;
    PM_TRY(pm_process_subsystems_end_round(&node->subsystems, &complete));
    node->started = false;
    node->round += 1;
    if (!complete) {
        return PM_OK;
    }
    node->step += 1;
    node->round = 0;
    node->furthest = node->step > node->furthest ? node->step : node->furthest;
    PM_TRY(pm_checkpoint_ring_save_due(&node->checkpoints, node->endpoint.session, node->step,
                                       &node->subsystems));
    return report(node);
}

pm_status pm_node_compute(pm_lockstep_node *node) {
    const int64_t end = node->step + STEPS_AT_ONCE;
    while (node->step < end && (node->started || pm_node_may_start(node))) {
        if (!node->started) {
            PM_TRY(start_round(node));
        }
        if (!is_granted(node)) {
            return PM_OK;
        }
        bool used;
        const bool coupled =
            pm_process_subsystems_couple(&node->subsystems, pm_node_round_key(node), &used);
        node->progressed = node->progressed || used;
        if (!coupled) {
            return PM_OK;
        }
        PM_TRY(finish_round(node));
    }
    return PM_OK;
}
