// The messages that a node handles: ticks, commands, hellos, some of which it refuses, fluxes, and
// requests, which it answers from its resend buffers or by rolling back. node.h has the table of
// states.
#include "lockstep/node.h"

#include <stdio.h>
#include <string.h>

#include "sim/step_controller.h"

// --- ticks ---

// Returns true if a tick is of a run that this node may join: of the session that it was started
// for, with the same digest, and either no step is granted yet or this node has a checkpoint of the
// session.
static bool may_join(pm_lockstep_node *node, const portmet_tick_t *tick) {
    const int64_t asked = node->endpoint.identity.hello.session;
    const bool wanted = asked == 0 ? tick->open : tick->session == asked;
    bool known = false;
    if (!wanted || tick->session <= 0 || tick->digest != (int64_t)node->endpoint.system->digest) {
        return false;
    }
    if (tick->granted > 0) {
        pm_node_check(node,
                      pm_checkpoint_ring_has_session(&node->checkpoints, tick->session, &known));
        node->late = !known;
    }
    return tick->granted == 0 || known;
}

static void join(pm_lockstep_node *node, const portmet_tick_t *tick) {
    const double dt = node->endpoint.system->scene->dt;
    node->endpoint.session = tick->session;
    node->t0 = tick->t0;
    node->progressed = true;
    pm_node_enter(node, PM_NODE_RUNNING);
    if (tick->granted > 0) {
        // The hello reveals this node to another one of the same name, which may have missed its
        // earlier hellos.
        pm_node_check(node, pm_identity_publish_hello(&node->endpoint.identity));
    }
    if (tick->dt != dt) {
        pm_node_check(node,
                      pm_fail(PM_ENET,
                              "the coordinator's scene steps by %.17g s, this node's by %.17g s",
                              tick->dt, dt));
    }
}

static bool is_sane(const pm_lockstep_node *node, const portmet_tick_t *tick) {
    const bool chosen = node->endpoint.system->scene->tolerance > 0;
    return tick->steps >= 0 && tick->steps <= PM_STEPS_MAX && tick->granted >= 0 &&
           tick->granted <= tick->steps &&
           (!chosen || (tick->substeps >= 1 && tick->substeps <= PM_MOST_SUBSTEPS));
}

// Adopts the content of a tick. A tick of an earlier coordinator, or with fewer granted steps than
// known, is out of date and ignored.
static pm_drop accept_tick(pm_lockstep_node *node, const portmet_tick_t *tick) {
    const bool joins = node->phase == PM_NODE_HELLO && may_join(node, tick);
    if (!joins && (node->endpoint.session == 0 || tick->session != node->endpoint.session)) {
        return PM_DROP_SESSION;
    }
    if (!is_sane(node, tick)) {
        return PM_DROP_RANGE;
    }
    if (joins) {
        join(node, tick);
    }
    node->coordinator_alive = true;
    if (tick->instance < node->coordinator ||
        (tick->instance == node->coordinator && tick->granted < node->granted)) {
        return PM_DROP_REPEATED;
    }
    const pm_scene *scene = node->endpoint.system->scene;
    node->coordinator = tick->instance;
    node->endpoint.steps = tick->steps;
    node->granted = tick->granted;
    node->substeps = scene->tolerance > 0 ? tick->substeps : scene->substeps;
    node->want_state = tick->want_state != 0;
    if (joins && node->phase == PM_NODE_RUNNING) {
        pm_node_check(node, pm_node_start_run(node));
    }
    return PM_KEEP;
}

static void on_tick(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_node *node = context;
    portmet_tick_t tick;
    const pm_drop drop = pm_tick_decode(&tick, data, size);
    pm_endpoint_count(&node->endpoint, drop == PM_KEEP ? accept_tick(node, &tick) : drop);
}

// --- commands ---

// Ends this node if a command refuses it. It sends no BYE, since it does not belong to the run.
static pm_drop accept_refusal(pm_lockstep_node *node, const portmet_command_t *command) {
    if (!pm_identity_is_refused(&node->endpoint.identity, node->endpoint.session, command)) {
        return PM_DROP_SESSION;
    }
    if (!pm_lockstep_node_leaving(node)) {
        pm_endpoint_end(&node->endpoint, pm_endpoint_code(command->code), command->reason);
        node->phase = PM_NODE_FINISHED;
    }
    return PM_KEEP;
}

static pm_drop accept_command(void *context, const portmet_command_t *command) {
    pm_lockstep_node *node = context;
    if (command->kind == PORTMET_COMMAND_T_REFUSE) {
        return accept_refusal(node, command);
    }
    // In HELLO the node belongs to the session that it was started for.
    const int64_t session = node->phase == PM_NODE_HELLO ? node->endpoint.identity.hello.session
                                                         : node->endpoint.session;
    if (session == 0 || command->session != session) {
        return PM_DROP_SESSION;
    }
    const bool abort = command->kind == PORTMET_COMMAND_T_ABORT;
    // A node that was restarted may not know that the last step is done.
    const bool done = node->checkpoints.path != NULL ||
                      (node->phase == PM_NODE_RUNNING && node->step == node->endpoint.steps);
    const bool end = command->kind == PORTMET_COMMAND_T_END && done;
    if (!pm_lockstep_node_leaving(node)) {
        if (!abort && !end) {
            return PM_DROP_RANGE;
        }
        if (abort && node->phase != PM_NODE_FAILING) {
            pm_endpoint_end(&node->endpoint, pm_endpoint_code(command->code), command->reason);
        }
        node->endpoint.session = command->session;
        pm_node_enter(node, PM_NODE_LEAVING);
        pm_node_check(node, pm_reporter_flush(&node->reporter));
    }
    // Every command is answered: the coordinator repeats it until it has received every BYE.
    pm_node_check(node, pm_reporter_notify(&node->reporter, node->endpoint.session,
                                           PORTMET_REPORT_T_BYE, PM_OK, ""));
    return PM_KEEP;
}

