// A process: says HELLO, then computes rounds as far as ticks and neighbours' fluxes allow. Message
// handlers only store and answer; pm_lockstep_node_poll computes.
#include "net/lockstep_node.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "net/crew.h"
#include "net/history.h"
#include "net/identity.h"
#include "net/reporter.h"
#include "net/waiting.h"
#include "store/channel.h"

#define HELLO_INTERVAL 0.1   // s
#define FAILED_INTERVAL 0.02 // s between repetitions of FAILED
#define FAILED_LINGER 0.3    // s to wait for the coordinator's ABORT
#define LEAVE_LINGER 0.15    // s to answer requests and repeated commands after the end

// Rounds whose fluxes are kept: a neighbour may ask for the round it is in, which is ours or the
// one before. Where a request for older ones makes us go back, some more, and as many more reports:
// then one that comes late, out of order, does not.
#define SENT_DEPTH 2
#define LATE_DEPTH 32

// Steps of one poll at most: then messages and the stop flag are looked at.
#define STEPS_AT_ONCE 16

typedef enum phase { HELLO, RUNNING, FAILING, LEAVING, FINISHED } phase;

struct pm_lockstep_node {
    pm_arena arena;
    const pm_system *system;
    const char *name;
    pm_crew crew;
    pm_transport *transport;
    pm_identity identity;

    phase phase;
    pm_status status;
    char message[PM_TEXT_MAX + 1];
    double now, next, until; // s: last poll; next one needed; end of the phase

    // Of the run, from the coordinator's ticks.
    int64_t session, steps, granted;
    double t0;
    bool want_state;
    bool coordinator_alive;
    double coordinator_heard;

    int rounds;   // per step
    int64_t step; // being computed, or next
    int round;
    bool started;                // the round
    const pm_flux_link *missing; // the neighbour whose flux it waits for, or NULL
    bool progressed;             // since the last poll; a new wait begins
    pm_waiting waiting;

    pm_history history;
    pm_reporter reporter;
    char tick_channel[PM_CHANNEL_SIZE];
    char request_channel[PM_CHANNEL_SIZE];
    pm_drops drops;
};

// --- the end ---

// The phase's clock starts at the next poll, as handlers do not know the time.
static void enter(pm_lockstep_node *node, phase next) {
    node->phase = next;
    node->until = node->next = 0;
}

static void end_with(pm_lockstep_node *node, pm_status status, const char *message) {
    node->status = status;
    snprintf(node->message, sizeof node->message, "%s", message);
}

void pm_lockstep_node_fail(pm_lockstep_node *node, pm_status code, const char *message) {
    if (node->phase == HELLO || node->phase == RUNNING) {
        end_with(node, code, message);
        enter(node, FAILING);
    }
}

// Handlers cannot return a failure; they leave it here.
static void check(pm_lockstep_node *node, pm_status status) {
    if (status != PM_OK) {
        pm_lockstep_node_fail(node, status, pm_error());
    }
}

// --- a step ---

static double time_of(const pm_lockstep_node *node, int64_t step) {
    return node->t0 + (double)step * node->system->scene->dt;
}

// The present round, counted from the start of the run.
static int64_t round_key(const pm_lockstep_node *node) {
    return node->step * node->rounds + node->round;
}

// The books of the step just completed; published when no more steps are granted, or enough of them
// are gathered.
static pm_status report(pm_lockstep_node *node) {
    PM_TRY(pm_reporter_done(&node->reporter, node->session, node->step, time_of(node, node->step),
                            &node->crew, node->want_state));
    return node->step < node->granted ? PM_OK : pm_reporter_flush(&node->reporter);
}

// Computes again from the newest checkpoint of at most `step` steps, if there is one.
static pm_status go_back(pm_lockstep_node *node, int64_t step) {
    // What was done up to now stays true.
    PM_TRY(pm_reporter_flush(&node->reporter));
    const int64_t found = pm_history_go_back(&node->history, step, &node->crew);
    if (found < 0) {
        return PM_OK;
    }
    node->step = found;
    node->round = 0;
    node->started = false;
    node->progressed = true;
    return found == 0 ? report(node) : PM_OK;
}

