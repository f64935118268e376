// A node: its steps, the messages that it handles, and its polls.
//
// The state machine. A round begins as soon as the round before it is complete and its step is
// granted. `patience` is a key of the scene, in s. "With a checkpoint" means that this node keeps
// checkpoints. A message is "proven" if it repeats the nonce of this node's present hello
// (endpoint.h). "Its coordinator" is the one whose tick was proven last; a node asks a coordinator
// by a hello that names it. Messages that nobody can have sent in this run are dropped first.
//
// state    awaits             message or time-out                next      sends
// -------  -----------------  ---------------------------------  --------  ---------------------
// HELLO    a tick             0.1 s passed                       HELLO     hello
//                             hello, tick, END or ABORT of an    HELLO     hello that names it
//                               unknown coordinator
//                             proven tick, nothing granted       RUNNING   report of the first
//                                                                          state
//                             proven tick, steps granted, and a  RUNNING   hello
//                               checkpoint of its session
//                             patience passed                    FAILING
//                             proven END or ABORT                LEAVING   BYE
// RUNNING  a grant; every     tick that grants more              RUNNING   flux of the round
//          neighbour's flux   every flux of a round is there     RUNNING   flux of the next round
//          of the round       every round of a step is complete  RUNNING   report: when full, 20 ms
//                                                                          old, or awaited
//                             time to request (endpoint.h)        RUNNING   request for the missing
//                                                                          flux, else for a tick;
//                                                                          a hello instead before
//                                                                          the first grant
//                             request for a buffered message     RUNNING   flux or report again
//                             new request for an older message   RUNNING   none: roll back to the
//                                                                          checkpoint before it
//                             hello, tick or command of          RUNNING   hello that names it
//                               another coordinator; refusal
//                               that is not proven; END before
//                               the last step; a long wait
//                             proven tick of another             RUNNING
//                               coordinator, which becomes
//                               its coordinator
//                             two fluxes of a round, or two      FAILING
//                               ticks, that contradict each
//                               other: one is forged
//                             coordinator silent for patience    FAILING
//                             ABORT of its coordinator, its END  LEAVING   BYE
//                               after the last step, proven END
//                               or ABORT
// FAILING  ABORT              0.02 s passed                      FAILING   report FAILED
//                             ABORT                              LEAVING   BYE
//                             FAILED was sent 16 times           FINISHED
// LEAVING  nothing            END or ABORT again                 LEAVING   BYE
//                             request for a buffered message     LEAVING   flux or report again
//                             0.15 s passed                      FINISHED
// RUNNING                     pm_vitals_interval passed          RUNNING   vitals
// HELLO or                    hello of a later node of its name  the same  REFUSE to the sender
// RUNNING                     own failure, interrupt             FAILING
// HELLO to                    proven REFUSE of this node         FINISHED  BYE, if it took part and
// FAILING                                                                    keeps no checkpoint
// RUNNING                     proven tick of its coordinator     RUNNING   report of the first
//                               with a later run, nothing                  state
//                               granted
//
// A node that stays goes to HELLO where the table says FINISHED, but for a refusal and an
// interrupt, and where it says FAILING because the coordinator is silent. In HELLO it waits as long
// as it takes. A tick may say that the run is held: the node then asks for nothing until another
// tick or a request of the coordinator comes.
#include "lockstep/node.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/digest.h"
#include "base/progress.h"
#include "lockstep/lookahead.h"
#include "sim/step_controller.h"
#include "store/snapshot.h"

#define HELLO_INTERVAL 0.1   // s
#define HELLO_LATER 1.0      // s between two hellos of a node that stays, after HELLO_SOON
#define HELLO_SOON 3.0       // s
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
#define ASK_INTERVAL 0.01 // s between two questions of a node that takes part in a run

// After STEPS_AT_ONCE steps in a row the loop handles messages and checks whether it has to stop.
#define STEPS_AT_ONCE 16

// While steps are computed, a report follows the one before after at most the larger of these two
// times. Among many processes a report costs as much as a flux, and every step sends a flux anyway.
#define REPORT_INTERVAL 0.02 // s
#define REPORT_PAIR 0.000004 // s for each pair of a sender and a receiver

// --- transitions ---

// Enters another phase. The clock of the phase starts at the next poll, since handlers do not know
// the time.
static void enter(pm_lockstep_node *node, pm_node_phase next) {
    node->phase = next;
    node->until = node->next = 0;
}

// Returns true if the node looks for a run or takes part in one.
static bool takes_part(const pm_lockstep_node *node) {
    return node->phase == PM_NODE_HELLO || node->phase == PM_NODE_RUNNING;
}

void pm_lockstep_node_fail(pm_lockstep_node *node, pm_status code, const char *message) {
    if (takes_part(node)) {
        pm_endpoint_end(&node->endpoint, code, message);
        enter(node, PM_NODE_FAILING);
    }
}

// Enters FAILING if `status` is a failure. Message handlers, which cannot return a status, call
// this function.
static void check(pm_lockstep_node *node, pm_status status) {
    if (status != PM_OK) {
        pm_lockstep_node_fail(node, status, pm_error());
    }
}

// Publishes the question that waits for its time, if it has come. Returns the time at which it will
// come, s; INFINITY: none waits.
static double publish_question(pm_lockstep_node *node) {
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
    check(node, pm_identity_publish_hello(&node->endpoint.identity));
    return INFINITY;
}

// Publishes a hello that asks the instance `coordinator`: in HELLO at the next poll, later at once
// or ASK_INTERVAL after the last question.
static void ask(pm_lockstep_node *node, int64_t coordinator) {
    if (node->phase == PM_NODE_HELLO) {
        node->endpoint.identity.hello.coordinator = coordinator;
        node->next = node->endpoint.now; // the next poll says hello
        return;
    }
    // The node keeps a question to a new coordinator, and does not replace it by one to its own
    // coordinator, which may be dead.
    if (node->to_ask == 0 || coordinator != node->coordinator) {
        node->to_ask = coordinator;
    }
    publish_question(node);
}

