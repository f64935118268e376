// A coordinator: the messages that it handles, its steps, and its polls.
//
// The state machine. `patience` is a key of the scene, in s. A coordinator that is started with a
// checkpoint begins in STEPPING with a tick. A tick and a
// command that answer a hello repeat its nonce (endpoint.h). Hellos and notices (FAILED, BYE) of
// processes count only if they name this coordinator, which shows that they are not of an earlier
// run. "The observer" is the set of functions in coordinator.h.
//
// state      awaits             message or time-out              next       sends
// ---------  -----------------  -------------------------------  ---------  ---------------------
// GATHERING  every process's    0.1 s passed                     GATHERING  hello
//            report of step 0   hello with another digest        CLOSING    REFUSE to the sender
//                               every report has arrived         STEPPING   tick, ledger
// STEPPING   reports of         every report of a step arrived   STEPPING   tick, ledger
//            granted steps,     flux that shows progress         STEPPING   tick if it may grant
//            or fluxes that     request for a tick               STEPPING   tick
//            show progress      no further step may be granted   HELD       tell the observer
//                               every report of the last step    CLOSING    ledger
// HELD       somebody who asks  pm_lockstep_coordinator_hold     STEPPING   tick
//            for more; live     every value of the next step     STEPPING   tick
//            inputs; the clock    has arrived
//                               the next step is due             STEPPING   tick
//                               time to request (endpoint.h),     HELD       tick, as a sign of
//                                 or to tick (health.h)                     life
// any of                        1 s passed                       the same   health
// these                         hello that names another         the same   hello
// three                           coordinator, or none
//                               hello of a process that fits     the same   tick
//                               time to request, not HELD        the same   request for fluxes,
//                                                                           then for reports
//                               a process silent for 2 s         the same   tell the observer
//                               a process silent for patience    CLOSING
//                               no progress in 3 patience,       CLOSING
//                                 though every process sends
//                               report FAILED; own failure       CLOSING
//                               two reports of a step that       CLOSING
//                                 contradict each other; BYE:
//                                 a message was forged
//                               hello of a later coordinator     the same   REFUSE to the sender
//                               REFUSE that answers its hello    FINISHED
// CLOSING    BYE of every       0.02 s passed                    CLOSING    END, or ABORT
//            process            hello                            CLOSING    END; after a failure
//                                                                             REFUSE
//                               every BYE, or END or ABORT       FINISHED
//                                 was sent 11 times
#include "lockstep/coordinator.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/rng.h"
#include "lockstep/lookahead.h"
#include "transport/channel.h"

#define HELLO_INTERVAL 0.1 // s
#define PAUSE 2.0   // s of silence that the observer is told of, at least, or half the patience
#define MOST_IDLE 3 // times the patience without progress, though all processes show life
#define TICK_EACH 0.00004     // s between two ticks before the first step, for each process
#define LIVE_WAIT 1.0         // s of waiting for a live input that the observer is told of
#define COMMAND_INTERVAL 0.02 // s between repetitions of END or ABORT
#define COMMAND_COUNT 10      // repetitions at most
#define LEDGER_INTERVAL 0.001 // s between two ledger messages at least
#define FLUSH_AFTER 0.2       // s for which the run was held when the observer flushes its files

// --- state ---

static bool is_running(const pm_lockstep_coordinator *c) {
    return c->phase < PM_COORDINATOR_CLOSING;
}

static int64_t least(int64_t a, int64_t b) {
    return a < b ? a : b;
}

// Returns true if no further step is granted until somebody asks for it. The processes then rest.
static bool may_rest(const pm_lockstep_coordinator *c) {
    const int64_t most = least(c->hold_at, c->endpoint.steps);
    return c->granted >= most && (c->stays || most < c->endpoint.steps);
}

// Enters a phase. In CLOSING processes receive END if the endpoint's status is PM_OK, and ABORT
// otherwise.
static void enter(pm_lockstep_coordinator *c, pm_coordinator_phase phase) {
    if (phase == PM_COORDINATOR_CLOSING && c->phase != phase) {
        c->next = c->endpoint.now;
    }
    if (phase == PM_COORDINATOR_HELD && c->phase != phase) {
        c->held_at = c->endpoint.now;
        c->flushed = false;
        if (may_rest(c) && c->granted < c->endpoint.steps && c->observer.hold != NULL) {
            c->observer.hold(c->observer.context, (long)c->completed);
        }
    }
    c->phase = phase;
}

void pm_lockstep_coordinator_fail(pm_lockstep_coordinator *c, pm_status code, const char *message) {
    if (is_running(c)) {
        pm_endpoint_end(&c->endpoint, code, message);
        enter(c, PM_COORDINATOR_CLOSING);
    }
}

// Ends the run if `status` is a failure. Message handlers, which cannot return a status, call this
// function.
static void check(pm_lockstep_coordinator *c, pm_status status) {
    if (status != PM_OK) {
        pm_lockstep_coordinator_fail(c, status, pm_error());
    }
}

// Returns the number of steps that may be granted when the reports of the first `complete` steps
// have arrived. It is at most `complete` plus the lookahead, and at most the number that who holds
// the run, the pace and the live inputs allow. If fluxes show progress, it is also at most a window
// beyond the slowest process.
static int64_t grant_limit(const pm_lockstep_coordinator *c, int64_t complete) {
    const int window = c->scene->network.window;
    int64_t limit = least(complete + c->lookahead, c->endpoint.steps);
    limit = least(limit, c->hold_at > complete ? c->hold_at : complete);
    limit = least(limit, pm_pace_limit(&c->pace, c->endpoint.now));
    if (pm_live_inputs_awaited(&c->live) != NULL) {
        limit = least(limit, c->granted);
    }
    for (int i = 0; c->hears_fluxes && i < c->nremote; ++i) {
        const int64_t done = c->remote[i].done;
        limit = least(limit, (done > complete ? done : complete) + window);
    }
    return limit;
}

// Returns the number of steps that every process has completed, as far as reports and fluxes show.
static int64_t steps_shown(const pm_lockstep_coordinator *c) {
    int64_t shown = INT64_MAX;
    for (int i = 0; i < c->nremote; ++i) {
        shown = least(shown, c->remote[i].done);
    }
    return shown > c->completed ? shown : c->completed;
}

// --- checkpoint ---

// Lists the numbers of the checkpoint: first the steps completed, and the step at which the run is
// held, or -1.
static void list(pm_lockstep_coordinator *c, pm_serializer *serializer, long *completed) {
    long hold = c->hold_at == INT64_MAX ? -1 : (long)c->hold_at;
    pm_serializer_put_long(serializer, "completed", completed);
    pm_serializer_put_long(serializer, "hold", &hold);
    pm_ledger_record(&c->ledger, serializer);
    if (c->observer.record != NULL) {
        c->observer.record(c->observer.context, serializer);
    }
}