static pm_status start_round(pm_lockstep_node *node) {
    const portmet_flux_t head = {
        .session = node->session,
        .step = node->step,
        .round = node->round,
        .time = time_of(node, node->step),
    };
    PM_TRY(pm_crew_start_round(&node->crew, node->transport, round_key(node), &head));
    node->started = true;
    node->progressed = true;
    return PM_OK;
}

static pm_status finish_round(pm_lockstep_node *node) {
    pm_crew_advance(&node->crew);
    node->started = false;
    node->round += 1;
    if (node->round < node->rounds) {
        return PM_OK;
    }
    PM_TRY(pm_crew_end_step(&node->crew));
    node->step += 1;
    node->round = 0;
    PM_TRY(pm_history_note(&node->history, node->session, node->step, &node->crew));
    return report(node);
}

static bool may_start(const pm_lockstep_node *node) {
    return !node->started && node->step < node->granted;
}

// As far as the neighbours' fluxes and the time between two polls allow.
static pm_status run_rounds(pm_lockstep_node *node) {
    const int64_t end = node->step + STEPS_AT_ONCE;
    while (node->step < end && (node->started || may_start(node))) {
        if (!node->started) {
            PM_TRY(start_round(node));
        }
        bool used;
        node->missing = pm_crew_couple(&node->crew, round_key(node), &used);
        node->progressed = node->progressed || used;
        if (node->missing != NULL) {
            return PM_OK;
        }
        PM_TRY(finish_round(node));
    }
    return PM_OK;
}

// --- waiting ---

// Asks again for what is missing, and gives up on a silent peer. Sets when to look again.
static pm_status await(pm_lockstep_node *node) {
    if (node->progressed) {
        pm_waiting_start(&node->waiting, node->now);
        node->progressed = false;
    }
    const pm_flux_link *l = node->started ? node->missing : NULL;
    const double heard = l != NULL ? l->heard : node->coordinator_heard;
    const double patience = node->system->scene->patience;
    if (pm_waiting_over(&node->waiting, heard, patience, node->now)) {
        return pm_fail(PM_ETIMEOUT, "no word from %s for %.3g s, in round %d of step %lld",
                       l != NULL ? l->neighbour : "the coordinator",
                       node->now - node->waiting.since, node->round, (long long)node->step);
    }
    if (pm_waiting_ask(&node->waiting, node->now) && node->step < node->steps) {
        // Who waits has time to tell what it has.
        PM_TRY(pm_reporter_flush(&node->reporter));
        PM_TRY(pm_waiting_request(node->transport, node->request_channel, node->session, node->name,
                                  l != NULL ? l->channel : node->tick_channel, node->step,
                                  node->round));
    }
    node->next = node->waiting.next;
    return PM_OK;
}

static pm_status greet(pm_lockstep_node *node) {
    const pm_scene *scene = node->system->scene;
    if (node->now >= node->until) {
        return pm_fail(PM_ETIMEOUT,
                       "no coordinator of scene %s with the same models answered within %.3g s",
                       scene->name, scene->patience);
    }
    if (node->now >= node->next) {
        node->next = node->now + HELLO_INTERVAL;
        PM_TRY(pm_identity_say(&node->identity));
    }
    return PM_OK;
}

// A failed node tells why until the coordinator answers or enough time has passed.
static void repeat_failure(pm_lockstep_node *node) {
    if (node->now >= node->until) {
        node->phase = FINISHED;
    } else if (node->now >= node->next) {
        node->next = node->now + FAILED_INTERVAL;
        // The first failure counts, not that telling it failed too.
        (void)pm_reporter_flush(&node->reporter);
        const int64_t session = node->session != 0 ? node->session : node->identity.hello.session;
        (void)pm_reporter_say(&node->reporter, session, PORTMET_REPORT_T_FAILED, node->status,
                              node->message);
    }
}

static void note_life(pm_lockstep_node *node) {
    if (node->coordinator_alive) {
        node->coordinator_heard = node->now;
        node->coordinator_alive = false;
    }
    for (int i = 0; i < node->crew.nlink; ++i) {
        pm_flux_link *link = &node->crew.link[i];
        link->heard = link->alive ? node->now : link->heard;
        link->alive = false;
    }
}