// Waits for another run, with another session.
static void rejoin(pm_lockstep_node *node) {
    pm_endpoint_end(&node->endpoint, PM_OK, "");
    node->endpoint.session = node->coordinator = node->granted = node->to_ask = 0;
    node->endpoint.identity.hello.coordinator = 0;
    node->followed = (portmet_tick_t){0};
    node->failures = 0;
    node->late = node->held = false;
    pm_identity_renew(&node->endpoint.identity);
    enter(node, PM_NODE_HELLO);
}

// Returns the position of a neighbour among the peers of the vitals; NULL stands for the
// coordinator.
static int peer(const pm_lockstep_node *node, const pm_flux_link *link) {
    return link == NULL ? node->subsystems.nlink : (int)(link - node->subsystems.link);
}

// Notes that a message of a neighbour (NULL: of the coordinator) was used.
static void note_used(pm_lockstep_node *node, const pm_flux_link *link) {
    node->vitals.message.used[peer(node, link)] += 1;
    pm_waiting_note_used(&node->endpoint.waiting);
}

// --- checkpoints ---

// Lists the numbers of a checkpoint, the step first.
static void list(pm_serializer *serializer, long *step, pm_process_subsystems *subsystems) {
    pm_serializer_put_long(serializer, "step", step);
    pm_local_subsystems_record(subsystems->local, serializer);
}

// Saves the state of the subsystems after `step` steps to a checkpoint [size].
static void save_state(double *checkpoint, long step, pm_process_subsystems *subsystems) {
    pm_serializer serializer = pm_serializer_save("node", checkpoint);
    list(&serializer, &step, subsystems);
}

static double *newer(const pm_checkpoint_ring *ring) {
    return ring->state + ring->size;
}

// Sets `known` to true if the file holds checkpoints of the run with the number `session`. A node
// that stays may find those of the scene as it was before it was read again, and replaces them.
static pm_status has_session(const pm_lockstep_node *node, int64_t session, bool *known) {
    const pm_checkpoint_ring *ring = &node->checkpoints;
    int64_t found_session = 0;
    bool found = false;
    const pm_status status =
        ring->path == NULL ? PM_OK
                           : pm_snapshot_session(ring->path, &ring->key, &found_session, &found);
    *known = status == PM_OK && found && found_session == session;
    return node->stays ? PM_OK : status;
}

// --- steps ---

// Returns the key of the present round: its number, counted from the start of the run.
static int64_t round_key(const pm_lockstep_node *node) {
    return node->step * node->rounds + node->round;
}

static bool is_granted(const pm_lockstep_node *node) {
    return node->step < node->granted;
}

// Returns true if the flux of the next step's first round may be published before the step is
// granted, so that the neighbours have it when they are granted the step. This is impossible if the
// tick chooses the substeps. The flux of the first step waits for the first grant, which shows that
// every process listens.
static bool may_publish_ahead(const pm_lockstep_node *node) {
    return node->scene->physics.tolerance == 0 && node->granted > node->followed.first &&
           node->step == node->granted && node->step < node->endpoint.steps;
}

// Returns true if the next round may begin.
static bool may_start(const pm_lockstep_node *node) {
    return !node->started && (is_granted(node) || may_publish_ahead(node));
}

// Adds the step just completed to the report, which is published when it is full, when the last one
// is REPORT_INTERVAL old, or when the next grant waits for it.
static pm_status report(pm_lockstep_node *node) {
    const portmet_report_t head = {
        .session = node->endpoint.session,
        .coordinator = node->coordinator,
        .step = node->step,
        .time = pm_scene_time(node->scene, node->step),
    };
    PM_TRY(pm_reporter_add_step(&node->reporter, &head, &node->subsystems, node->want_state));
    const bool ahead = !node->held && node->fluxes_show_progress && may_publish_ahead(node);
    const bool awaited = !is_granted(node) && !ahead;
    if (!awaited && node->endpoint.now < node->report_at) {
        return PM_OK;
    }
    const double n = node->scene->network.nprocess;
    node->report_at = node->endpoint.now + fmax(REPORT_INTERVAL, REPORT_PAIR * n * n);
    return pm_reporter_flush(&node->reporter);
}

// Returns to the newest checkpoint of at most `step` steps, to compute again from there, and
// forgets later ones. Changes no state if there is none. Publishes the report being filled first.
static pm_status roll_back(pm_lockstep_node *node, int64_t step) {
    pm_checkpoint_ring *ring = &node->checkpoints;
    // The steps completed so far stay valid: report them.
    PM_TRY(pm_reporter_flush(&node->reporter));
    if (ring->path == NULL) {
        return PM_OK;
    }
    if ((double)step < newer(ring)[0]) {
        if (ring->state[0] < 0 || (double)step < ring->state[0]) {
            return PM_OK;
        }
        memcpy(newer(ring), ring->state, (size_t)ring->size * sizeof *ring->state);
        ring->state[0] = -1;
    }
    long found = 0;
    pm_serializer serializer = pm_serializer_restore("node", newer(ring));
    list(&serializer, &found, &node->subsystems);
    node->endpoint.attempt += 1;
    node->step = found;
    node->furthest = found > node->furthest ? found : node->furthest;
    node->round = 0;
    node->started = false;
    node->progressed = true;
    return found == node->followed.first ? report(node) : PM_OK;
}

// Takes the subsystems to the first step of a run, at the initial state or at the start that the
// tick names.
static void restart(pm_lockstep_node *node, const portmet_tick_t *tick) {
    pm_checkpoint_ring *ring = &node->checkpoints;
    pm_process_subsystems *subsystems = &node->subsystems;
    pm_local_subsystems_set_state(subsystems->local,
                                  tick->nstart > 0 ? tick->start : node->initial);
    pm_local_subsystems_set_step(subsystems->local, (long)tick->first);
    // Messages of the run before are forgotten.
    for (int i = 0; i < subsystems->nlink; ++i) {
        for (int k = 0; k < PM_INBOX_DEPTH; ++k) {
            subsystems->link[i].inbox_key[k] = -1;
        }
    }
    pm_resend_buffer_clear(&subsystems->sent);
    node->reporter.rows = 0;
    node->reporter.count = 0;
    pm_resend_buffer_clear(&node->reporter.sent);
    memset(node->requests, 0, (size_t)(node->subsystems.nlink + 1) * sizeof *node->requests);
    node->step = node->furthest = tick->first;
    node->round = 0;
    node->started = false;
    node->progressed = true;
    if (tick->nlive > 0) {
        memcpy(node->live, tick->live, (size_t)tick->nlive * sizeof *node->live);
    }
    if (ring->path != NULL) {
        ring->state[0] = -1;
        save_state(newer(ring), (long)tick->first, &node->subsystems);
    }
}

