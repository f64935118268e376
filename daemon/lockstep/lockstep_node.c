// A node's polls: what it does in each phase, when it requests a missing message, and how it ends.
// node.h has the table of its states.
#include "lockstep/lockstep_node.h"

#include <math.h>
#include <stdlib.h>

#include "lockstep/lookahead.h"
#include "lockstep/node.h"

#define HELLO_INTERVAL 0.1   // s
#define FAILED_INTERVAL 0.02 // s between repetitions of FAILED
#define FAILED_COUNT 16      // FAILED is sent so often, unless the coordinator answers with ABORT
#define EACH_ASK 0.002       // s between two questions before the first step, for each process
#define LONG_ASK 1.0         // s between two questions of a node that waits for long
#define EACH_LONG_ASK 0.02   // s between them for each process, if others ask meanwhile
#define LEAVE_LINGER 0.15    // s to answer requests and repeated commands after the run

// The resend buffer keeps the fluxes of the last SENT_DEPTH rounds. A neighbour requests the flux
// of its present round, which is this node's present round or the one before; the coordinator
// requests the first round of a step. With a checkpoint, a request for an older round would roll
// this node back. LATE_DEPTH more rounds and reports are therefore kept, so that a late request
// does not.
#define SENT_DEPTH 2
#define LATE_DEPTH 32

// --- vitals ---

// The neighbour whose flux is missing; NULL if none is, so that only the coordinator is waited for.
static const pm_flux_link *missing_link(const pm_lockstep_node *node) {
    return node->started ? pm_process_subsystems_missing(&node->subsystems, pm_node_round_key(node))
                         : NULL;
}

void pm_lockstep_node_rest(pm_lockstep_node *node, double clock) {
    const pm_flux_link *missing = missing_link(node);
    pm_vitals_rest(&node->vitals, clock - node->endpoint.presence.absent,
                   pm_node_peer(node, missing));
}

// Says once a second how this process is doing.
static pm_status tell_vitals(pm_lockstep_node *node) {
    if (!pm_vitals_are_due(&node->vitals, node->endpoint.session, node->endpoint.now)) {
        return PM_OK;
    }
    return pm_vitals_publish(&node->vitals, node->endpoint.transport, node->step,
                             pm_checkpoint_ring_newest(&node->checkpoints), &node->endpoint.drops);
}

// --- waiting ---

// Asks the coordinator by a hello whether the run goes on as this node believes. Another
// coordinator may lead the run, or this node may believe something wrong. Until all processes are
// there, a question now and then shows that this one is. The answer is a tick, which all processes
// hear: while one of them asks, the others need not, and wait a little longer, each by another
// time.
static void ask_coordinator(pm_lockstep_node *node) {
    const double now = node->endpoint.now, n = node->endpoint.system->scene->nprocess;
    const double later = 1 + (double)(node->endpoint.identity.hello.instance & 1023) / 1024;
    const bool begins = node->granted == 0;
    const bool unheard = now >= node->coordinator_heard + later * LONG_ASK;
    const double pause = begins    ? EACH_ASK * n
                         : unheard ? LONG_ASK
                                   : fmax(LONG_ASK, EACH_LONG_ASK * n);
    if ((begins || pm_waiting_is_long(&node->endpoint.waiting)) && now >= node->asked_at + pause) {
        pm_node_ask(node, node->coordinator);
    }
}

// Requests the missing message if a request is due, and sets the time of the next poll. A node
// gives up a silent coordinator, but never a silent neighbour: the neighbour may be recomputing
// steps after a restart, and the coordinator decides about it.
static pm_status await(pm_lockstep_node *node) {
    pm_waiting *waiting = &node->endpoint.waiting;
    const double now = node->endpoint.now;
    if (node->progressed) {
        pm_waiting_start(waiting, now);
        node->progressed = false;
    }
    if (pm_waiting_is_over(waiting, node->coordinator_heard, node->endpoint.system->scene->patience,
                           now)) {
        return pm_fail(PM_ETIMEOUT,
                       "no word from the coordinator for %.3g s, in round %d of step %lld",
                       now - waiting->since, node->round, (long long)node->step);
    }
    if (!pm_waiting_request_due(waiting, now)) {
        node->next = waiting->next;
        return PM_OK;
    }
    ask_coordinator(node);
    const bool begins = node->granted == 0;
    if (node->step < node->endpoint.steps && !begins) {
        // While blocked, publish the partially filled report.
        PM_TRY(pm_reporter_flush(&node->reporter));
        // A missing flux is requested before a missing tick, since the grant may depend on the
        // flux.
        const pm_flux_link *missing = missing_link(node);
        const char *address =
            missing != NULL ? missing->address : node->endpoint.coordinator_address;
        const char *channel = missing != NULL ? missing->channel : node->endpoint.tick_channel;
        pm_vitals_ask(&node->vitals, pm_node_peer(node, missing));
        PM_TRY(pm_endpoint_request(&node->endpoint, address, channel, node->step, node->round));
    }
    node->next = waiting->next;
    return PM_OK;
}

