// A node handles the ticks and commands of its coordinator. It follows the coordinator that has
// answered its last question (identity.h), and asks any other sender before it follows that one.
// node.h has the table of states.
#include "lockstep/node.h"

#include <string.h>

#include "lockstep/lookahead.h"
#include "sim/step_controller.h"

// --- plausibility ---

// The largest number of steps that a coordinator can have granted: it grants at most the lookahead
// beyond what every process has reported. A process that returns from a checkpoint may have
// reported up to an interval more than it knows of.
static int64_t most_granted(const pm_lockstep_node *node) {
    const pm_scene *scene = node->endpoint.system->scene;
    const int64_t unknown = node->checkpoints.path == NULL ? 0 : pm_checkpoint_ring_interval(scene);
    return node->furthest + unknown + pm_lookahead(scene);
}

// True if some coordinator of this scene can have sent a tick.
static bool is_sane(const pm_lockstep_node *node, const portmet_tick_t *tick) {
    const bool chosen = node->endpoint.system->scene->tolerance > 0;
    return tick->steps >= 0 && tick->steps <= PM_STEPS_MAX && tick->granted >= 0 &&
           tick->granted <= tick->steps && tick->t0 == 0 && tick->instance != 0 &&
           (!chosen || (tick->substeps >= 1 && tick->substeps <= PM_MOST_SUBSTEPS));
}

// True if a tick has the constants of those that this node follows.
static bool is_followed(const pm_lockstep_node *node, const portmet_tick_t *tick) {
    const portmet_tick_t *own = &node->followed;
    return tick->instance == own->instance && tick->digest == own->digest &&
           tick->steps == own->steps && tick->dt == own->dt &&
           tick->want_state == own->want_state && tick->open == own->open;
}

// --- joining ---

// True if a tick is of a run that this node was started for, with the same digest.
static bool fits(const pm_lockstep_node *node, const portmet_tick_t *tick) {
    const int64_t asked = node->endpoint.identity.hello.session;
    const bool wanted = asked == 0 ? tick->open : tick->session == asked;
    return wanted && tick->session > 0 && tick->digest == (int64_t)node->endpoint.system->digest;
}

// Takes over what a tick says of the run.
static void follow(pm_lockstep_node *node, const portmet_tick_t *tick) {
    const pm_scene *scene = node->endpoint.system->scene;
    pm_identity_renew(&node->endpoint.identity);
    node->endpoint.identity.hello.coordinator = tick->instance;
    node->followed = *tick;
    node->coordinator = tick->instance;
    node->to_ask = 0;
    node->coordinator_alive = true;
    node->endpoint.steps = tick->steps;
    node->granted = tick->granted;
    node->substeps = scene->tolerance > 0 ? tick->substeps : scene->substeps;
    node->want_state = tick->want_state != 0;
}

// Joins the run of a tick that answers this node's hello, unless steps are granted already and this
// node has no checkpoint of the session.
static pm_drop join(pm_lockstep_node *node, const portmet_tick_t *tick) {
    const double dt = node->endpoint.system->scene->dt;
    bool known = false;
    if (tick->granted > 0) {
        pm_node_check(node,
                      pm_checkpoint_ring_has_session(&node->checkpoints, tick->session, &known));
        node->late = !known;
    }
    if (node->phase != PM_NODE_HELLO || (tick->granted > 0 && !known)) {
        return PM_DROP_SESSION;
    }
    node->endpoint.session = tick->session;
    node->t0 = tick->t0;
    node->progressed = true;
    pm_node_enter(node, PM_NODE_RUNNING);
    follow(node, tick);
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
        return PM_KEEP;
    }
    pm_node_check(node, pm_node_start_run(node));
    const int64_t most = most_granted(node);
    node->granted = node->granted < most ? node->granted : most;
    return PM_KEEP;
}