// Begins the run at the initial state, or at this process's last checkpoint of the session. The
// file is written if it is of another session, so that this process finds the session after a
// restart.
static pm_status begin(pm_lockstep_node *node) {
    pm_checkpoint_ring *ring = &node->checkpoints;
    int64_t session = node->endpoint.session;
    bool known;
    if (ring->path == NULL) {
        return report(node);
    }
    PM_TRY(has_session(node, session, &known));
    if (!known) {
        PM_TRY(pm_snapshot_save(ring->path, &ring->key, session, ring->state));
        return roll_back(node, INT64_MAX);
    }
    PM_TRY(pm_snapshot_load(ring->path, &ring->key, &session, ring->state, &known));
    for (int i = 0; i < 2; ++i) {
        const double step = ring->state[i * ring->size];
        if (step < -1 || step > (double)PM_STEPS_MAX) {
            return pm_fail(PM_EFILE, "%s: a snapshot of step %g", ring->path, step);
        }
    }
    return roll_back(node, INT64_MAX);
}

// Computes rounds until a grant or a neighbour's flux is missing, but at most STEPS_AT_ONCE steps.
static pm_status compute(pm_lockstep_node *node) {
    const int64_t end = node->step + STEPS_AT_ONCE;
    while (node->step < end && (node->started || may_start(node))) {
        if (!node->started) {
            // Begins a round: publishes what the other processes need, and computes the bulk terms.
            if (node->round == 0) {
                pm_local_subsystems_set_substeps(node->subsystems.local, node->substeps);
            }
            const portmet_flux_t head = {
                .session = node->endpoint.session,
                .step = node->step,
                .round = node->round,
                .time = pm_scene_time(node->scene, node->step),
            };
            PM_TRY(pm_process_subsystems_start_round(&node->subsystems, node->endpoint.transport,
                                                     round_key(node), &head));
            node->started = true;
            node->progressed = true;
        }
        if (!is_granted(node)) {
            return PM_OK;
        }
        bool used, complete;
        const bool coupled =
            pm_process_subsystems_couple(&node->subsystems, round_key(node), &used);
        node->progressed = node->progressed || used;
        if (!coupled) {
            return PM_OK;
        }
        PM_TRY(pm_process_subsystems_end_round(&node->subsystems, &complete));
        node->started = false;
        node->round += 1;
        if (!complete) {
            continue;
        }
        // Ends the step: keeps its state if a checkpoint is due, and reports it.
        pm_checkpoint_ring *ring = &node->checkpoints;
        node->step += 1;
        node->round = 0;
        node->furthest = node->step > node->furthest ? node->step : node->furthest;
        if (ring->path != NULL && node->step % ring->interval == 0) {
            memcpy(ring->state, newer(ring), (size_t)ring->size * sizeof *ring->state);
            save_state(newer(ring), (long)node->step, &node->subsystems);
            PM_TRY(pm_snapshot_save(ring->path, &ring->key, node->endpoint.session, ring->state));
        }
        PM_TRY(report(node));
    }
    return PM_OK;
}

// --- ticks ---
//
// A node follows the coordinator that has answered its last question (endpoint.h), and asks any
// other sender before it follows that one.

// The largest number of steps that a coordinator can have granted: it grants at most the lookahead
// beyond what every process has reported. A process that returns from a checkpoint may have
// reported up to an interval more than it knows of.
static int64_t most_granted(const pm_lockstep_node *node) {
    const pm_scene *scene = node->scene;
    const int64_t unknown = node->checkpoints.path == NULL ? 0 : pm_checkpoint_interval(scene);
    return node->furthest + unknown + pm_lookahead(scene);
}

// True if some coordinator of this scene can have sent a tick.
static bool is_sane(const pm_lockstep_node *node, const portmet_tick_t *tick) {
    const bool chosen = pm_physics_is_adaptive(&node->scene->physics);
    return tick->steps >= 0 && tick->steps <= PM_STEPS_MAX && tick->granted >= 0 &&
           tick->granted <= tick->steps && tick->instance != 0 && tick->first >= 0 &&
           tick->first <= tick->granted &&
           (tick->nstart == 0 || tick->nstart == node->scene->physics.nz) &&
           (!chosen || (tick->substeps >= 1 && tick->substeps <= PM_MOST_SUBSTEPS));
}

// Returns the number of substeps of the last step that a tick grants.
static int substeps_of(const pm_lockstep_node *node, const portmet_tick_t *tick) {
    return pm_physics_is_adaptive(&node->scene->physics) ? tick->substeps
                                                         : node->scene->physics.substeps;
}

// Takes over what a tick says of the run.
static void follow(pm_lockstep_node *node, const portmet_tick_t *tick) {
    pm_identity_renew(&node->endpoint.identity);
    node->endpoint.identity.hello.coordinator = tick->instance;
    node->followed = *tick;
    node->coordinator = tick->instance;
    node->to_ask = 0;
    node->coordinator_alive = true;
    node->endpoint.steps = tick->steps;
    node->granted = tick->granted;
    node->substeps = substeps_of(node, tick);
    node->want_state = tick->want_state != 0;
    node->held = tick->held != 0;
}

