// The messages of others than the coordinator that a node handles, and the hellos of coordinators:
// hellos, some of which it refuses, fluxes, and requests, which it answers from its resend buffers
// or by rolling back. node.h has the table of states.
#include "lockstep/node.h"

#include <stdio.h>
#include <string.h>

// --- hellos ---

// True if another node of this name was started later, and is to be refused for `reason` [256].
static bool is_to_refuse(const pm_lockstep_node *node, int64_t instance, char *reason) {
    const bool here = node->phase == PM_NODE_RUNNING || node->phase == PM_NODE_HELLO;
    snprintf(reason, 256, "there is a node %s of scene %s already", node->name,
             node->endpoint.system->scene->name);
    return here && pm_identity_is_older(&node->endpoint.identity, instance);
}

// A coordinator that this node does not know is asked what it has to say.
static pm_drop hear_coordinator(pm_lockstep_node *node, const portmet_hello_t *hello) {
    if (hello->session != node->endpoint.identity.hello.session) {
        return PM_DROP_SESSION;
    }
    const int64_t known = node->phase == PM_NODE_HELLO ? node->endpoint.identity.hello.coordinator
                                                       : node->coordinator;
    const bool here = node->phase == PM_NODE_RUNNING || node->phase == PM_NODE_HELLO;
    if (here && hello->instance != known) {
        pm_node_ask(node, hello->instance);
    }
    return PM_KEEP;
}

static pm_drop accept_hello(void *context, const portmet_hello_t *hello) {
    pm_lockstep_node *node = context;
    const pm_identity *own = &node->endpoint.identity;
    char reason[256];
    if (hello->sender[0] == 0) {
        return hear_coordinator(node, hello);
    }
    if (pm_identity_is_rival(own, hello) && is_to_refuse(node, hello->instance, reason)) {
        pm_node_check(node, pm_identity_answer(own, hello, hello->session, PORTMET_COMMAND_T_REFUSE,
                                               PM_ENET, reason));
    }
    return PM_KEEP;
}

// --- requests ---

// Returns the link to the neighbour of this name, or NULL.
static pm_flux_link *find_link(const pm_lockstep_node *node, const char *name) {
    for (int i = 0; i < node->subsystems.nlink; ++i) {
        if (strcmp(node->subsystems.link[i].neighbour, name) == 0) {
            return &node->subsystems.link[i];
        }
    }
    return NULL;
}

// Handles a request of the age `age` for a message of `step` that is no longer kept. Its sender was
// restarted or has rolled back, and this node rolls back, too. Without checkpoints nobody misses
// such a message, unless somebody believed a forged one; the run then cannot continue.
static pm_status recompute(pm_lockstep_node *node, const portmet_request_t *request,
                           pm_request_age age, int64_t step) {
    if (age == PM_REQUEST_OLD || node->phase != PM_NODE_RUNNING) {
        return PM_OK;
    }
    if (node->checkpoints.path != NULL) {
        return pm_node_roll_back(node, step);
    }
    const bool stuck = pm_waiting_is_long(&node->endpoint.waiting);
    return age == PM_REQUEST_INSISTENT && stuck
               ? pm_fail(PM_ENET,
                         "%s lacks a message on %s of step %lld, which is not kept any more, "
                         "because a message was forged: give the scene a key_file",
                         request->sender[0] == 0 ? "the coordinator" : request->sender,
                         request->channel, (long long)request->step)
               : PM_OK;
}

// Publishes a report again.
static pm_status answer_report(pm_lockstep_node *node, const portmet_request_t *request) {
    const int64_t step = request->step;
    bool kept;
    PM_TRY(pm_reporter_repeat(&node->reporter, step, &kept));
    if (kept) {
        pm_vitals_answer(&node->vitals, pm_node_peer(node, NULL));
    }
    if (request->sender[0] != 0) {
        return PM_OK;
    }
    const pm_request_age age =
        pm_request_filter_accept(&node->coordinator_requests, request, step, node->endpoint.now);
    const bool missed = !kept && step <= node->step - node->reporter.rows;
    return missed ? recompute(node, request, age, step > 0 ? step - 1 : 0) : PM_OK;
}