// A tick in HELLO. One that answers nothing only tells that there is a coordinator, which is asked
// at once.
static pm_drop hear_first(pm_lockstep_node *node, const portmet_tick_t *tick, bool answers) {
    if (!fits(node, tick)) {
        return PM_DROP_SESSION;
    }
    if (!is_sane(node, tick)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (answers) {
        return join(node, tick);
    }
    node->late = node->late || (tick->granted > 0 && node->checkpoints.path == NULL);
    if (tick->instance != node->endpoint.identity.hello.coordinator) {
        pm_node_ask(node, tick->instance);
    }
    return PM_DROP_SESSION;
}

// --- ticks ---

// Takes over a tick of another coordinator, or with other constants, that answers this node's
// question. The constants of one coordinator never change.
static pm_drop change(pm_lockstep_node *node, const portmet_tick_t *tick) {
    if (tick->instance == node->coordinator) {
        pm_node_check(node, pm_fail(PM_ENET, "two ticks of the coordinator contradict each other, "
                                             "so that one is forged: give the scene a key_file"));
        return PM_DROP_CONFLICT;
    }
    const int64_t most = most_granted(node);
    if (tick->granted > most) {
        return PM_DROP_IMPLAUSIBLE;
    }
    follow(node, tick);
    return PM_KEEP;
}

// Takes the values of live inputs over from a tick. Two ticks that grant the same steps carry the
// same values; false: these do not.
static bool take_live(pm_lockstep_node *node, const portmet_tick_t *tick) {
    const size_t size = (size_t)tick->nlive * sizeof *tick->live;
    if (tick->granted == node->granted && node->granted > 0 && size > 0 &&
        memcmp(node->live, tick->live, size) != 0) {
        pm_node_check(node, pm_fail(PM_ENET,
                                    "two ticks grant step %lld with different live inputs, so that "
                                    "one is forged",
                                    (long long)tick->granted));
        return false;
    }
    if (size > 0) {
        memcpy(node->live, tick->live, size);
    }
    return true;
}

static pm_drop accept_tick(pm_lockstep_node *node, const portmet_tick_t *tick) {
    const pm_identity *own = &node->endpoint.identity;
    const bool answers = tick->instance == own->hello.coordinator &&
                         pm_identity_is_answer(own, tick->answer, tick->nanswer);
    if (node->phase == PM_NODE_HELLO) {
        return hear_first(node, tick, answers);
    }
    if (tick->session != node->endpoint.session || node->phase != PM_NODE_RUNNING) {
        return PM_DROP_SESSION;
    }
    if (!is_sane(node, tick) || tick->digest != (int64_t)node->endpoint.system->digest) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (!is_followed(node, tick)) {
        if (answers) {
            return change(node, tick);
        }
        pm_node_ask(node, tick->instance);
        return PM_DROP_RANGE;
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
    const pm_scene *scene = node->endpoint.system->scene;
    if (scene->tolerance > 0 && tick->granted == node->granted &&
        tick->substeps != node->substeps) {
        pm_node_check(node, pm_fail(PM_ENET,
                                    "two ticks grant step %lld with %d and with %d substeps, so "
                                    "that one is forged: give the scene a key_file",
                                    (long long)tick->granted, node->substeps, tick->substeps));
        return PM_DROP_CONFLICT;
    }
    if (!take_live(node, tick)) {
        return PM_DROP_CONFLICT;
    }
    node->granted = tick->granted;
    node->substeps = scene->tolerance > 0 ? tick->substeps : scene->substeps;
    return PM_KEEP;
}

void pm_node_on_tick(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_node *node = context;
    portmet_tick_t tick = {.nanswer = node->endpoint.system->scene->nprocess,
                           .answer = node->answers,
                           .nlive = node->endpoint.system->scene->nlive,
                           .live = node->heard};
    const pm_drop drop = pm_tick_decode(&tick, data, size);
    const pm_drop used = drop == PM_KEEP ? accept_tick(node, &tick) : drop;
    if (used == PM_KEEP) {
        pm_node_note_used(node, NULL);
    }
    pm_endpoint_count(&node->endpoint, used);
}

// --- commands ---

// Ends a node that is no part of the run. Without checkpoints the coordinator knows which instance
// takes part, and ends the run if that one leaves.
static pm_drop accept_refusal(pm_lockstep_node *node, const portmet_command_t *command) {
    const pm_identity *own = &node->endpoint.identity;
    if (!pm_identity_is_addressed(own, command)) {
        return PM_DROP_SESSION;
    }
    if (pm_lockstep_node_leaving(node)) {
        return PM_KEEP;
    }
    if (!pm_identity_is_proven(own, command)) {
        if (node->phase == PM_NODE_RUNNING) {
            pm_node_ask(node, node->coordinator);
        }
        return PM_DROP_RANGE;
    }
    if (node->phase == PM_NODE_RUNNING && node->checkpoints.path == NULL) {
        pm_node_check(node, pm_reporter_notify(&node->reporter, node->endpoint.session,
                                               node->coordinator, PORTMET_REPORT_T_BYE, PM_OK, ""));
    }
    pm_endpoint_end(&node->endpoint, pm_endpoint_code(command->code), command->reason);
    node->phase = PM_NODE_FINISHED;
    return PM_KEEP;
}

// True if END or ABORT ends this node. If not, whoever sent it is asked, where that may help. A
// node that was restarted may not know that the last step is done.
static bool may_end(pm_lockstep_node *node, const portmet_command_t *command) {
    const bool proven = pm_identity_is_proven(&node->endpoint.identity, command);
    const bool abort = command->kind == PORTMET_COMMAND_T_ABORT;
    const bool keeps = node->checkpoints.path != NULL;
    if (proven) {
        return abort || keeps;
    }
    if (node->phase == PM_NODE_HELLO) {
        pm_node_ask(node, command->instance);
    }
    if (node->phase != PM_NODE_RUNNING) {
        return abort && node->phase == PM_NODE_FAILING && command->instance == node->coordinator;
    }
    const bool done = node->step == node->endpoint.steps;
    if (command->instance == node->coordinator && (abort || done)) {
        return true;
    }
    if (abort || keeps) {
        pm_node_ask(node, command->instance);
    }
    return false;
}

static pm_drop accept_command(pm_lockstep_node *node, const portmet_command_t *command) {
    const bool end = command->kind == PORTMET_COMMAND_T_END;
    if (command->kind == PORTMET_COMMAND_T_REFUSE) {
        return accept_refusal(node, command);
    }
    const bool addressed =
        command->addressee == 0 || pm_identity_is_addressed(&node->endpoint.identity, command);
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
    if (!pm_lockstep_node_leaving(node)) {
        if (!may_end(node, command)) {
            return PM_DROP_RANGE;
        }
        if (!end && node->phase != PM_NODE_FAILING) {
            pm_endpoint_end(&node->endpoint, pm_endpoint_code(command->code), command->reason);
        }
        node->endpoint.session = command->session;
        node->coordinator = command->instance;
        pm_node_enter(node, PM_NODE_LEAVING);
        pm_node_check(node, pm_reporter_flush(&node->reporter));
    }
    // Every command is answered: the coordinator repeats it until it has received every BYE.
    pm_node_check(node, pm_reporter_notify(&node->reporter, node->endpoint.session,
                                           command->instance, PORTMET_REPORT_T_BYE, PM_OK, ""));
    return PM_KEEP;
}

pm_drop pm_node_accept_command(void *context, const portmet_command_t *command) {
    return accept_command(context, command);
}