// A tick in HELLO. One that answers nothing only tells that there is a coordinator, which is asked
// at once. One that answers this node's hello lets it join the run, unless steps are granted
// already and this node has no checkpoint of the session.
static pm_drop hear_first(pm_lockstep_node *node, const portmet_tick_t *tick, bool answers) {
    // A tick of a run that this node was started for, with the same digest.
    const int64_t asked = node->endpoint.identity.hello.session;
    if (tick->served != asked || tick->session <= 0 ||
        tick->digest != (int64_t)node->endpoint.system->digest) {
        return PM_DROP_SESSION;
    }
    if (!is_sane(node, tick)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (!answers) {
        node->late = node->late || (tick->granted > tick->first && node->checkpoints.path == NULL);
        if (tick->instance != node->endpoint.identity.hello.coordinator) {
            ask(node, tick->instance);
        }
        return PM_DROP_SESSION;
    }
    bool known = false;
    if (tick->granted > tick->first) {
        check(node, has_session(node, tick->session, &known));
        node->late = !known;
    }
    if (node->phase != PM_NODE_HELLO || (tick->granted > tick->first && !known)) {
        return PM_DROP_SESSION;
    }
    node->endpoint.session = tick->session;
    node->progressed = true;
    enter(node, PM_NODE_RUNNING);
    follow(node, tick);
    note_used(node, NULL);
    if (tick->granted == tick->first && node->initial != NULL) {
        restart(node, tick);
    }
    if (tick->granted > tick->first) {
        // The hello reveals this node to another one of the same name, which may have missed its
        // earlier hellos.
        check(node, pm_identity_publish_hello(&node->endpoint.identity));
    }
    if (tick->dt != node->scene->physics.dt) {
        check(node,
              pm_fail(PM_ENET, "the coordinator's scene steps by %.17g s, this node's by %.17g s",
                      tick->dt, node->scene->physics.dt));
        return PM_KEEP;
    }
    check(node, begin(node));
    const int64_t most = most_granted(node);
    node->granted = node->granted < most ? node->granted : most;
    return PM_KEEP;
}

static pm_drop on_tick(void *context, const void *data, size_t size) {
    pm_lockstep_node *node = context;
    portmet_tick_t message = {.nanswer = node->scene->network.nprocess,
                              .answer = node->answers,
                              .nlive = node->scene->network.nlive,
                              .live = node->heard,
                              .nstart = node->scene->physics.nz,
                              .start = node->start};
    const portmet_tick_t *tick = &message;
    PM_TRY_KEEP(pm_tick_decode(&message, data, size));
    if (tick->nlive != node->scene->network.nlive) {
        return PM_DROP_COUNT;
    }
    const pm_identity *own = &node->endpoint.identity;
    const portmet_tick_t *followed = &node->followed;
    bool answers = false;
    for (int i = 0; i < tick->nanswer && tick->instance == own->hello.coordinator; ++i) {
        answers = answers || tick->answer[i] == own->hello.nonce;
    }
    if (node->phase == PM_NODE_HELLO) {
        return hear_first(node, tick, answers);
    }
    const bool later = node->phase == PM_NODE_RUNNING && tick->instance == node->coordinator &&
                       tick->run > node->followed.run;
    if (later && tick->granted == tick->first && tick->session > 0 && is_sane(node, tick) &&
        tick->digest == (int64_t)node->endpoint.system->digest &&
        tick->dt == node->scene->physics.dt && node->initial != NULL) {
        if (!answers) { // anybody may say that another run begins
            ask(node, tick->instance);
            return PM_DROP_RANGE;
        }
        pm_identity_renew(&node->endpoint.identity);
        node->endpoint.session = tick->session;
        follow(node, tick);
        note_used(node, NULL);
        restart(node, tick);
        check(node, begin(node));
        return PM_KEEP;
    }
    if (tick->session != node->endpoint.session || node->phase != PM_NODE_RUNNING) {
        return PM_DROP_SESSION;
    }
    if (!is_sane(node, tick) || tick->digest != (int64_t)node->endpoint.system->digest) {
        return PM_DROP_IMPLAUSIBLE;
    }
    const bool is_followed = tick->instance == followed->instance &&
                             tick->digest == followed->digest && tick->steps == followed->steps &&
                             tick->dt == followed->dt && tick->want_state == followed->want_state &&
                             tick->served == followed->served && tick->run == followed->run &&
                             tick->first == followed->first;
    if (!is_followed && !answers) {
        ask(node, tick->instance);
        return PM_DROP_RANGE;
    }
    // The constants of one coordinator never change.
    if (!is_followed && tick->instance == node->coordinator) {
        check(node, pm_fail(PM_ENET, "two ticks of the coordinator contradict each other, so that "
                                     "one is forged: give the scene a key_file"));
        return PM_DROP_CONFLICT;
    }
    if (!is_followed) {
        if (tick->granted > most_granted(node)) {
            return PM_DROP_IMPLAUSIBLE;
        }
        follow(node, tick);
        note_used(node, NULL);
        return PM_KEEP;
    }
    node->coordinator_alive = true;
    if (answers) {
        pm_identity_renew(&node->endpoint.identity);
    }
    if (tick->granted < node->granted) {
        return PM_DROP_REPEATED;
    }
    if (tick->granted > most_granted(node)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    node->held = tick->held != 0;
    // Two ticks that grant the same steps carry the same substeps and live inputs.
    const bool same = tick->granted == node->granted;
    const size_t live_size = (size_t)tick->nlive * sizeof *tick->live;
    if (same && pm_physics_is_adaptive(&node->scene->physics) && tick->substeps != node->substeps) {
        check(node, pm_fail(PM_ENET,
                            "two ticks grant step %lld with %d and with %d substeps, so "
                            "that one is forged: give the scene a key_file",
                            (long long)tick->granted, node->substeps, tick->substeps));
        return PM_DROP_CONFLICT;
    }
    if (same && node->granted > followed->first && live_size > 0 &&
        memcmp(node->live, tick->live, live_size) != 0) {
        check(node, pm_fail(PM_ENET,
                            "two ticks grant step %lld with different live inputs, so that one is "
                            "forged",
                            (long long)tick->granted));
        return PM_DROP_CONFLICT;
    }
    if (live_size > 0) {
        memcpy(node->live, tick->live, live_size);
    }
    node->granted = tick->granted;
    node->substeps = substeps_of(node, tick);
    note_used(node, NULL);
    return PM_KEEP;
}

// --- commands ---

// Ends a node that is no part of the run. Without checkpoints the coordinator knows which instance
// takes part, and ends the run if that one leaves.
static pm_drop accept_refusal(pm_lockstep_node *node, const portmet_command_t *command) {
    const pm_identity *own = &node->endpoint.identity;
    if (command->addressee != own->hello.instance) {
        return PM_DROP_SESSION;
    }
    if (node->phase >= PM_NODE_LEAVING) {
        return PM_KEEP;
    }
    if (!pm_identity_is_proven(own, command)) {
        if (node->phase == PM_NODE_RUNNING) {
            ask(node, node->coordinator);
        }
        return PM_DROP_RANGE;
    }
    if (node->phase == PM_NODE_RUNNING && node->checkpoints.path == NULL) {
        check(node, pm_reporter_notify(&node->reporter, node->endpoint.session, node->coordinator,
                                       PORTMET_REPORT_T_BYE, PM_OK, ""));
    }
    pm_endpoint_end(&node->endpoint, pm_endpoint_code(command->code), command->reason);
    node->phase = PM_NODE_FINISHED;
    return PM_KEEP;
}

// True if END or ABORT ends this node. If not, whoever sent it is asked, where that may help. A
// node that was restarted may not know that the last step is done, and a client may have stopped
// the run before.
static bool may_end(pm_lockstep_node *node, const portmet_command_t *command) {
    const bool proven = pm_identity_is_proven(&node->endpoint.identity, command);
    const bool abort = command->kind == PORTMET_COMMAND_T_ABORT;
    if (proven) {
        return true;
    }
    if (node->phase == PM_NODE_HELLO) {
        ask(node, command->instance);
    }
    if (node->phase != PM_NODE_RUNNING) {
        return abort && node->phase == PM_NODE_FAILING && command->instance == node->coordinator;
    }
    const bool done = node->step == node->endpoint.steps;
    if (command->instance == node->coordinator && (abort || done)) {
        return true;
    }
    ask(node, command->instance);
    return false;
}

static pm_drop on_command(void *context, const void *data, size_t size) {
    pm_lockstep_node *node = context;
    portmet_command_t message, *command = &message;
    PM_TRY_KEEP(pm_command_decode(command, data, size));
    const bool end = command->kind == PORTMET_COMMAND_T_END;
    if (command->kind == PORTMET_COMMAND_T_REFUSE) {
        return accept_refusal(node, command);
    }
    const bool addressed =
        command->addressee == 0 || command->addressee == node->endpoint.identity.hello.instance;
    // In HELLO the node belongs to the session that it was started for.
    const int64_t session = node->phase == PM_NODE_HELLO ? node->endpoint.identity.hello.session
                                                         : node->endpoint.session;
    if (!addressed || (command->session != session &&
                       !pm_identity_is_proven(&node->endpoint.identity, command))) {
        return PM_DROP_SESSION;
    }
    if (!end && command->kind != PORTMET_COMMAND_T_ABORT) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (node->phase < PM_NODE_LEAVING) {
        if (!may_end(node, command)) {
            return PM_DROP_RANGE;
        }
        if (!end && node->phase != PM_NODE_FAILING) {
            pm_endpoint_end(&node->endpoint, pm_endpoint_code(command->code), command->reason);
        }
        node->endpoint.session = command->session;
        node->coordinator = command->instance;
        enter(node, PM_NODE_LEAVING);
        check(node, pm_reporter_flush(&node->reporter));
    }
    // Every command is answered: the coordinator repeats it until it has received every BYE.
    check(node, pm_reporter_notify(&node->reporter, node->endpoint.session, command->instance,
                                   PORTMET_REPORT_T_BYE, PM_OK, ""));
    return PM_KEEP;
}

// --- hellos ---

// True if another node of this name was started later, and is to be refused for `reason` [256].
static bool is_to_refuse(const pm_lockstep_node *node, int64_t instance, char *reason) {
    snprintf(reason, 256, "there is a node %s of scene %s already", node->name, node->scene->name);
    return takes_part(node) && pm_identity_is_older(&node->endpoint.identity, instance);
}

// Refuses an instance. `nonce` is that of the hello that this answers; 0: it answers none.
static void refuse(pm_lockstep_node *node, int64_t session, int64_t instance, int64_t nonce,
                   char *reason) {
    check(node, pm_identity_publish_command(&node->endpoint.identity,
                                            (portmet_command_t){.session = session,
                                                                .addressee = instance,
                                                                .answer = nonce,
                                                                .kind = PORTMET_COMMAND_T_REFUSE,
                                                                .code = PM_ENET,
                                                                .reason = reason}));
}

static pm_drop on_hello(void *context, const void *data, size_t size) {
    pm_lockstep_node *node = context;
    const pm_identity *own = &node->endpoint.identity;
    char reason[256];
    portmet_hello_t message, *hello = &message;
    PM_TRY_KEEP(pm_hello_decode(hello, data, size));
    if (hello->sender[0] == 0 && hello->session != own->hello.session) {
        return PM_DROP_SESSION;
    }
    if (hello->sender[0] == 0) {
        // A coordinator that this node does not know is asked what it has to say.
        const int64_t known =
            node->phase == PM_NODE_HELLO ? own->hello.coordinator : node->coordinator;
        if (takes_part(node) && hello->instance != known) {
            ask(node, hello->instance);
        }
        return PM_KEEP;
    }
    if (pm_identity_is_rival(own, hello) && is_to_refuse(node, hello->instance, reason)) {
        refuse(node, hello->session, hello->instance, hello->nonce, reason);
    }
    return PM_KEEP;
}

// --- requests ---

// Tells new requests from old ones. Answering a request from a resend buffer costs little, but
// rolling back to a checkpoint costs steps. As a network may repeat or delay a request, and
// somebody may replay one, a process rolls back only for a request that is newer than all before it
// from the same sender, or that is repeated for so long that its sender must be waiting for it. The
// latter keeps a forged request, which looks newer than any real one, from hiding the real ones.
// The time for which a request that is not new must be repeated, s. A process that waits repeats
// its request at least every 0.1 s (endpoint.h).
#define REQUEST_TIME 0.5

// The age of a request follows from all earlier requests of its sender. A process rolls back for a
// new or an insistent request, but not for an old one.
typedef enum request_age {
    REQUEST_OLD,
    REQUEST_NEW,      // from an instance that was started later, of a later attempt, or for a later
                      // key
    REQUEST_INSISTENT // not new, but repeated for REQUEST_TIME
} request_age;

static bool is_later(const pm_request_place *a, const pm_request_place *b) {
    if (a->instance != b->instance) {
        return a->instance > b->instance;
    }
    return a->attempt != b->attempt ? a->attempt > b->attempt : a->key > b->key;
}

// Records a request for `key` at the time `now` (s), and returns its age.
static request_age age_of(pm_request_filter *filter, const portmet_request_t *request, int64_t key,
                          double now) {
    const pm_request_place place = {request->instance, request->attempt, key};
    if (is_later(&place, &filter->newest)) {
        filter->newest = place;
        filter->since = now;
        return REQUEST_NEW;
    }
    if (is_later(&place, &filter->repeated) || is_later(&filter->repeated, &place)) {
        filter->repeated = place;
        filter->since = now;
    }
    if (now - filter->since < REQUEST_TIME) {
        return REQUEST_OLD;
    }
    filter->since = now; // one answer for each such time
    return REQUEST_INSISTENT;
}

// Handles a request of the age `age` for a message of `step` that is no longer kept. Its sender was
// restarted or has rolled back, and this node rolls back, too. Without checkpoints nobody misses
// such a message, unless somebody believed a forged one; the run then cannot continue.
static pm_status recompute(pm_lockstep_node *node, const portmet_request_t *request,
                           request_age age, int64_t step) {
    if (age == REQUEST_OLD || node->phase != PM_NODE_RUNNING) {
        return PM_OK;
    }
    if (node->checkpoints.path != NULL) {
        return roll_back(node, step);
    }
    const bool stuck = pm_waiting_is_long(&node->endpoint.waiting);
    return age == REQUEST_INSISTENT && stuck
               ? pm_fail(PM_ENET,
                         "%s lacks a message on %s of step %lld, which is not kept any more, "
                         "because a message was forged: give the scene a key_file",
                         request->sender[0] == 0 ? "the coordinator" : request->sender,
                         request->channel, (long long)request->step)
               : PM_OK;
}

// Publishes a report again, or computes it again.
static pm_status answer_report(pm_lockstep_node *node, const portmet_request_t *request) {
    const int64_t step = request->step;
    bool kept;
    PM_TRY(pm_reporter_repeat(&node->reporter, step, &kept));
    if (kept) {
        node->vitals.message.answered[peer(node, NULL)] += 1;
    }
    if (request->sender[0] != 0) {
        return PM_OK;
    }
    const request_age age =
        age_of(&node->requests[peer(node, NULL)], request, step, node->endpoint.now);
    const bool missed = !kept && step <= node->step - node->reporter.rows;
    return missed ? recompute(node, request, age, step > node->followed.first ? step - 1 : step)
                  : PM_OK;
}

// Publishes a flux again, or computes it again.
static pm_status answer_flux(pm_lockstep_node *node, const portmet_request_t *request) {
    const int64_t key = request->step * node->rounds + request->round;
    pm_flux_link *link = NULL; // of the neighbour that asks
    for (int i = 0; i < node->subsystems.nlink && link == NULL; ++i) {
        pm_flux_link *one = &node->subsystems.link[i];
        link = strcmp(one->neighbour, request->sender) == 0 ? one : NULL;
    }
    const request_age age =
        link == NULL ? REQUEST_OLD
                     : age_of(&node->requests[peer(node, link)], request, key, node->endpoint.now);
    bool kept;
    PM_TRY(pm_resend_buffer_repeat(&node->subsystems.sent, node->endpoint.transport, key, &kept));
    if (kept) {
        node->vitals.message.answered[peer(node, link)] += 1;
        return PM_OK;
    }
    return key < round_key(node) ? recompute(node, request, age, request->step) : PM_OK;
}

static pm_drop on_request(void *context, const void *data, size_t size) {
    pm_lockstep_node *node = context;
    portmet_request_t message, *request = &message;
    PM_TRY_KEEP(pm_request_decode(request, data, size));
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
            ask(node, request->instance);
            return PM_DROP_RANGE;
        }
        node->coordinator_alive = true;
        node->held = node->held && request->step <= node->granted;
    }
    char reason[256];
    if (strcmp(request->sender, node->name) == 0 && is_to_refuse(node, request->instance, reason)) {
        refuse(node, request->session, request->instance, 0, reason);
    }
    if (strcmp(request->channel, node->reporter.sent.channel) == 0) {
        check(node, answer_report(node, request));
    }
    if (strcmp(request->channel, node->subsystems.sent.channel) == 0) {
        check(node, answer_flux(node, request));
    }
    return PM_KEEP;
}

