// A node's life: what a poll does in each phase, when it asks again, and how it ends.
#include "lockstep/lockstep_node.h"

#include <math.h>
#include <stdlib.h>

#include "lockstep/lookahead.h"
#include "lockstep/node.h"

#define HELLO_INTERVAL 0.1   // s
#define FAILED_INTERVAL 0.02 // s between repetitions of FAILED
#define FAILED_LINGER 0.3    // s to wait for the coordinator's ABORT
#define LEAVE_LINGER 0.15    // s to answer requests and repeated commands after the end

// Rounds whose fluxes are kept: a neighbour may ask for the round it is in, which is ours or the
// one before, and the coordinator for the one it has not been shown. Where a request for older ones
// makes us go back, some more, and as many more reports: then one that comes late, out of order,
// does not.
#define SENT_DEPTH 2
#define LATE_DEPTH 32

// --- the end ---

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

// --- waiting ---

// Asks again for what is missing. It is for the coordinator to give up a neighbour that stays
// silent, or goes on waiting while that one computes again what it did before it died; a node gives
// up a coordinator that is silent itself. Sets when to look again.
static pm_status await(pm_lockstep_node *node) {
    pm_waiting *waiting = &node->endpoint.waiting;
    const double now = node->endpoint.now;
    if (node->progressed) {
        pm_waiting_start(waiting, now);
        node->progressed = false;
    }
    if (pm_waiting_over(waiting, node->coordinator_heard, node->endpoint.system->scene->patience,
                        now)) {
        return pm_fail(PM_ETIMEOUT,
                       "no word from the coordinator for %.3g s, in round %d of step %lld",
                       now - waiting->since, node->round, (long long)node->step);
    }
    if (pm_waiting_ask(waiting, now) && node->step < node->endpoint.steps) {
        // Who waits has time to tell what it has.
        PM_TRY(pm_reporter_flush(&node->reporter));
        // Without the neighbour's flux there may be no grant, and the next wait would be for it.
        const pm_flux_link *l =
            node->started ? pm_process_subsystems_misses(&node->group, pm_node_key(node)) : NULL;
        PM_TRY(l != NULL
                   ? pm_endpoint_request(&node->endpoint, l->address, l->channel, node->step,
                                         node->round)
                   : pm_endpoint_request(&node->endpoint, node->endpoint.tick_address,
                                         node->endpoint.tick_channel, node->step, node->round));
    }
    node->next = waiting->next;
    return PM_OK;
}

static pm_status greet(pm_lockstep_node *node) {
    const pm_scene *scene = node->endpoint.system->scene;
    if (node->endpoint.now >= node->until) {
        return node->late
                   ? pm_fail(
                         PM_ETIMEOUT,
                         "a run of scene %s is under way, and there is no checkpoint of it here "
                         "with which %s could take part",
                         scene->name, node->name)
                   : pm_fail(
                         PM_ETIMEOUT,
                         "no coordinator of scene %s with the same models answered within %.3g s",
                         scene->name, scene->patience);
    }
    if (node->endpoint.now >= node->next) {
        node->next = node->endpoint.now + HELLO_INTERVAL;
        PM_TRY(pm_identity_say(&node->endpoint.identity));
    }
    return PM_OK;
}

// A failed node tells why until the coordinator answers or enough time has passed.
static void repeat_failure(pm_lockstep_node *node) {
    if (node->endpoint.now >= node->until) {
        node->phase = PM_NODE_FINISHED;
    } else if (node->endpoint.now >= node->next) {
        node->next = node->endpoint.now + FAILED_INTERVAL;
        // The first failure counts, not that telling it failed too.
        (void)pm_reporter_flush(&node->reporter);
        const int64_t session = node->endpoint.session != 0 ? node->endpoint.session
                                                            : node->endpoint.identity.hello.session;
        (void)pm_reporter_say(&node->reporter, session, PORTMET_REPORT_T_FAILED,
                              node->endpoint.status, node->endpoint.message);
    }
}

static void note_life(pm_lockstep_node *node) {
    if (node->coordinator_alive) {
        node->coordinator_heard = node->endpoint.now;
        node->coordinator_alive = false;
    }
}