// How long a phase may last, s.
static double duration(const pm_lockstep_node *node) {
    switch (node->phase) {
    case HELLO:
        return node->system->scene->patience;
    case FAILING:
        return FAILED_LINGER;
    case LEAVING:
        return LEAVE_LINGER;
    default:
        return INFINITY;
    }
}

static void start_clock(pm_lockstep_node *node) {
    if (node->until == 0) {
        node->until = node->now + duration(node);
        node->next = node->now;
    }
}

double pm_lockstep_node_poll(pm_lockstep_node *node, double now) {
    node->now = now;
    note_life(node);
    start_clock(node);
    if (node->phase == HELLO) {
        check(node, greet(node));
    }
    if (node->phase == RUNNING) {
        check(node, run_rounds(node));
    }
    if (node->phase == RUNNING && may_start(node)) {
        node->next = now;
    } else if (node->phase == RUNNING) {
        check(node, await(node));
    }
    start_clock(node);
    if (node->phase == FAILING) {
        repeat_failure(node);
    }
    if (node->phase == LEAVING) {
        node->next = node->until;
        node->phase = now >= node->until ? FINISHED : LEAVING;
    }
    return node->phase == FINISHED ? INFINITY : node->next;
}

// --- receiving ---

static void count(pm_lockstep_node *node, pm_drop drop) {
    node->drops.count[drop] += 1;
}

// From the initial state, or where this process stood when it died.
static pm_status begin(pm_lockstep_node *node) {
    if (node->history.path == NULL) {
        return report(node);
    }
    PM_TRY(pm_history_load(&node->history, node->session));
    return go_back(node, INT64_MAX);
}

static pm_drop join(pm_lockstep_node *node, const portmet_tick_t *tick) {
    const double dt = node->system->scene->dt;
    const int64_t asked = node->identity.hello.session;
    const bool wanted = asked == 0 ? tick->open : tick->session == asked;
    if (!wanted || tick->session <= 0 || tick->digest != (int64_t)node->system->digest) {
        return PM_DROP_SESSION;
    }
    if (tick->steps < 0 || tick->steps > PM_STEPS_MAX) {
        return PM_DROP_RANGE;
    }
    node->session = tick->session;
    node->steps = tick->steps;
    node->t0 = tick->t0;
    node->want_state = tick->want_state != 0;
    node->progressed = true;
    enter(node, RUNNING);
    if (tick->dt != dt) {
        check(node,
              pm_fail(PM_ENET, "the coordinator's scene steps by %.17g s, this node's by %.17g s",
                      tick->dt, dt));
        return PM_KEEP;
    }
    check(node, begin(node));
    return PM_KEEP;
}

static pm_drop accept_tick(pm_lockstep_node *node, const portmet_tick_t *tick) {
    if (node->phase == HELLO) {
        const pm_drop drop = join(node, tick);
        if (drop != PM_KEEP) {
            return drop;
        }
    }
    if (tick->session != node->session) {
        return PM_DROP_SESSION;
    }
    node->coordinator_alive = true;
    if (tick->granted > node->steps || tick->granted < 0) {
        return PM_DROP_RANGE;
    }
    if (tick->granted < node->granted) {
        return PM_DROP_REPEATED;
    }
    node->granted = tick->granted;
    return PM_KEEP;
}

static void on_tick(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_node *node = context;
    portmet_tick_t tick;
    pm_drop drop = pm_tick_decode(&tick, data, size);
    if (drop == PM_KEEP) {
        drop = accept_tick(node, &tick);
    }
    count(node, drop);
}

// Is this command of the node's session, or (in HELLO) of the one it was started for?
static bool concerns(const pm_lockstep_node *node, const portmet_command_t *command) {
    const int64_t session = node->phase == HELLO ? node->identity.hello.session : node->session;
    return session != 0 && command->session == session;
}

static pm_status code_of(const portmet_command_t *command) {
    const bool known = command->code >= PM_EUSAGE && command->code <= PM_EINTERRUPTED;
    return known ? (pm_status)command->code : PM_ENET;
}