// --- fluxes ---

static pm_drop on_flux(void *context, const void *data, size_t size) {
    pm_flux_link *link = context;
    pm_lockstep_node *node = link->node;
    const portmet_flux_t *flux = &link->scratch;
    PM_TRY_KEEP(pm_flux_decode(&link->scratch, data, size));
    if (node->phase != PM_NODE_RUNNING || flux->session != node->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (flux->round < 0 || flux->round >= node->rounds || flux->step < 0 ||
        flux->step > node->endpoint.steps || flux->time != pm_scene_time(node->scene, flux->step)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    const int64_t key = flux->step * node->rounds + flux->round;
    const pm_drop drop =
        pm_flux_link_keep(link, key, round_key(node), (node->step + 1) * node->rounds);
    if (drop == PM_KEEP) {
        note_used(node, link);
    }
    if (drop == PM_DROP_CONFLICT) {
        check(node, pm_fail(PM_ENET,
                            "two fluxes of %s for round %d of step %lld contradict each "
                            "other, so that one is forged: give the scene a key_file",
                            link->neighbour, flux->round, (long long)flux->step));
    }
    return drop;
}

// --- waiting ---

// The neighbour whose flux is missing; NULL if none is, so that only the coordinator is waited for.
static const pm_flux_link *missing_link(const pm_lockstep_node *node) {
    return node->started ? pm_process_subsystems_missing(&node->subsystems, round_key(node)) : NULL;
}

void pm_lockstep_node_begin_wait(pm_lockstep_node *node, double clock) {
    pm_vitals_rest(&node->vitals, clock - node->endpoint.presence.absent,
                   peer(node, missing_link(node)));
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
    // A coordinator whose processes rest speaks rarely, and some of its ticks may get lost.
    const bool rests = node->held && node->step >= node->granted;
    const double rest = 4 * pm_rest_interval(node->scene->network.nprocess);
    const double patience = fmax(node->scene->network.patience, rests ? rest : 0);
    if (pm_waiting_is_over(waiting, node->coordinator_heard, patience, now)) {
        if (node->stays) {
            rejoin(node);
            return PM_OK;
        }
        return pm_fail(PM_ETIMEOUT,
                       "no word from the coordinator for %.3g s, in round %d of step %lld",
                       now - waiting->since, node->round, (long long)node->step);
    }
    if (rests) {
        node->next = now + rest / 3; // if ticks get lost
        return pm_reporter_flush(&node->reporter);
    }
    if (!pm_waiting_request_due(waiting, now)) {
        node->next = waiting->next;
        return PM_OK;
    }
    // Ask the coordinator by a hello whether the run goes on as this node believes. Another
    // coordinator may lead the run, or this node may believe something wrong. Until all processes
    // are there, a question now and then shows that this one is. The answer is a tick, which all
    // processes hear: while one of them asks, the others need not, and wait a little longer, each
    // by another time.
    const double n = node->scene->network.nprocess;
    const double later = 1 + (double)(node->endpoint.identity.hello.instance & 1023) / 1024;
    const bool begins = node->granted == node->followed.first;
    const bool unheard = now >= node->coordinator_heard + later * LONG_ASK;
    const double pause = begins    ? EACH_ASK * n
                         : unheard ? LONG_ASK
                                   : fmax(LONG_ASK, EACH_LONG_ASK * n);
    if ((begins || pm_waiting_is_long(waiting)) && now >= node->asked_at + pause) {
        ask(node, node->coordinator);
    }
    if (node->step < node->endpoint.steps && !begins) {
        // While blocked, publish the partially filled report.
        PM_TRY(pm_reporter_flush(&node->reporter));
        // A missing flux is requested before a missing tick, since the grant may depend on the
        // flux.
        const pm_flux_link *missing = missing_link(node);
        const char *address =
            missing != NULL ? missing->address : node->endpoint.coordinator_address;
        const char *channel = missing != NULL ? missing->channel : node->endpoint.tick_channel;
        node->vitals.message.asked[peer(node, missing)] += 1;
        PM_TRY(pm_endpoint_request(&node->endpoint, address, channel, node->step, node->round));
    }
    node->next = waiting->next;
    return PM_OK;
}

static pm_status say_hello(pm_lockstep_node *node) {
    const pm_scene *scene = node->scene;
    if (node->endpoint.now >= node->until && node->late) {
        return pm_fail(PM_ETIMEOUT,
                       "a run of scene %s is under way, and there is no checkpoint of it here "
                       "with which %s could take part",
                       scene->name, node->name);
    }
    if (node->endpoint.now >= node->until) {
        return pm_fail(
            PM_ETIMEOUT, "no coordinator of scene %s with the same models answered within %.3g s%s",
            scene->name, scene->network.patience, pm_transport_reach(node->endpoint.transport));
    }
    if (node->endpoint.now >= node->next) {
        const bool later = node->stays && node->endpoint.now > node->waited + HELLO_SOON;
        node->next = node->endpoint.now + (later ? HELLO_LATER : HELLO_INTERVAL);
        PM_TRY(pm_identity_publish_hello(&node->endpoint.identity));
    }
    return PM_OK;
}

// --- a poll ---

// Sets the end of a phase that has just begun.
static void start_clock(pm_lockstep_node *node) {
    if (node->until != 0) {
        return;
    }
    const bool forever = node->phase == PM_NODE_HELLO && node->stays;
    const double duration = forever                          ? INFINITY
                            : node->phase == PM_NODE_HELLO   ? node->scene->network.patience
                            : node->phase == PM_NODE_LEAVING ? LEAVE_LINGER
                                                             : INFINITY;
    node->until = node->endpoint.now + duration;
    node->next = node->waited = node->endpoint.now;
}

// Ends the node, or takes one that stays to the next run.
static void finish(pm_lockstep_node *node) {
    if (node->stays) {
        rejoin(node);
    } else {
        node->phase = PM_NODE_FINISHED;
    }
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
        check(node, say_hello(node));
    }
    if (node->phase == PM_NODE_RUNNING) {
        check(node, compute(node));
        const pm_checkpoint_ring *ring = &node->checkpoints;
        check(node, pm_vitals_tell(&node->vitals, &node->endpoint, node->step,
                                   ring->path == NULL ? -1 : (int64_t)newer(ring)[0]));
    }
    if (node->phase == PM_NODE_RUNNING && may_start(node)) {
        node->next = now;
    } else if (node->phase == PM_NODE_RUNNING) {
        check(node, await(node));
    }
    const double question = publish_question(node);
    start_clock(node);
    // Repeats the report FAILED until the coordinator answers with ABORT or enough were sent.
    // Reports are counted, not time: a process that is paused meanwhile must not leave after a
    // single one, which the network may have lost.
    if (node->phase == PM_NODE_FAILING && now >= node->next) {
        if (node->failures == FAILED_COUNT) {
            finish(node);
        } else {
            node->next = now + FAILED_INTERVAL;
            node->failures += 1;
            // The first failure counts, even if it cannot be published.
            (void)pm_reporter_flush(&node->reporter);
            const portmet_hello_t *hello = &node->endpoint.identity.hello;
            (void)pm_reporter_notify(
                &node->reporter,
                node->endpoint.session != 0 ? node->endpoint.session : hello->session,
                node->coordinator != 0 ? node->coordinator : hello->coordinator,
                PORTMET_REPORT_T_FAILED, node->endpoint.status, node->endpoint.message);
        }
    }
    if (node->phase == PM_NODE_LEAVING) {
        node->next = node->until;
        if (now >= node->until) {
            finish(node);
        }
    }
    return node->phase == PM_NODE_FINISHED
               ? INFINITY
               : pm_endpoint_clock(&node->endpoint, fmin(node->next, question));
}

// --- opening ---

pm_status pm_lockstep_node_open(pm_lockstep_node **node, const pm_system *system, int process_id,
                                pm_transport *transport, const pm_lockstep_node_options *options) {
    static const pm_handlers handlers = {on_hello, on_command, on_request};
    const pm_lockstep_node_options plain = {0}, *given = options == NULL ? &plain : options;
    const pm_scene *scene = system->scene;
    const int more = given->checkpoint == NULL ? 0 : LATE_DEPTH;
    pm_lockstep_node *made = NULL;
    PM_TRY(PM_NEW(made, scene->network.process[process_id].name));
    pm_status status;
    pm_endpoint *endpoint = &made->endpoint;
    pm_process_subsystems *subsystems = &made->subsystems;
    pm_checkpoint_ring *ring = &made->checkpoints;
    pm_arena *arena = &made->arena;
    endpoint->system = system;
    endpoint->transport = transport;
    endpoint->arena = arena;
    made->scene = scene;
    made->stays = given->stays;
    made->initial = given->z;
    made->name = scene->network.process[process_id].name;
    made->live = given->live;
    made->alive = given->alive;
    made->alive_context = given->context;
    ring->path = given->checkpoint;
    PM_TRY_DONE(pm_process_subsystems_init(subsystems, arena, system, process_id, given->z,
                                           given->boundary_input, SENT_DEPTH + more));
    if (ring->path != NULL) {
        // The present state is the checkpoint of step 0; the file is written when the run begins.
        long start = 0;
        pm_serializer serializer = pm_serializer_count("node");
        list(&serializer, &start, subsystems);
        // A process of this name may have had others, whose states are as long.
        const pm_scene_process *process = &scene->network.process[process_id];
        for (int i = 0; i < process->count; ++i) {
            serializer.layout = pm_digest_text(
                serializer.layout, scene->physics.subsystem[process->subsystem[i]].name);
        }
        ring->interval = pm_checkpoint_interval(scene);
        ring->size = serializer.count;
        ring->key = (pm_snapshot_key){system->digest, serializer.layout, 2 * serializer.count,
                                      pm_checkpoint_owner(arena, scene, made->name)};
        ring->state = pm_arena_array(arena, 2 * (size_t)ring->size, sizeof *ring->state);
        PM_TRY_DONE(pm_arena_status(arena, "%s", ring->path));
        ring->state[0] = -1;
        save_state(newer(ring), start, subsystems);
    }
    made->answers = pm_arena_array(arena, (size_t)scene->network.nprocess, sizeof *made->answers);
    made->heard = pm_arena_array(arena, (size_t)scene->network.nlive, sizeof *made->heard);
    made->start = pm_arena_array(arena, (size_t)scene->physics.nz, sizeof *made->start);
    made->requests = pm_arena_array(arena, (size_t)subsystems->nlink + 1, sizeof *made->requests);
    PM_TRY_DONE(pm_vitals_init(&made->vitals, arena, scene, process_id, subsystems->nlink));
    made->rounds = pm_local_subsystems_most_rounds(subsystems->local);
    made->fluxes_show_progress = subsystems->nlink > 0 && pm_lookahead_uses_fluxes(scene);
    PM_TRY_DONE(pm_endpoint_open(endpoint, &handlers, made, made->name, given->session,
                                 ring->path != NULL));
    PM_TRY_DONE(pm_endpoint_subscribe(endpoint, endpoint->tick_channel, on_tick, made));
    for (int i = 0; i < subsystems->nlink; ++i) {
        pm_flux_link *link = &subsystems->link[i];
        link->node = made;
        made->vitals.message.peer[i] = link->process_id;
        PM_TRY_DONE(pm_endpoint_subscribe(endpoint, link->channel, on_flux, link));
    }
    PM_TRY_DONE(pm_reporter_init(&made->reporter, arena, system, process_id, transport,
                                 endpoint->identity.hello.instance, more));
    *node = made;
    return PM_OK;
done:
    pm_lockstep_node_close(made);
    return status;
}

void pm_lockstep_node_close(pm_lockstep_node *node) {
    if (node != NULL) {
        pm_process_subsystems_free(&node->subsystems);
        PM_DELETE(node);
    }
}

pm_status pm_lockstep_run_node(pm_lockstep_node *node, const volatile sig_atomic_t *stop) {
    double now = pm_clock();
    double next = pm_lockstep_node_poll(node, now);
    while (node->phase != PM_NODE_FINISHED) {
        pm_lockstep_node_begin_wait(node, pm_clock());
        const pm_status status = pm_endpoint_wait(&node->endpoint, next, now, stop);
        if (status == PM_EINTERRUPTED && node->stays) {
            node->stays = false; // no other run
            node->phase = node->phase == PM_NODE_HELLO ? PM_NODE_FINISHED : node->phase;
        }
        check(node, status);
        now = pm_clock();
        next = pm_lockstep_node_poll(node, now);
    }
    return pm_lockstep_node_result(node);
}

// --- questions ---

bool pm_lockstep_node_finished(const pm_lockstep_node *node) {
    return node->phase == PM_NODE_FINISHED;
}

pm_status pm_lockstep_node_result(const pm_lockstep_node *node) {
    return pm_endpoint_result(&node->endpoint);
}

const pm_drops *pm_lockstep_node_drops(const pm_lockstep_node *node) {
    return &node->endpoint.drops;
}