// Continues from the checkpoint file if it holds a checkpoint of the session `wanted` (0: of any
// session). Otherwise writes a first checkpoint, so that a restarted coordinator knows the session
// of this run. Does nothing without a checkpoint file.
static pm_status load_checkpoint(pm_lockstep_coordinator *c, int64_t wanted) {
    int64_t session;
    bool found;
    long completed = -1;
    c->interval = pm_checkpoint_interval(c->scene);
    if (c->checkpoint == NULL || c->stays) { // one that stays ends with its runs
        return PM_OK;
    }
    pm_serializer serializer = pm_serializer_count("coordinator");
    list(c, &serializer, &completed);
    c->checkpoint_key =
        (pm_snapshot_key){c->endpoint.system->digest, serializer.layout, serializer.count,
                          pm_checkpoint_owner(&c->arena, c->scene, "coordinator")};
    c->checkpoint_state =
        pm_arena_array(&c->arena, (size_t)serializer.count, sizeof *c->checkpoint_state);
    PM_TRY(pm_arena_status(&c->arena, "the coordinator"));
    PM_TRY(pm_snapshot_session(c->checkpoint, &c->checkpoint_key, &session, &found));
    if (!found || (wanted > 0 && wanted != session)) {
        c->checkpoint_state[0] = -1; // no step is complete
        c->checkpoint_state[1] = c->hold_at == INT64_MAX ? -1 : (double)c->hold_at;
        return pm_snapshot_save(c->checkpoint, &c->checkpoint_key, c->endpoint.session,
                                c->checkpoint_state);
    }
    PM_TRY(pm_snapshot_load(c->checkpoint, &c->checkpoint_key, &c->endpoint.session,
                            c->checkpoint_state, &found));
    if (c->checkpoint_state[0] < -1 || c->checkpoint_state[0] > (double)c->endpoint.steps) {
        return pm_fail(PM_EFILE, "%s: a snapshot of step %g, the run has %lld", c->checkpoint,
                       c->checkpoint_state[0], (long long)c->endpoint.steps);
    }
    c->completed = (int64_t)c->checkpoint_state[0];
    if (c->hold_at < INT64_MAX && c->checkpoint_state[1] < (double)PM_STEPS_MAX) {
        const double hold = c->checkpoint_state[1];
        c->hold_at = hold < 0 ? INT64_MAX : (int64_t)hold;
    }
    if (c->completed < 0) {
        return PM_OK;
    }
    serializer = pm_serializer_restore("coordinator", c->checkpoint_state);
    list(c, &serializer, &completed);
    c->granted = grant_limit(c, c->completed);
    c->tick_wanted = true;
    enter(c, PM_COORDINATOR_STEPPING);
    return c->observer.resume == NULL ? PM_OK : c->observer.resume(c->observer.context, completed);
}

// --- messages ---
//
// Handlers only store what a message says and note which answer it needs; the next poll acts on it.

static pm_remote_process *find_remote(const pm_lockstep_coordinator *c, const char *name) {
    for (int i = 0; i < c->nremote; ++i) {
        if (strcmp(c->remote[i].name, name) == 0) {
            return &c->remote[i];
        }
    }
    return NULL;
}

// --- hellos ---

// Returns true if this instance is among the last of the process whose hello fitted the run.
static bool is_greeted(const pm_remote_process *remote, int64_t instance) {
    for (int i = 0; i < PM_REMOTE_GREETED; ++i) {
        if (remote->greeted[i] == instance) {
            return true;
        }
    }
    return false;
}

// Answers the hello of a process with a command.
static void answer(pm_lockstep_coordinator *c, const portmet_hello_t *hello, int8_t kind,
                   pm_status code, const char *reason) {
    const portmet_command_t command = {.session = c->endpoint.session,
                                       .addressee = hello->instance,
                                       .answer = hello->nonce,
                                       .kind = kind,
                                       .code = (int8_t)code,
                                       .reason = (char *)reason};
    check(c, pm_identity_publish_command(&c->endpoint.identity, command));
}

// Refuses the sender of a hello. A node that does not fit ends a run that has not begun; a run that
// is under way (`late`) goes on without it.
static pm_drop refuse(pm_lockstep_coordinator *c, const portmet_hello_t *hello, const char *reason,
                      bool late) {
    answer(c, hello, PORTMET_COMMAND_T_REFUSE, PM_ENET, reason);
    if (!late) {
        check(c, pm_fail(PM_ENET, "%s", reason));
    }
    return PM_KEEP;
}

// Writes into `reason` [256] why a second instance of a process is refused. Without checkpoints no
// other instance can take the place of the one that has reported the initial state.
static void say_second(const pm_remote_process *remote, char *reason) {
    snprintf(reason, 256,
             "node %s: the run goes on without it; only runs with --checkpoint take a node back",
             remote->name);
}

static pm_drop greet_node(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    char reason[512];
    pm_remote_process *remote = find_remote(c, hello->sender);
    if (remote == NULL) {
        return PM_DROP_IMPLAUSIBLE; // no process has a channel for such a hello
    }
    const bool late =
        pm_report_window_has(&c->reports, c->first, remote->id) || c->completed >= c->first;
    const portmet_hello_t *own = &c->endpoint.identity.hello;
    reason[0] = 0;
    if (hello->protocol != own->protocol) {
        snprintf(reason, sizeof reason,
                 "node %s speaks another version of the protocol: %016" PRIx64
                 ", expected %016" PRIx64,
                 hello->sender, (uint64_t)hello->protocol, (uint64_t)own->protocol);
    } else if (hello->digest != own->digest) {
        snprintf(reason, sizeof reason,
                 "node %s holds another scene, weights or initial state: digest %016" PRIx64
                 ", expected %016" PRIx64,
                 hello->sender, (uint64_t)hello->digest, (uint64_t)own->digest);
    } else if (hello->checkpoint != own->checkpoint) {
        snprintf(reason, sizeof reason,
                 "node %s keeps a checkpoint every %" PRId64 " steps, the run every %" PRId64
                 " (0: none): give all of them --checkpoint, or none, and the same `lockstep`",
                 hello->sender, hello->checkpoint, own->checkpoint);
    }
    if (reason[0] != 0) {
        // An instance that has said otherwise before did not send this.
        return is_greeted(remote, hello->instance) ? PM_DROP_CONFLICT
                                                   : refuse(c, hello, reason, late);
    }
    if (late && c->checkpoint == NULL && hello->instance != remote->instance) {
        say_second(remote, reason);
        if (c->stays) { // the process that died takes part in the next run again
            const double silent = c->endpoint.now - remote->heard;
            check(c, silent > pm_health_silence(c->nremote, may_rest(c))
                         ? pm_fail(PM_ENET, "%s", reason)
                         : PM_OK);
            return PM_DROP_SESSION;
        }
        return refuse(c, hello, reason, true);
    }
    if (!is_greeted(remote, hello->instance)) {
        memmove(remote->greeted + 1, remote->greeted,
                (PM_REMOTE_GREETED - 1) * sizeof remote->greeted[0]);
        remote->greeted[0] = hello->instance;
    }
    remote->alive = true;
    // The next tick answers this hello. If there are too many, the sender repeats it.
    int i = 0;
    while (i < c->nanswer && c->answer[i] != hello->nonce) {
        ++i;
    }
    if (i == c->nanswer && i < c->nremote) {
        c->answer[c->nanswer++] = hello->nonce;
    }
    c->tick_wanted = true;
    return PM_KEEP;
}