// Leaves without a word: whoever is refused is not of the run.
static pm_drop accept_refusal(pm_lockstep_node *node, const portmet_command_t *command) {
    if (!pm_identity_is_refused(&node->identity, command)) {
        return PM_DROP_SESSION;
    }
    if (!pm_lockstep_node_leaving(node)) {
        end_with(node, code_of(command), command->reason);
        node->phase = FINISHED;
    }
    return PM_KEEP;
}

static pm_drop accept_command(pm_lockstep_node *node, const portmet_command_t *command) {
    if (command->kind == PORTMET_COMMAND_T_REFUSE) {
        return accept_refusal(node, command);
    }
    const bool abort = command->kind == PORTMET_COMMAND_T_ABORT;
    const bool end = command->kind == PORTMET_COMMAND_T_END;
    const bool complete = node->phase == RUNNING && node->step == node->steps;
    if (!concerns(node, command)) {
        return PM_DROP_SESSION;
    }
    if (!pm_lockstep_node_leaving(node)) {
        if (!abort && !(end && complete)) {
            return PM_DROP_RANGE;
        }
        if (abort && node->phase != FAILING) {
            end_with(node, code_of(command), command->reason);
        }
        if (end) {
            pm_history_remove(&node->history);
        }
        node->session = command->session;
        enter(node, LEAVING);
    }
    // Repeated commands too: the coordinator repeats them until it has heard everybody's BYE.
    check(node, pm_reporter_say(&node->reporter, node->session, PORTMET_REPORT_T_BYE, PM_OK, ""));
    return PM_KEEP;
}

static void on_command(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_node *node = context;
    portmet_command_t command;
    pm_drop drop = pm_command_decode(&command, data, size);
    if (drop == PM_KEEP) {
        drop = accept_command(node, &command);
    }
    count(node, drop);
}

// Who came first stays.
static void on_hello(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_node *node = context;
    portmet_hello_t hello;
    const pm_drop drop = pm_hello_decode(&hello, data, size);
    if (drop == PM_KEEP && pm_identity_rivals(&node->identity, &hello) &&
        (node->phase == RUNNING ||
         (node->phase == HELLO && pm_identity_precedes(&node->identity, &hello)))) {
        char reason[256];
        snprintf(reason, sizeof reason, "there is a node %s of scene %s already", node->name,
                 node->system->scene->name);
        check(node, pm_identity_refuse(&node->identity, &hello, PM_ENET, reason));
    }
    count(node, drop);
}

static void note_sender(pm_lockstep_node *node, const char *sender) {
    if (sender[0] == 0) {
        node->coordinator_alive = true;
    }
    for (int i = 0; i < node->crew.nlink; ++i) {
        pm_flux_link *link = &node->crew.link[i];
        link->alive = link->alive || strcmp(link->neighbour, sender) == 0;
    }
}

// Who asks for what is no longer kept has returned from its death.
static pm_status answer_report(pm_lockstep_node *node, int64_t step) {
    bool kept;
    PM_TRY(pm_reporter_repeat(&node->reporter, step, &kept));
    const bool missed = !kept && step <= node->step - node->reporter.rows;
    return missed && node->phase == RUNNING ? go_back(node, step > 0 ? step - 1 : 0) : PM_OK;
}

static pm_status answer_flux(pm_lockstep_node *node, int64_t step, int round) {
    const int64_t key = step * node->rounds + round;
    const bool missed = key < round_key(node) && !pm_outbox_keeps(&node->crew.sent, key);
    return missed && node->phase == RUNNING
               ? go_back(node, step)
               : pm_outbox_repeat(&node->crew.sent, node->transport, key);
}

static pm_drop answer(pm_lockstep_node *node, const portmet_request_t *request) {
    if (request->session != node->session || node->session == 0) {
        return PM_DROP_SESSION;
    }
    const bool sane = request->step >= 0 && request->step <= PM_STEPS_MAX && request->round >= 0 &&
                      request->round < node->rounds;
    if (!sane) {
        return PM_DROP_RANGE;
    }
    note_sender(node, request->sender);
    if (strcmp(request->channel, node->reporter.sent.channel) == 0) {
        check(node, answer_report(node, request->step));
    }
    if (strcmp(request->channel, node->crew.sent.channel) == 0) {
        check(node, answer_flux(node, request->step, request->round));
    }
    return PM_KEEP;
}