static pm_status say_hello(pm_lockstep_node *node) {
    const pm_scene *scene = node->endpoint.system->scene;
    if (node->endpoint.now >= node->until && node->late) {
        return pm_fail(PM_ETIMEOUT,
                       "a run of scene %s is under way, and there is no checkpoint of it here "
                       "with which %s could take part",
                       scene->name, node->name);
    }
    if (node->endpoint.now >= node->until) {
        return pm_fail(PM_ETIMEOUT,
                       "no coordinator of scene %s with the same models answered within %.3g s",
                       scene->name, scene->patience);
    }
    if (node->endpoint.now >= node->next) {
        node->next = node->endpoint.now + HELLO_INTERVAL;
        PM_TRY(pm_identity_publish_hello(&node->endpoint.identity));
    }
    return PM_OK;
}

// Repeats the report FAILED until the coordinator answers with ABORT or enough were sent. Reports
// are counted, not time: a process that is paused meanwhile must not leave after a single one,
// which the network may have lost.
static void repeat_failure(pm_lockstep_node *node) {
    if (node->endpoint.now < node->next) {
        return;
    }
    if (node->failures == FAILED_COUNT) {
        node->phase = PM_NODE_FINISHED;
    } else {
        node->next = node->endpoint.now + FAILED_INTERVAL;
        node->failures += 1;
        // The first failure counts, even if it cannot be published.
        (void)pm_reporter_flush(&node->reporter);
        const int64_t session = node->endpoint.session != 0 ? node->endpoint.session
                                                            : node->endpoint.identity.hello.session;
        (void)pm_reporter_notify(
            &node->reporter, session,
            node->coordinator != 0 ? node->coordinator : node->endpoint.identity.hello.coordinator,
            PORTMET_REPORT_T_FAILED, node->endpoint.status, node->endpoint.message);
    }
}

// --- a poll ---

// Sets the end of a phase that has just begun.
static void start_clock(pm_lockstep_node *node) {
    if (node->until != 0) {
        return;
    }
    const double duration = node->phase == PM_NODE_HELLO ? node->endpoint.system->scene->patience
                            : node->phase == PM_NODE_LEAVING ? LEAVE_LINGER
                                                             : INFINITY;
    node->until = node->endpoint.now + duration;
    node->next = node->endpoint.now;
}

double pm_lockstep_node_poll(pm_lockstep_node *node, double clock) {
    pm_endpoint_look(&node->endpoint, clock);
    const double now = node->endpoint.now;
    pm_vitals_look(&node->vitals, now);
    if (node->coordinator_alive) {
        node->coordinator_heard = now;
        node->coordinator_alive = false;
    }
    if (node->alive != NULL && now >= node->alive_at) {
        node->alive_at = now + PM_VITALS_INTERVAL;
        node->alive(node->alive_context, node->step);
    }
    start_clock(node);
    if (node->phase == PM_NODE_HELLO) {
        pm_node_check(node, say_hello(node));
    }
    if (node->phase == PM_NODE_RUNNING) {
        pm_node_check(node, pm_node_compute(node));
        pm_node_check(node, tell_vitals(node));
    }
    if (node->phase == PM_NODE_RUNNING && pm_node_may_start(node)) {
        node->next = now;
    } else if (node->phase == PM_NODE_RUNNING) {
        pm_node_check(node, await(node));
    }
    const double question = pm_node_publish_question(node);
    start_clock(node);
    if (node->phase == PM_NODE_FAILING) {
        repeat_failure(node);
    }
    if (node->phase == PM_NODE_LEAVING) {
        node->next = node->until;
        node->phase = now >= node->until ? PM_NODE_FINISHED : PM_NODE_LEAVING;
    }
    return node->phase == PM_NODE_FINISHED
               ? INFINITY
               : pm_endpoint_clock(&node->endpoint, fmin(node->next, question));
}

// --- opening ---

static pm_status open_vitals(pm_lockstep_node *node, int process_id) {
    const pm_process_subsystems *s = &node->subsystems;
    int *peer = pm_arena_array(&node->arena, (size_t)s->nlink + 1, sizeof *peer);
    if (peer == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", node->name);
    }
    for (int i = 0; i < s->nlink; ++i) {
        peer[i] = s->link[i].process_id;
    }
    return pm_vitals_init(&node->vitals, &node->arena, node->endpoint.system->scene, process_id,
                          s->nlink, peer);
}

static pm_status prepare(pm_lockstep_node *node, int process_id,
                         const pm_lockstep_node_options *options) {
    const int more = options->checkpoint == NULL ? 0 : LATE_DEPTH;
    PM_TRY(pm_process_subsystems_init(&node->subsystems, &node->arena, node->endpoint.system,
                                      process_id, options->z, options->boundary_input,
                                      SENT_DEPTH + more));
    PM_TRY(pm_checkpoint_ring_init(&node->checkpoints, &node->arena, options->checkpoint,
                                   node->endpoint.system, &node->subsystems));
    node->answers = pm_arena_array(&node->arena, (size_t)node->endpoint.system->scene->nprocess,
                                   sizeof *node->answers);
    node->live = options->live;
    node->heard = pm_arena_array(&node->arena, (size_t)node->endpoint.system->scene->nlive,
                                 sizeof *node->heard);
    if (node->answers == NULL || node->heard == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", node->name);
    }
    PM_TRY(open_vitals(node, process_id));
    node->alive = options->alive;
    node->alive_context = options->context;
    node->rounds = pm_local_subsystems_most_rounds(node->subsystems.local);
    node->fluxes_show_progress =
        node->subsystems.nlink > 0 && pm_lookahead_uses_fluxes(node->endpoint.system->scene);
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
        pm_process_subsystems_free(&node->subsystems);
        pm_arena_free(&node->arena);
        free(node);
    }
}