static pm_drop on_hello(void *context, const void *data, size_t size) {
    pm_lockstep_coordinator *c = context;
    const pm_identity *own = &c->endpoint.identity;
    portmet_hello_t message, *hello = &message;
    PM_TRY_KEEP(pm_hello_decode(hello, data, size));
    const bool of_process = hello->sender[0] != 0;
    if (hello->session != own->hello.session) {
        return PM_DROP_SESSION;
    }
    if (!is_running(c)) {
        // A process that joins or returns during the end of the run need not wait for a tick.
        if (!of_process || c->phase != PM_COORDINATOR_CLOSING || c->stays) {
            return PM_DROP_REPEATED;
        }
        const bool failed = c->endpoint.status != PM_OK;
        answer(c, hello, failed ? PORTMET_COMMAND_T_REFUSE : PORTMET_COMMAND_T_END,
               c->endpoint.status, c->endpoint.message);
        return PM_KEEP;
    }
    if (!of_process) {
        const bool first = c->completed >= c->first || pm_identity_is_older(own, hello->instance);
        if (first && pm_identity_is_rival(own, hello)) {
            char reason[256];
            snprintf(reason, sizeof reason, "there is a coordinator of scene %s already",
                     c->scene->name);
            answer(c, hello, PORTMET_COMMAND_T_REFUSE, PM_ENET, reason);
        }
        return PM_KEEP;
    }
    // A process must name this coordinator: that shows that its hello is not one of an earlier run.
    if (hello->coordinator != own->hello.instance) {
        c->hello_wanted = true;
        return PM_KEEP;
    }
    return greet_node(c, hello);
}

// --- commands ---

// Handles commands. A coordinator receives its own commands, too; it reacts only to a refusal that
// names it.
static pm_drop on_command(void *context, const void *data, size_t size) {
    pm_lockstep_coordinator *c = context;
    portmet_command_t command;
    PM_TRY_KEEP(pm_command_decode(&command, data, size));
    if (is_running(c) && command.kind == PORTMET_COMMAND_T_REFUSE &&
        pm_identity_is_proven(&c->endpoint.identity, &command)) {
        pm_endpoint_end(&c->endpoint, PM_ENET, command.reason);
        enter(c, PM_COORDINATOR_FINISHED);
    }
    return PM_KEEP;
}

// --- reports ---

static void note_done(pm_remote_process *remote, int64_t steps) {
    remote->done = steps > remote->done ? steps : remote->done;
}