static void on_request(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_node *node = context;
    portmet_request_t request;
    pm_drop drop = pm_request_decode(&request, data, size);
    if (drop == PM_KEEP) {
        drop = answer(node, &request);
    }
    count(node, drop);
}

static pm_drop accept_flux(pm_flux_link *link) {
    const pm_lockstep_node *node = link->node;
    const portmet_flux_t *flux = &link->scratch;
    if (node->phase != RUNNING || flux->session != node->session) {
        return PM_DROP_SESSION;
    }
    if (flux->round < 0 || flux->round >= node->rounds || flux->step < 0 ||
        flux->step > node->steps) {
        return PM_DROP_RANGE;
    }
    return pm_flux_link_keep(link, flux->step * node->rounds + flux->round, round_key(node));
}

static void on_flux(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_flux_link *link = context;
    pm_drop drop = pm_flux_decode(&link->scratch, data, size);
    if (drop == PM_KEEP) {
        drop = accept_flux(link);
    }
    count(link->node, drop);
}

// --- opening ---

static pm_status subscribe(pm_lockstep_node *node) {
    const pm_scene *scene = node->system->scene;
    PM_TRY(pm_channel_scene(node->tick_channel, scene, "TICK"));
    PM_TRY(pm_channel_scene(node->request_channel, scene, "REQUEST"));
    PM_TRY(pm_transport_subscribe(node->transport, node->tick_channel, on_tick, node));
    PM_TRY(
        pm_transport_subscribe(node->transport, node->identity.command_channel, on_command, node));
    PM_TRY(pm_transport_subscribe(node->transport, node->identity.hello_channel, on_hello, node));
    return pm_transport_subscribe(node->transport, node->request_channel, on_request, node);
}

static pm_status prepare(pm_lockstep_node *node, int process_id,
                         const pm_lockstep_node_options *options) {
    const int more = options->checkpoint == NULL ? 0 : LATE_DEPTH;
    PM_TRY(pm_crew_init(&node->crew, &node->arena, node->system, process_id, options->z,
                        options->load, SENT_DEPTH + more));
    PM_TRY(pm_history_init(&node->history, &node->arena, options->checkpoint, node->system,
                           &node->crew));
    node->rounds = pm_subsystem_rounds(node->crew.part[0].subsystem);
    for (int i = 0; i < node->crew.nlink; ++i) {
        pm_flux_link *link = &node->crew.link[i];
        link->node = node;
        PM_TRY(pm_transport_subscribe(node->transport, link->channel, on_flux, link));
    }
    PM_TRY(pm_reporter_init(&node->reporter, &node->arena, node->system, process_id,
                            node->transport, more));
    PM_TRY(pm_identity_init(&node->identity, node->system, node->name, options->session,
                            options->checkpoint != NULL, node->transport));
    return subscribe(node);
}

pm_status pm_lockstep_node_open(pm_lockstep_node **node, const pm_system *system, int process_id,
                                pm_transport *transport, const pm_lockstep_node_options *options) {
    const char *name = system->scene->process[process_id].name;
    pm_lockstep_node *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", name);
    }
    made->system = system;
    made->name = name;
    made->transport = transport;
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
        pm_crew_free(&node->crew);
        pm_arena_free(&node->arena);
        free(node);
    }
}

// --- asking ---

bool pm_lockstep_node_finished(const pm_lockstep_node *node) {
    return node->phase == FINISHED;
}

bool pm_lockstep_node_leaving(const pm_lockstep_node *node) {
    return node->phase == FINISHED || node->phase == LEAVING;
}

pm_status pm_lockstep_node_result(const pm_lockstep_node *node) {
    return node->status == PM_OK ? PM_OK : pm_fail(node->status, "%s", node->message);
}

long pm_lockstep_node_step(const pm_lockstep_node *node) {
    return (long)node->step;
}

pm_transport *pm_lockstep_node_transport(const pm_lockstep_node *node) {
    return node->transport;
}

const pm_drops *pm_lockstep_node_drops(const pm_lockstep_node *node) {
    return &node->drops;
}