// How long a phase may last, s.
static double duration(const pm_lockstep_node *node) {
    switch (node->phase) {
    case PM_NODE_HELLO:
        return node->endpoint.system->scene->patience;
    case PM_NODE_FAILING:
        return FAILED_LINGER;
    case PM_NODE_LEAVING:
        return LEAVE_LINGER;
    default:
        return INFINITY;
    }
}

static void start_clock(pm_lockstep_node *node) {
    if (node->until == 0) {
        node->until = node->endpoint.now + duration(node);
        node->next = node->endpoint.now;
    }
}

double pm_lockstep_node_poll(pm_lockstep_node *node, double now) {
    node->endpoint.now = now;
    note_life(node);
    start_clock(node);
    if (node->phase == PM_NODE_HELLO) {
        pm_node_check(node, greet(node));
    }
    if (node->phase == PM_NODE_RUNNING) {
        pm_node_check(node, pm_node_compute(node));
    }
    if (node->phase == PM_NODE_RUNNING && pm_node_may_start(node)) {
        node->next = now;
    } else if (node->phase == PM_NODE_RUNNING) {
        pm_node_check(node, await(node));
    }
    start_clock(node);
    if (node->phase == PM_NODE_FAILING) {
        repeat_failure(node);
    }
    if (node->phase == PM_NODE_LEAVING) {
        node->next = node->until;
        node->phase = now >= node->until ? PM_NODE_FINISHED : PM_NODE_LEAVING;
    }
    return node->phase == PM_NODE_FINISHED ? INFINITY : node->next;
}

// --- opening ---

static pm_status prepare(pm_lockstep_node *node, int process_id,
                         const pm_lockstep_node_options *options) {
    const int more = options->checkpoint == NULL ? 0 : LATE_DEPTH;
    PM_TRY(pm_process_subsystems_init(&node->group, &node->arena, node->endpoint.system, process_id,
                                      options->z, options->boundary_input, SENT_DEPTH + more));
    PM_TRY(pm_checkpoint_ring_init(&node->history, &node->arena, options->checkpoint,
                                   node->endpoint.system, &node->group));
    node->rounds = pm_subsystem_most_rounds(node->group.part[0].subsystem);
    node->fluxes_tell =
        node->group.nlink > 0 && pm_lookahead_is_heard(node->endpoint.system->scene);
    PM_TRY(pm_node_listen(node, options->session));
    return pm_reporter_init(&node->reporter, &node->arena, node->endpoint.system, process_id,
                            node->endpoint.transport, node->endpoint.identity.hello.instance, more);
}

pm_status pm_lockstep_node_open(pm_lockstep_node **node, const pm_system *system, int process_id,
                                pm_transport *transport, const pm_lockstep_node_options *options) {
    const char *name = system->scene->process[process_id].name;
    pm_lockstep_node *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", name);
    }
    made->endpoint.system = system;
    made->name = name;
    made->endpoint.transport = transport;
    const pm_lockstep_node_options plain = {0};
    const pm_lockstep_node_options *given = options == NULL ? &plain : options;
    const pm_status status = prepare(made, process_id, given);
    if (status != PM_OK) {
        pm_lockstep_node_close(made);
        return status;
    }
    *node = made;
    return PM_OK;
}

void pm_lockstep_node_close(pm_lockstep_node *node) {
    if (node != NULL) {
        pm_process_subsystems_free(&node->group);
        pm_arena_free(&node->arena);
        free(node);
    }
}

// --- asking ---

bool pm_lockstep_node_finished(const pm_lockstep_node *node) {
    return node->phase == PM_NODE_FINISHED;
}

bool pm_lockstep_node_leaving(const pm_lockstep_node *node) {
    return node->phase == PM_NODE_FINISHED || node->phase == PM_NODE_LEAVING;
}

pm_status pm_lockstep_node_result(const pm_lockstep_node *node) {
    return pm_endpoint_result(&node->endpoint);
}

long pm_lockstep_node_step(const pm_lockstep_node *node) {
    return (long)node->step;
}

pm_transport *pm_lockstep_node_transport(const pm_lockstep_node *node) {
    return node->endpoint.transport;
}

const pm_drops *pm_lockstep_node_drops(const pm_lockstep_node *node) {
    return &node->endpoint.drops;
}