// Publishes a flux again.
static pm_status answer_flux(pm_lockstep_node *node, const portmet_request_t *request) {
    const int64_t key = request->step * node->rounds + request->round;
    pm_flux_link *link = find_link(node, request->sender);
    const pm_request_age age =
        link == NULL ? PM_REQUEST_OLD
                     : pm_request_filter_accept(&link->requests, request, key, node->endpoint.now);
    if (pm_resend_buffer_keeps(&node->subsystems.sent, key)) {
        pm_vitals_answer(&node->vitals, pm_node_peer(node, link));
        return pm_resend_buffer_repeat(&node->subsystems.sent, node->endpoint.transport, key);
    }
    return key < pm_node_round_key(node) ? recompute(node, request, age, request->step) : PM_OK;
}

static pm_drop accept_request(void *context, const portmet_request_t *request) {
    pm_lockstep_node *node = context;
    if (request->session != node->endpoint.session || node->endpoint.session == 0) {
        return PM_DROP_SESSION;
    }
    const bool sane = request->step >= 0 && request->step <= PM_STEPS_MAX && request->round >= 0 &&
                      request->round < node->rounds;
    if (!sane) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (request->sender[0] == 0) {
        if (request->instance != node->coordinator) {
            pm_node_ask(node, request->instance);
            return PM_DROP_RANGE;
        }
        node->coordinator_alive = true;
    }
    char reason[256];
    if (strcmp(request->sender, node->name) == 0 && is_to_refuse(node, request->instance, reason)) {
        pm_node_check(node, pm_identity_refuse(&node->endpoint.identity, request->session,
                                               request->instance, reason));
    }
    if (strcmp(request->channel, node->reporter.sent.channel) == 0) {
        pm_node_check(node, answer_report(node, request));
    }
    if (strcmp(request->channel, node->subsystems.sent.channel) == 0) {
        pm_node_check(node, answer_flux(node, request));
    }
    return PM_KEEP;
}

// --- fluxes ---

static pm_drop accept_flux(pm_flux_link *link) {
    pm_lockstep_node *node = link->node;
    const portmet_flux_t *flux = &link->scratch;
    if (node->phase != PM_NODE_RUNNING || flux->session != node->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (flux->round < 0 || flux->round >= node->rounds || flux->step < 0 ||
        flux->step > node->endpoint.steps || flux->time != pm_node_time(node, flux->step)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    const pm_drop drop =
        pm_flux_link_keep(link, flux->step * node->rounds + flux->round, pm_node_round_key(node),
                          (node->step + 1) * node->rounds);
    if (drop == PM_KEEP) {
        pm_node_note_used(node, link);
    }
    if (drop == PM_DROP_CONFLICT) {
        pm_node_check(node, pm_fail(PM_ENET,
                                    "two fluxes of %s for round %d of step %lld contradict each "
                                    "other, so that one is forged: give the scene a key_file",
                                    link->neighbour, flux->round, (long long)flux->step));
    }
    return drop;
}

static void on_flux(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_flux_link *link = context;
    const pm_drop drop = pm_flux_decode(&link->scratch, data, size);
    pm_endpoint_count(&link->node->endpoint, drop == PM_KEEP ? accept_flux(link) : drop);
}

// --- opening ---

pm_status pm_node_listen(pm_lockstep_node *node, int64_t session) {
    static const pm_handlers handlers = {accept_hello, pm_node_accept_command, accept_request};
    pm_transport *transport = node->endpoint.transport;
    PM_TRY(pm_endpoint_open(&node->endpoint, &handlers, node, node->name, session,
                            node->checkpoints.path != NULL));
    PM_TRY(pm_transport_subscribe(transport, node->endpoint.tick_channel, pm_node_on_tick, node));
    for (int i = 0; i < node->subsystems.nlink; ++i) {
        pm_flux_link *link = &node->subsystems.link[i];
        link->node = node;
        PM_TRY(pm_transport_subscribe(transport, link->channel, on_flux, link));
    }
    return PM_OK;
}