// Takes the steps of a report that are still missing. Its first step must be granted; the later
// ones may have been granted by a coordinator that died since.
static pm_drop accept_done(pm_remote_process *remote) {
    pm_lockstep_coordinator *c = remote->coordinator;
    const int64_t first = remote->report.step;
    if (first < 0 || first > c->endpoint.steps ||
        remote->report.time != pm_scene_time(remote->scene, (long)first)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (first > c->granted) {
        return PM_DROP_RANGE;
    }
    remote->moved = remote->moved || first != remote->reported;
    remote->reported = first;
    pm_drop drop = PM_DROP_REPEATED;
    for (int row = 0; row < remote->rows; ++row) {
        // Another report of this step, one of the last PM_REMOTE_SEEN, must have the same numbers.
        const uint64_t digest = pm_wire_digest(&pm_report_type, &remote->report, row, remote->rows);
        const int slot = (int)((first + row) % PM_REMOTE_SEEN);
        if (remote->seen_step[slot] == first + row && remote->seen[slot] != digest) {
            check(c, pm_fail(PM_ENET,
                             "two reports of %s on step %lld contradict each other, "
                             "so that one is forged: give the scene a key_file",
                             remote->name, (long long)(first + row)));
            return PM_DROP_CONFLICT;
        }
        remote->seen_step[slot] = first + row;
        remote->seen[slot] = digest;
        note_done(remote, first + row);
        if (pm_report_window_add(&c->reports, remote, row)) {
            // Processes may come one by one: the patience with the others begins anew.
            c->progressed = c->progressed || c->completed < c->first;
            drop = PM_KEEP;
        }
    }
    if (drop == PM_KEEP) {
        pm_waiting_note_used(&c->endpoint.waiting);
    }
    return drop;
}

// True if a report may come from the instance that takes part in the run; without checkpoints there
// is only one. Another one that has said hello is refused.
static bool is_from_run(pm_remote_process *remote) {
    pm_lockstep_coordinator *c = remote->coordinator;
    const portmet_report_t *report = &remote->report;
    const bool greeted = is_greeted(remote, report->instance);
    if (!pm_report_window_has(&c->reports, c->first, remote->id) && c->completed < c->first &&
        greeted) {
        remote->instance = report->instance;
    }
    if (c->checkpoint != NULL || report->instance == remote->instance) {
        return true;
    }
    if (greeted) {
        char reason[256];
        say_second(remote, reason);
        check(c, pm_identity_publish_command(&c->endpoint.identity,
                                             (portmet_command_t){.session = report->session,
                                                                 .addressee = report->instance,
                                                                 .kind = PORTMET_COMMAND_T_REFUSE,
                                                                 .code = PM_ENET,
                                                                 .reason = reason}));
    }
    return false;
}

// A failure, or a BYE: only of a process that follows this coordinator, for it may be one of an
// earlier run. A process that leaves in the middle of the run was told to by somebody else.
static pm_drop accept_notice(pm_remote_process *remote) {
    pm_lockstep_coordinator *c = remote->coordinator;
    const portmet_report_t *report = &remote->report;
    const bool failed = report->kind == PORTMET_REPORT_T_FAILED;
    // Every process that fails says why.
    if ((!failed && report->kind != PORTMET_REPORT_T_BYE) || (failed && report->message[0] == 0) ||
        report->coordinator != c->endpoint.identity.hello.instance) {
        return PM_DROP_IMPLAUSIBLE;
    }
    const bool other = remote->instance != 0 && report->instance != remote->instance;
    if (c->checkpoint == NULL && other) {
        return PM_DROP_REPEATED; // a second instance of the process
    }
    if (failed) {
        const pm_status code = pm_endpoint_code(report->code);
        check(c, pm_fail(c->stays && code == PM_EINTERRUPTED ? PM_ENET : code, "node %s failed: %s",
                         remote->name, report->message));
        return PM_KEEP;
    }
    if (is_running(c)) {
        check(c, pm_fail(PM_ENET,
                         "node %s left the run, because a command was forged: give "
                         "the scene a key_file",
                         remote->name));
    }
    remote->left = true;
    return PM_KEEP;
}

static pm_drop on_report(void *context, const void *data, size_t size) {
    pm_remote_process *remote = context;
    pm_lockstep_coordinator *c = remote->coordinator;
    const portmet_report_t *report = &remote->report;
    PM_TRY_KEEP(pm_remote_process_decode(remote, data, size, c->want_state));
    if (report->session != c->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (report->digest != (int64_t)c->endpoint.system->digest) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (report->kind != PORTMET_REPORT_T_DONE) {
        return accept_notice(remote);
    }
    if (!is_from_run(remote)) {
        return PM_DROP_REPEATED;
    }
    remote->alive = true;
    return accept_done(remote);
}

// --- fluxes ---

// A process that publishes a flux of step n has completed n steps.
static pm_drop on_progress(void *context, const void *data, size_t size) {
    pm_remote_process *remote = context;
    const portmet_flux_t *flux = &remote->flux;
    PM_TRY_KEEP(pm_flux_decode(&remote->flux, data, size));
    if (flux->session != remote->coordinator->endpoint.session) {
        return PM_DROP_SESSION;
    }
    if (flux->round != 0 || flux->step < 0 ||
        flux->time != pm_scene_time(remote->scene, (long)flux->step)) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (flux->step > remote->coordinator->granted) {
        return PM_DROP_RANGE;
    }
    remote->alive = true;
    remote->moved = remote->moved || flux->step > remote->done;
    note_done(remote, flux->step);
    return PM_KEEP;
}

// --- requests ---

static pm_drop on_request(void *context, const void *data, size_t size) {
    pm_lockstep_coordinator *c = context;
    portmet_request_t request;
    PM_TRY_KEEP(pm_request_decode(&request, data, size));
    if (request.session != c->endpoint.session) {
        return PM_DROP_SESSION;
    }
    pm_remote_process *remote = find_remote(c, request.sender);
    if (remote != NULL) {
        const int64_t asked[4] = {request.instance, request.attempt, request.step, request.round};
        remote->alive = true;
        remote->moved = remote->moved || memcmp(remote->asked, asked, sizeof asked) != 0;
        memcpy(remote->asked, asked, sizeof asked);
    }
    if (strcmp(request.channel, c->endpoint.tick_channel) == 0 && request.step < c->granted) {
        c->tick_wanted = true;
    }
    return PM_KEEP;
}

static pm_drop on_vitals(void *context, const void *data, size_t size) {
    pm_lockstep_coordinator *c = context;
    PM_TRY_KEEP(pm_health_take(&c->health, data, size, c->endpoint.now));
    // A process that waits among many others asks rarely.
    c->remote[c->health.vitals.process].alive = true;
    return PM_KEEP;
}

// --- sending ---

static pm_status publish_tick(pm_lockstep_coordinator *c) {
    const portmet_tick_t message = {
        .session = c->endpoint.session,
        .instance = c->endpoint.identity.hello.instance,
        .digest = (int64_t)c->endpoint.system->digest,
        .granted = c->granted,
        .steps = c->endpoint.steps,
        .dt = c->scene->physics.dt,
        .substeps = c->step_controller.substeps,
        .want_state = c->want_state,
        .served = c->endpoint.identity.hello.session,
        .run = c->run,
        .held = may_rest(c),
        .nanswer = c->nanswer,
        .answer = c->answer,
        .nlive = c->scene->network.nlive,
        .live = (double *)pm_live_inputs_values(&c->live, c->granted - 1),
        .nstart = c->starts_anywhere && c->granted == c->first ? c->scene->physics.nz : 0,
        .first = c->first,
        .start = c->start,
    };
    const size_t size = pm_tick_encode(&message, c->tick_data, c->tick_capacity);
    c->tick_wanted = false;
    c->ticked_at = c->endpoint.now;
    c->nanswer = 0;
    return pm_transport_publish(c->endpoint.transport, c->endpoint.tick_channel, c->tick_data,
                                size);
}

// --- steps ---

static pm_status publish_ledger(pm_lockstep_coordinator *c, const pm_sample *sample) {
    c->ledger_at = c->endpoint.now + LEDGER_INTERVAL;
    const portmet_ledger_t message = {
        .session = c->endpoint.session,
        .step = sample->step,
        .time = sample->time,
        .energy = c->ledger.energy,
        .entropy = c->ledger.entropy,
        .energy_residual = sample->energy_residual,
        .entropy_residual = sample->entropy_residual,
        .violations = c->ledger.violations,
    };
    unsigned char data[128];
    const size_t size = pm_ledger_encode(&message, data, sizeof data);
    if (size == 0) {
        return pm_fail(PM_ENUMERIC, "the ledger is not finite after step %ld", sample->step);
    }
    return pm_transport_publish(c->endpoint.transport, c->ledger_channel, data, size);
}

static pm_status book(pm_lockstep_coordinator *c, pm_sample *sample) {
    if (c->sums) {
        pm_tally *tally = pm_report_window_tally(&c->reports, sample->step);
        pm_tally_add_ports(tally, c->endpoint.system, sample, c->nbetween, c->between);
        PM_TRY(pm_ledger_add_sums(&c->ledger, sample, tally));
    } else {
        PM_TRY(pm_ledger_add_sample(&c->ledger, sample));
    }
    sample->live = pm_live_inputs_values(&c->live, sample->step - 1);
    pm_pace_note(&c->pace, sample->step, c->endpoint.now);
    return c->observer.step != NULL ? c->observer.step(c->observer.context, sample) : PM_OK;
}

// Books the steps up to `complete`, whose reports are all there: enters each sample in the ledger,
// hands it to the observer and saves the checkpoint if due. Publishes the ledger of the last one.
static pm_status book_steps(pm_lockstep_coordinator *c, int64_t complete) {
    while (c->completed < complete) {
        c->completed += 1;
        pm_sample *sample = pm_report_window_sample(&c->reports, c->completed);
        pm_tally tally = {0};
        if (c->completed > c->booked) {
            PM_TRY(book(c, sample));
        } else if (c->from_outside) { // the state was set after its step had been booked
            if (!c->sums) {
                pm_tally_add_subsystems(&tally, c->endpoint.system, sample);
            }
            pm_ledger_note_outside(
                &c->ledger, c->sums ? pm_report_window_tally(&c->reports, sample->step) : &tally);
        }
        const bool last = c->completed == c->endpoint.steps;
        if (c->checkpoint != NULL && !c->stays && (last || c->completed % c->interval == 0)) {
            // Saves the checkpoint, after the recording up to this step.
            long completed = (long)c->completed;
            pm_serializer serializer = pm_serializer_save("coordinator", c->checkpoint_state);
            list(c, &serializer, &completed);
            if (c->observer.flush != NULL) {
                PM_TRY(c->observer.flush(c->observer.context));
            }
            PM_TRY(pm_snapshot_save(c->checkpoint, &c->checkpoint_key, c->endpoint.session,
                                    c->checkpoint_state));
        }
        if (c->completed == complete && (last || c->endpoint.now >= c->ledger_at)) {
            PM_TRY(publish_ledger(c, sample));
        }
        if (c->want_state && c->completed == complete) {
            const pm_physics *physics = &c->scene->physics;
            const size_t n = (size_t)physics->nsubsystem * sizeof(double);
            memcpy(c->last->z, sample->z, (size_t)physics->nz * sizeof *sample->z);
            memcpy(c->last->energy, sample->energy, n);
            memcpy(c->last->entropy, sample->entropy, n);
            memcpy(c->last->bulk_energy, sample->bulk_energy, n);
            memcpy(c->last->bulk_entropy, sample->bulk_entropy, n);
            for (int i = 0; i < physics->nport; ++i) {
                memcpy(c->last->flux[i], sample->flux[i], sizeof sample->flux[i]);
            }
        }
        pm_report_window_advance(&c->reports, c->completed);
    }
    return PM_OK;
}

// Grants steps first, so that the processes compute them while this one books the complete steps.
// The run is held when every granted step is complete, since only who holds it, the pace or a live
// input withholds the next one.
static pm_status complete_steps(pm_lockstep_coordinator *c) {
    const bool live = c->scene->network.nlive_input > 0;
    const int64_t complete =
        pm_report_window_complete(&c->reports, c->completed, c->endpoint.steps);
    if (complete > c->completed) {
        c->progressed = true;
        pm_step_controller_note(&c->step_controller,
                                pm_report_window_sample(&c->reports, complete));
    }
    // Publish a tick if more steps may be granted than before.
    if (complete >= c->first) {
        pm_pace_begin(&c->pace, c->endpoint.now);
    }
    if (live && c->granted < c->endpoint.steps && !may_rest(c)) {
        PM_TRY(pm_live_inputs_check(&c->live, c->endpoint.now));
    }
    const int64_t limit = grant_limit(c, complete);
    if (complete >= c->first && limit > c->granted) {
        c->progressed = true;
        c->granted = limit;
        if (live) {
            pm_live_inputs_take(&c->live);
        }
        PM_TRY(publish_tick(c));
    }
    const pm_status status = book_steps(c, complete);
    c->failed = status != PM_OK;
    const bool over = c->completed >= c->endpoint.steps;
    const bool held = c->completed == c->granted && (c->stays || !over);
    enter(c, c->completed < c->first ? PM_COORDINATOR_GATHERING
             : held                  ? PM_COORDINATOR_HELD
                                     : PM_COORDINATOR_STEPPING);
    // Once a wait for a live input has lasted LIVE_WAIT, tell the observer, one time, which channel
    // is silent.
    const char *awaited = c->phase == PM_COORDINATOR_HELD ? pm_live_inputs_awaited(&c->live) : NULL;
    if (awaited == NULL) {
        c->live_until = c->endpoint.now + LIVE_WAIT;
    } else if (c->endpoint.now >= c->live_until && c->observer.warn != NULL) {
        char text[128];
        c->live_until = INFINITY;
        snprintf(text, sizeof text, "the run waits after step %lld for a message on %s",
                 (long long)c->completed, awaited);
        c->observer.warn(c->observer.context, text);
    }
    if (c->live.disputed != NULL && !c->live_disputed && c->observer.warn != NULL) {
        char text[160];
        c->live_disputed = true;
        snprintf(text, sizeof text,
                 "two messages on %s have other values for step %lld, and the first ones hold: is "
                 "there more than one sender?",
                 c->live.disputed, (long long)c->live.disputed_step);
        c->observer.warn(c->observer.context, text);
    }
    if (status == PM_OK && over && !c->stays) {
        enter(c, PM_COORDINATOR_CLOSING);
    }
    // While the run is held no further sample comes, with which a recording would be flushed.
    if (status == PM_OK && c->phase == PM_COORDINATOR_HELD && !c->flushed &&
        c->endpoint.now > c->held_at + FLUSH_AFTER && c->observer.flush != NULL) {
        c->flushed = true;
        return c->observer.flush(c->observer.context);
    }
    return status;
}

// Prepares the next run of a coordinator that stays, whose session is another. It waits for the
// reports of the initial state.
static void renew(pm_lockstep_coordinator *c, int64_t steps, bool want_state,
                  const pm_lockstep_point *from) {
    const double now = c->endpoint.now;
    const int64_t first = from == NULL ? 0 : from->step;
    c->endpoint.session = pm_lockstep_session();
    c->endpoint.steps = steps > 0 ? steps : PM_STEPS_MAX;
    pm_endpoint_end(&c->endpoint, PM_OK, "");
    c->run += 1;
    c->want_state = want_state;
    c->sums = pm_scene_may_report_sums(c->scene) && !want_state;
    c->phase = PM_COORDINATOR_GATHERING;
    c->first = first;
    c->completed = first - 1;
    c->granted = first;
    c->commands = 0;
    c->failed = c->fluxes_requested = false;
    c->progressed = c->tick_wanted = true;
    c->ticked_at = c->ledger_at = 0;
    c->hello_at = now + HELLO_INTERVAL;
    c->nanswer = 0;
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *remote = &c->remote[i];
        remote->done = first - 1;
        remote->moved = true;
        remote->left = false;
        memset(remote->seen_step, -1, sizeof remote->seen_step);
    }
    pm_report_window_restart(&c->reports, first);
    if (from == NULL) {
        pm_ledger_init(&c->ledger, c->endpoint.system);
        (void)pm_step_controller_init(&c->step_controller, c->scene); // it succeeded before
        pm_live_inputs_set(&c->live, NULL, false);
    } else {
        c->ledger = from->ledger;
        c->step_controller.substeps = from->substeps;
        c->step_controller.expected = from->expected_error;
        // The values that held last hold on.
        pm_live_inputs *live = &c->live;
        const int last = (int)((live->next + 1) % 2);
        memcpy(live->taken[1 - last], live->taken[last],
               (size_t)c->scene->network.nlive * sizeof *live->taken[last]);
        live->next = first;
    }
    c->pace.begun = -1;
    c->pace.first = first;
    c->booked = from == NULL ? -1 : first;
    c->pace.late = 0;
    c->pace.latest = 0;
    c->health.message.session = c->endpoint.session;
    c->health.message.steps = c->endpoint.steps;
    c->health.step_before = 0;
}

void pm_lockstep_coordinator_begin(pm_lockstep_coordinator *c, const pm_lockstep_order *order) {
    renew(c, order->steps, order->want_state, order->from);
    c->from_outside = order->from_outside;
    c->waits = false;
    c->observer = order->observer;
    c->pace.interval = order->pace > 0 ? c->scene->physics.dt / order->pace : 0;
    c->starts_anywhere = order->z != NULL;
    c->hold_at = INT64_MAX;
    if (order->z != NULL) {
        memcpy(c->start, order->z, (size_t)c->scene->physics.nz * sizeof *c->start);
    }
}

void pm_lockstep_coordinator_hold(pm_lockstep_coordinator *c, int64_t step) {
    const bool rested = c->phase == PM_COORDINATOR_HELD && c->granted >= c->hold_at;
    if (rested && step > c->granted && c->pace.begun >= 0) {
        c->pace.begun += c->endpoint.now - c->held_at; // held time is no delay
    }
    c->hold_at = step;
    c->was_held = true;
    c->tick_wanted = c->tick_wanted || step <= c->granted;
    if (c->checkpoint != NULL && !c->stays && is_running(c)) {
        c->checkpoint_state[1] = step == INT64_MAX ? -1 : (double)step;
        check(c, pm_snapshot_save(c->checkpoint, &c->checkpoint_key, c->endpoint.session,
                                  c->checkpoint_state));
    }
}

// --- waiting ---

// Writes into `list` [size] the names of the processes whose reports of the next step are missing
// and, unless `patience` (s) is negative, that have been silent for longer than that; "" if none.
static void list_missing(const pm_lockstep_coordinator *c, double patience, char *list,
                         size_t size) {
    size_t used = 0;
    list[0] = 0;
    for (int i = 0; i < c->nremote && used < size; ++i) {
        const pm_remote_process *remote = &c->remote[i];
        if (pm_report_window_has(&c->reports, c->completed + 1, remote->id) ||
            (patience >= 0 &&
             !pm_waiting_is_over(&c->endpoint.waiting, remote->heard, patience, c->endpoint.now))) {
            continue;
        }
        const int length =
            snprintf(list + used, size - used, "%s%s", used > 0 ? ", " : "", remote->name);
        used += length < 0 ? 0 : (size_t)length;
    }
}

// Tells the observer when the run begins to pause because `silent` are silent, and when it goes on.
static void tell_pause(pm_lockstep_coordinator *c, bool paused, const char *silent) {
    if (c->observer.pause != NULL && paused != c->paused) {
        c->observer.pause(c->observer.context, silent);
    }
    c->paused = paused;
}

// Requests what is missing. If fluxes show progress, the first request of a wait is for the fluxes
// that the next grant needs; neighbours may miss these, too. A blocked process publishes its
// partial report, so that later requests are for reports. While the run is held nothing is missing,
// and a tick shows the processes that the coordinator is alive.
static pm_status request_missing(pm_lockstep_coordinator *c) {
    if (c->phase == PM_COORDINATOR_HELD) {
        return publish_tick(c);
    }
    // A process that rests does not ask for a tick that was lost.
    if (c->stays || c->was_held) {
        PM_TRY(publish_tick(c));
    }
    const bool fluxes = c->hears_fluxes && !c->fluxes_requested && c->granted > c->first;
    const int64_t shown = c->granted - c->scene->network.window; // by every process
    bool any = false;
    c->fluxes_requested = true;
    for (int i = 0; i < c->nremote && fluxes; ++i) {
        const pm_remote_process *remote = &c->remote[i];
        if (remote->done <= shown && remote->flux.nend > 0) {
            any = true;
            PM_TRY(pm_endpoint_request(&c->endpoint, remote->address, remote->flux_channel,
                                       shown + 1, 0));
        }
    }
    const int64_t step = c->completed + 1;
    for (int i = 0; i < c->nremote && !any; ++i) {
        const pm_remote_process *remote = &c->remote[i];
        // Before the first step, only processes that have said hello have something to send.
        const bool here = c->phase != PM_COORDINATOR_GATHERING || remote->greeted[0] != 0;
        if (here && !pm_report_window_has(&c->reports, step, remote->id)) {
            PM_TRY(pm_endpoint_request(&c->endpoint, remote->address, remote->channel, step, 0));
        }
    }
    return PM_OK;
}

// Tells the observer of a pause, fails if a process has been silent for too long or all show life
// but none makes progress, and requests what is missing.
static pm_status await(pm_lockstep_coordinator *c) {
    if (c->progressed) {
        pm_waiting_start(&c->endpoint.waiting, c->endpoint.now);
        c->progressed = c->fluxes_requested = false;
        tell_pause(c, false, "");
    }
    char names[512];
    const bool rests = c->phase == PM_COORDINATOR_HELD && may_rest(c);
    const double now = c->endpoint.now, vitals = pm_vitals_interval(c->nremote);
    const double silence = rests ? pm_health_silence(c->nremote, true) : fmax(PAUSE, 2 * vitals);
    const double patience = fmax(c->scene->network.patience, rests ? 2 * silence : 0);
    const double since = c->endpoint.waiting.since, waited = now - since;
    // Processes may come to a coordinator that stays whenever they like.
    if (c->phase == PM_COORDINATOR_GATHERING && c->waits) {
        return pm_waiting_request_due(&c->endpoint.waiting, now) ? request_missing(c) : PM_OK;
    }
    list_missing(c, fmin(silence, patience / 2), names, sizeof names);
    if (names[0] != 0) {
        tell_pause(c, true, names);
    }
    list_missing(c, patience, names, sizeof names);
    if (names[0] != 0) {
        // A node on another host is not missing for a reason of its own if nothing leaves this one.
        return c->phase == PM_COORDINATOR_GATHERING
                   ? pm_fail(PM_ETIMEOUT, "nodes missing after %.3g s: %s%s", waited, names,
                             pm_transport_reach(c->endpoint.transport))
                   : pm_fail(PM_ETIMEOUT, "no word for %.3g s, in step %lld, from: %s", waited,
                             (long long)steps_shown(c), names);
    }
    const double idle = now - fmax(c->moved, since);
    if (c->phase != PM_COORDINATOR_HELD && idle > MOST_IDLE * patience) {
        list_missing(c, -1, names, sizeof names);
        return pm_fail(
            PM_ETIMEOUT,
            "no progress for %.3g s, in step %lld, though all processes are alive; reports are "
            "missing from: %s",
            idle, (long long)steps_shown(c), names);
    }
    if (rests) {
        return now >= c->ticked_at + pm_rest_interval(c->nremote) ? publish_tick(c) : PM_OK;
    }
    return pm_waiting_request_due(&c->endpoint.waiting, now) ? request_missing(c) : PM_OK;
}

int pm_lockstep_coordinator_present(const pm_lockstep_coordinator *c) {
    int count = 0;
    for (int i = 0; i < c->nremote; ++i) {
        count += c->completed >= c->first || c->remote[i].greeted[0] != 0;
    }
    return count;
}

// --- the end ---

// Repeats END or ABORT until every process has sent BYE or a short time has passed.
static void close_run(pm_lockstep_coordinator *c) {
    // Book the steps that processes reported only after the run failed or was interrupted. A
    // failure in one of these steps came first, and becomes the reason for the end of the run.
    if (!c->failed && c->completed >= c->first) {
        const int64_t complete =
            pm_report_window_complete(&c->reports, c->completed, c->endpoint.steps);
        const pm_status status = book_steps(c, complete);
        if (status != PM_OK) {
            c->failed = true;
            pm_endpoint_end(&c->endpoint, status, pm_error());
        }
    }
    bool all_left = true;
    for (int i = 0; i < c->nremote; ++i) {
        all_left = all_left && c->remote[i].left;
    }
    bool done = all_left;
    if (!done && c->endpoint.now >= c->next) {
        c->next = c->endpoint.now + COMMAND_INTERVAL;
        // A node that does not receive it gives up by itself.
        const bool failed = c->endpoint.status != PM_OK;
        (void)pm_identity_publish_command(
            &c->endpoint.identity,
            (portmet_command_t){.session = c->endpoint.session,
                                .kind = failed ? PORTMET_COMMAND_T_ABORT : PORTMET_COMMAND_T_END,
                                .code = (int8_t)c->endpoint.status,
                                .reason = c->endpoint.message});
        c->commands += 1;
        done = c->commands > COMMAND_COUNT;
    }
    if (done && c->stays && c->endpoint.status != PM_EINTERRUPTED) {
        renew(c, 0, c->want_state, NULL); // the processes join anew
        c->waits = c->hello_wanted = true;
        c->starts_anywhere = false;
        c->hold_at = 0;
        c->observer = (pm_lockstep_observer){0};
        for (int i = 0; i < c->nremote; ++i) {
            pm_remote_process *remote = &c->remote[i];
            remote->instance = 0;
            memset(remote->greeted, 0, sizeof remote->greeted);
        }
    } else if (done) {
        enter(c, PM_COORDINATOR_FINISHED);
    }
}

// --- health ---

// Publishes once a second how the run is doing, and tells the observer. A run that is held or
// pauses because somebody is silent has no other reason to wait.
static pm_status tell_health(pm_lockstep_coordinator *c) {
    char text[256];
    c->health.message.held =
        c->phase == PM_COORDINATOR_HELD && !c->waits && c->completed < c->endpoint.steps;
    if (!pm_health_is_due(&c->health, c->completed, c->endpoint.now)) {
        return PM_OK;
    }
    if (c->observer.health != NULL) {
        c->observer.health(c->observer.context, &c->health.message);
    }
    while (c->observer.warn != NULL && c->completed > 0 && c->phase != PM_COORDINATOR_HELD &&
           !c->paused && pm_health_warn(&c->health, text, sizeof text)) {
        c->observer.warn(c->observer.context, text);
    }
    const size_t size = pm_health_encode(&c->health.message, c->health.data, c->health.capacity);
    return pm_transport_publish(c->endpoint.transport, c->health.channel, c->health.data, size);
}

// --- a poll ---

// Returns the time, in s, from which a tick may answer hellos.
static double next_tick(const pm_lockstep_coordinator *c) {
    return c->phase == PM_COORDINATOR_GATHERING ? c->ticked_at + TICK_EACH * c->nremote : 0;
}

double pm_lockstep_coordinator_poll(pm_lockstep_coordinator *c, double clock) {
    pm_endpoint_look(&c->endpoint, clock);
    const double now = c->endpoint.now;
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *remote = &c->remote[i];
        remote->heard = remote->alive ? now : remote->heard;
        c->moved = remote->moved ? now : c->moved;
        remote->alive = remote->moved = false;
    }
    if (is_running(c)) {
        // A hello at the start, again and again until the initial state is known, and when a
        // process asked for another coordinator.
        const bool due = c->phase == PM_COORDINATOR_GATHERING && now >= c->hello_at;
        if (due || c->hello_wanted) {
            c->hello_wanted = false;
            c->hello_at = now + HELLO_INTERVAL;
            check(c, pm_identity_publish_hello(&c->endpoint.identity));
        }
    }
    if (is_running(c)) {
        check(c, complete_steps(c));
    }
    // One tick answers all requests for it since the last poll, or since the last tick while many
    // processes join: every tick wakes all of them.
    if (is_running(c) && c->tick_wanted && now >= next_tick(c)) {
        check(c, publish_tick(c));
    }
    if (is_running(c)) {
        check(c, await(c));
        check(c, tell_health(c));
    }
    if (c->phase == PM_COORDINATOR_CLOSING) {
        close_run(c);
    }
    if (!is_running(c)) {
        return c->phase == PM_COORDINATOR_CLOSING ? pm_endpoint_clock(&c->endpoint, c->next)
                                                  : INFINITY;
    }
    const bool rests = c->phase == PM_COORDINATOR_HELD && may_rest(c);
    const double next =
        rests ? c->ticked_at + pm_rest_interval(c->nremote) : c->endpoint.waiting.next;
    const double tick = c->tick_wanted ? next_tick(c) : INFINITY;
    const double due = pm_pace_due(&c->pace, c->granted);
    const double first = fmin(next, tick);
    return pm_endpoint_clock(&c->endpoint, due > now ? fmin(first, due) : first);
}

