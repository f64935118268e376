// Transitions of a node's state machine that messages, steps and polls cause, and functions that
// tell its state. node.h has the table of states.
#include <math.h>

#include "lockstep/node.h"

#define ASK_INTERVAL 0.01 // s between two questions of a node that takes part in a run

void pm_node_enter(pm_lockstep_node *node, pm_node_phase next) {
    node->phase = next;
    node->until = node->next = 0;
}

void pm_lockstep_node_fail(pm_lockstep_node *node, pm_status code, const char *message) {
    if (node->phase == PM_NODE_HELLO || node->phase == PM_NODE_RUNNING) {
        pm_endpoint_end(&node->endpoint, code, message);
        pm_node_enter(node, PM_NODE_FAILING);
    }
}

void pm_node_check(pm_lockstep_node *node, pm_status status) {
    if (status != PM_OK) {
        pm_lockstep_node_fail(node, status, pm_error());
    }
}

void pm_node_ask(pm_lockstep_node *node, int64_t coordinator) {
    if (node->phase == PM_NODE_HELLO) {
        node->endpoint.identity.hello.coordinator = coordinator;
        node->next = node->endpoint.now; // the next poll says hello
        return;
    }
    // A question to a coordinator that this node does not follow yet is never given up for one to
    // its own, which may be dead.
    if (node->to_ask == 0 || coordinator != node->coordinator) {
        node->to_ask = coordinator;
    }
    pm_node_publish_question(node);
}

double pm_node_publish_question(pm_lockstep_node *node) {
    const double now = node->endpoint.now;
    if (node->to_ask == 0 || node->phase != PM_NODE_RUNNING) {
        return INFINITY;
    }
    if (now < node->asked_at + ASK_INTERVAL) {
        return node->asked_at + ASK_INTERVAL;
    }
    node->asked_at = now;
    node->endpoint.identity.hello.coordinator = node->to_ask;
    node->to_ask = 0;
    pm_node_check(node, pm_identity_publish_hello(&node->endpoint.identity));
    return INFINITY;
}

int pm_node_peer(const pm_lockstep_node *node, const pm_flux_link *link) {
    return link == NULL ? node->subsystems.nlink : (int)(link - node->subsystems.link);
}

void pm_node_note_used(pm_lockstep_node *node, const pm_flux_link *link) {
    pm_vitals_use(&node->vitals, pm_node_peer(node, link));
    pm_waiting_note_used(&node->endpoint.waiting);
}

// --- questions ---

bool pm_lockstep_node_finished(const pm_lockstep_node *node) {
    return node->phase == PM_NODE_FINISHED;
}

bool pm_lockstep_node_leaving(const pm_lockstep_node *node) {
    return node->phase == PM_NODE_FINISHED || node->phase == PM_NODE_LEAVING;
}

pm_status pm_lockstep_node_result(const pm_lockstep_node *node) {
    return pm_endpoint_result(&node->endpoint);
}

pm_transport *pm_lockstep_node_transport(const pm_lockstep_node *node) {
    return node->endpoint.transport;
}

const pm_drops *pm_lockstep_node_drops(const pm_lockstep_node *node) {
    return &node->endpoint.drops;
}