// --- hellos ---

// Refuses another node of this name if it was started later.
static void refuse_rival(pm_lockstep_node *node, int64_t session, int64_t instance) {
    const pm_identity *own = &node->endpoint.identity;
    const bool here = node->phase == PM_NODE_RUNNING || node->phase == PM_NODE_HELLO;
    if (here && pm_identity_is_older(own, instance)) {
        char reason[256];
        snprintf(reason, sizeof reason, "there is a node %s of scene %s already", node->name,
                 node->endpoint.system->scene->name);
        pm_node_check(node, pm_identity_refuse(own, session, instance, PM_ENET, reason));
    }
}

static pm_drop accept_hello(void *context, const portmet_hello_t *hello) {
    pm_lockstep_node *node = context;
    if (pm_identity_is_rival(&node->endpoint.identity, hello)) {
        refuse_rival(node, hello->session, hello->instance);
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

// Publishes a report again. If the report is no longer buffered, the coordinator was restarted from
// its checkpoint, and this node rolls back and computes the steps again.
static pm_status answer_report(pm_lockstep_node *node, const portmet_request_t *request) {
    const int64_t step = request->step;
    const bool is_new =
        request->sender[0] == 0 &&
        pm_request_filter_accept(&node->coordinator_requests, request, request->step);
    bool kept;
    PM_TRY(pm_reporter_repeat(&node->reporter, step, &kept));
    const bool missed = !kept && step <= node->step - node->reporter.rows;
    return missed && is_new && node->phase == PM_NODE_RUNNING
               ? pm_node_roll_back(node, step > 0 ? step - 1 : 0)
               : PM_OK;
}

// Publishes a flux again. If the flux is no longer buffered, the neighbour was restarted or has
// rolled back, and this node rolls back, too.
static pm_status answer_flux(pm_lockstep_node *node, const portmet_request_t *request) {
    const int64_t key = request->step * node->rounds + request->round;
    pm_flux_link *link = find_link(node, request->sender);
    const bool is_new = link != NULL && pm_request_filter_accept(&link->requests, request, key);
    if (pm_resend_buffer_keeps(&node->subsystems.sent, key)) {
        return pm_resend_buffer_repeat(&node->subsystems.sent, node->endpoint.transport, key);
    }
    const bool missed = key < pm_node_round_key(node);
    return missed && is_new && node->phase == PM_NODE_RUNNING
               ? pm_node_roll_back(node, request->step)
               : PM_OK;
}

static pm_drop accept_request(void *context, const portmet_request_t *request) {
    pm_lockstep_node *node = context;
    if (request->session != node->endpoint.session || node->endpoint.session == 0) {
        return PM_DROP_SESSION;
    }
    const bool sane = request->step >= 0 && request->step <= PM_STEPS_MAX && request->round >= 0 &&
                      request->round < node->rounds;
    if (!sane) {
        return PM_DROP_RANGE;
    }
    if (request->sender[0] == 0) {
        node->coordinator_alive = true;
    }
    if (strcmp(request->sender, node->name) == 0) {
        refuse_rival(node, request->session, request->instance);
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
    const pm_lockstep_node *node = link->node;
    const portmet_flux_t *flux = &link->scratch;
    if (node->phase != PM_NODE_RUNNING || flux->session != node->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (flux->round < 0 || flux->round >= node->rounds || flux->step < 0 ||
        flux->step > node->endpoint.steps) {
        return PM_DROP_RANGE;
    }
    return pm_flux_link_keep(link, flux->step * node->rounds + flux->round,
                             pm_node_round_key(node));
}

static void on_flux(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_flux_link *link = context;
    const pm_drop drop = pm_flux_decode(&link->scratch, data, size);
    pm_endpoint_count(&link->node->endpoint, drop == PM_KEEP ? accept_flux(link) : drop);
}

// --- opening ---

pm_status pm_node_listen(pm_lockstep_node *node, int64_t session) {
    static const pm_handlers handlers = {accept_hello, accept_command, accept_request};
    pm_transport *transport = node->endpoint.transport;
    PM_TRY(pm_endpoint_open(&node->endpoint, &handlers, node, node->name, session,
                            node->checkpoints.path != NULL));
    PM_TRY(pm_transport_subscribe(transport, node->endpoint.tick_channel, on_tick, node));
    for (int i = 0; i < node->subsystems.nlink; ++i) {
        pm_flux_link *link = &node->subsystems.link[i];
        link->node = node;
        PM_TRY(pm_transport_subscribe(transport, link->channel, on_flux, link));
    }
    return PM_OK;
}