// --- opening ---

int64_t pm_lockstep_session(void) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    const uint64_t nanoseconds = (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
    pm_rng rng;
    pm_rng_init(&rng, nanoseconds, (uint64_t)getpid());
    return (int64_t)(pm_rng_bits(&rng) >> 1 | 1);
}

pm_status pm_lockstep_coordinator_open(pm_lockstep_coordinator **coordinator,
                                       const pm_system *system, pm_transport *transport,
                                       const pm_lockstep_coordinator_options *options) {
    static const pm_handlers handlers = {on_hello, on_command, on_request};
    const pm_scene *scene = system->scene;
    pm_status status;
    pm_lockstep_coordinator *c = NULL;
    PM_TRY(PM_NEW(c, "a coordinator"));
    const pm_lockstep_coordinator_options plain = {0};
    const pm_lockstep_coordinator_options *given = options == NULL ? &plain : options;
    c->endpoint.system = system;
    c->endpoint.arena = &c->arena;
    c->scene = system->scene;
    c->endpoint.transport = transport;
    c->observer = given->observer;
    c->checkpoint = given->checkpoint;
    c->want_state = given->want_state;
    c->endpoint.session = given->session > 0 ? given->session : pm_lockstep_session();
    c->endpoint.steps = given->steps > 0 ? given->steps : system->scene->run.steps;
    c->completed = c->booked = -1;
    c->run = 1;
    c->stays = c->waits = given->stays;
    c->hold_at = c->stays || given->held ? 0 : INT64_MAX;
    c->was_held = given->held;
    c->progressed = c->hello_wanted = true;
    c->nremote = system->scene->network.nprocess;
    if (c->endpoint.steps > PM_STEPS_MAX) {
        PM_TRY_DONE(pm_fail(PM_ECONFIG, "scene %s: %lld steps, at most %lld", scene->name,
                            (long long)c->endpoint.steps, (long long)PM_STEPS_MAX));
    }
    c->lookahead = pm_lookahead(scene);
    c->hears_fluxes = pm_lookahead_uses_fluxes(scene);
    pm_ledger_init(&c->ledger, c->endpoint.system);
    PM_TRY_DONE(pm_step_controller_init(&c->step_controller, scene));
    c->sums = pm_scene_may_report_sums(scene) && !c->want_state;
    c->between = pm_arena_array(&c->arena, (size_t)scene->physics.nport, sizeof *c->between);
    PM_TRY_DONE(pm_arena_status(&c->arena, "the coordinator"));
    for (int i = 0; i < scene->physics.nport; ++i) {
        if (pm_port_crosses_processes(scene, &scene->physics.port[i])) {
            c->between[c->nbetween++] = i;
        }
    }
    c->remote = pm_arena_array(&c->arena, (size_t)c->nremote, sizeof *c->remote);
    const size_t nstart = c->stays ? (size_t)scene->physics.nz : 0;
    c->tick_capacity = pm_tick_size(&(portmet_tick_t){
        .nanswer = c->nremote, .nlive = scene->network.nlive, .nstart = (int32_t)nstart});
    c->tick_data = pm_arena_alloc(&c->arena, c->tick_capacity);
    c->answer = pm_arena_array(&c->arena, (size_t)c->nremote, sizeof *c->answer);
    c->start = pm_arena_array(&c->arena, nstart, sizeof *c->start);
    PM_TRY_DONE(pm_arena_status(&c->arena, "the coordinator"));
    for (int i = 0; i < c->nremote; ++i) {
        c->remote[i].coordinator = c;
        PM_TRY_DONE(pm_remote_process_init(&c->remote[i], &c->arena, scene, i));
    }
    PM_TRY_DONE(pm_sample_new(&c->last, scene));
    c->pace = pm_pace_of(scene);
    PM_TRY_DONE(pm_live_inputs_open(&c->live, scene, &c->arena, transport, given->replay,
                                    given->replayed, &c->endpoint.drops));
    PM_TRY_DONE(load_checkpoint(c, given->session));
    PM_TRY_DONE(
        pm_report_window_init(&c->reports, &c->arena, scene, c->lookahead + 1, c->completed + 1));
    PM_TRY_DONE(pm_channel_scene(c->ledger_channel, scene->name, "LEDGER"));
    PM_TRY_DONE(pm_health_init(&c->health, &c->arena, scene, (int64_t)c->endpoint.system->digest,
                               c->endpoint.session, c->endpoint.steps));
    PM_TRY_DONE(
        pm_endpoint_open(&c->endpoint, &handlers, c, "", given->session, c->checkpoint != NULL));
    PM_TRY_DONE(pm_endpoint_subscribe(&c->endpoint, c->health.vitals_channel, on_vitals, c));
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *remote = &c->remote[i];
        PM_TRY_DONE(pm_endpoint_subscribe(&c->endpoint, remote->channel, on_report, remote));
        if (c->hears_fluxes && remote->flux.nend > 0) {
            PM_TRY_DONE(
                pm_endpoint_subscribe(&c->endpoint, remote->flux_channel, on_progress, remote));
        }
        // A request to a neighbour shows that its sender is alive.
        char hellos[PM_CHANNEL_SIZE];
        PM_TRY_DONE(pm_channel_hello(hellos, scene, remote->name));
        PM_TRY_DONE(pm_endpoint_subscribe(&c->endpoint, hellos, on_hello, c));
        PM_TRY_DONE(pm_endpoint_subscribe(&c->endpoint, remote->address, on_request, c));
    }
    *coordinator = c;
    return PM_OK;
done:
    pm_lockstep_coordinator_close(c);
    return status;
}

void pm_lockstep_coordinator_close(pm_lockstep_coordinator *c) {
    if (c != NULL) {
        pm_report_window_free(&c->reports);
        pm_sample_free(c->last);
        PM_DELETE(c);
    }
}

// --- questions ---

bool pm_lockstep_coordinator_finished(const pm_lockstep_coordinator *c) {
    return c->phase == PM_COORDINATOR_FINISHED;
}

pm_status pm_lockstep_coordinator_result(const pm_lockstep_coordinator *c) {
    return pm_endpoint_result(&c->endpoint);
}

const pm_pace *pm_lockstep_coordinator_pace(const pm_lockstep_coordinator *c) {
    return &c->pace;
}

const pm_ledger *pm_lockstep_coordinator_ledger(const pm_lockstep_coordinator *c) {
    return &c->ledger;
}

pm_transport *pm_lockstep_coordinator_transport(const pm_lockstep_coordinator *c) {
    return c->endpoint.transport;
}

const pm_drops *pm_lockstep_coordinator_drops(const pm_lockstep_coordinator *c) {
    return &c->endpoint.drops;
}
