// A coordinator's polls: it grants steps, books the steps whose reports are all there, requests the
// messages that are missing, and ends the run. coordinator.h has the table of its states.
#include "lockstep/lockstep_coordinator.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "base/rng.h"
#include "lockstep/coordinator.h"
#include "lockstep/lookahead.h"
#include "lockstep/vitals.h"
#include "transport/channel.h"

#define HELLO_INTERVAL 0.1 // s
#define PAUSE 2.0   // s of silence that the observer is told of, at least, or half the patience
#define MOST_IDLE 3 // times the patience without progress, though all processes show life
#define TICK_EACH 0.00004     // s between two ticks before the first step, for each process
#define LIVE_WAIT 1.0         // s of waiting for a live input that the observer is told of
#define COMMAND_INTERVAL 0.02 // s between repetitions of END or ABORT
#define COMMAND_COUNT 10      // repetitions at most
#define LEDGER_INTERVAL 0.001 // s between two ledger messages at least

// --- sending ---

static pm_status publish_tick(pm_lockstep_coordinator *c) {
    const portmet_tick_t message = {
        .session = c->endpoint.session,
        .instance = c->endpoint.identity.hello.instance,
        .digest = (int64_t)c->endpoint.system->digest,
        .granted = c->granted,
        .steps = c->endpoint.steps,
        .t0 = 0,
        .dt = c->endpoint.system->scene->dt,
        .substeps = c->step_controller.substeps,
        .want_state = c->want_state,
        .open = c->endpoint.identity.hello.session == 0,
        .nanswer = c->nanswer,
        .answer = c->answer,
        .nlive = c->endpoint.system->scene->nlive,
        .live = (double *)pm_live_inputs_values(&c->live, c->granted - 1),
    };
    const size_t size = pm_tick_encode(&message, c->tick_data, c->tick_capacity);
    c->tick_wanted = false;
    c->ticked_at = c->endpoint.now;
    c->nanswer = 0;
    return pm_transport_publish(c->endpoint.transport, c->endpoint.tick_channel, c->tick_data,
                                size);
}

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

static pm_status publish_command(pm_lockstep_coordinator *c) {
    const portmet_command_t message = {
        .session = c->endpoint.session,
        .instance = c->endpoint.identity.hello.instance,
        .kind = c->endpoint.status == PM_OK ? PORTMET_COMMAND_T_END : PORTMET_COMMAND_T_ABORT,
        .code = (int8_t)c->endpoint.status,
        .reason = c->endpoint.message,
    };
    unsigned char data[96 + PM_TEXT_MAX];
    const size_t size = pm_command_encode(&message, data, sizeof data);
    return pm_transport_publish(c->endpoint.transport, c->endpoint.identity.command_channel, data,
                                size);
}

// --- steps ---

// Enters a step's sample in the ledger, hands it to the observer and saves the checkpoint if due.
static pm_status book(pm_lockstep_coordinator *c, pm_sample *sample) {
    PM_TRY(pm_coordinator_enter(c, sample));
    sample->live = pm_live_inputs_values(&c->live, sample->step - 1);
    pm_pace_note(&c->pace, sample->step, c->endpoint.now);
    if (c->observer.step != NULL) {
        PM_TRY(c->observer.step(c->observer.context, sample));
    }
    const bool due = sample->step % c->interval == 0 || sample->step == c->endpoint.steps;
    return c->checkpoint != NULL && due ? pm_coordinator_save_checkpoint(c) : PM_OK;
}

// Books the steps up to `complete`, whose reports are all there.
static pm_status book_steps(pm_lockstep_coordinator *c, int64_t complete) {
    while (c->completed < complete) {
        c->completed += 1;
        PM_TRY(book(c, pm_report_window_sample(&c->reports, c->completed)));
        const bool due = c->endpoint.now >= c->ledger_at || complete == c->endpoint.steps;
        if (c->completed == complete && due) {
            PM_TRY(publish_ledger(c, pm_report_window_sample(&c->reports, complete)));
        }
        pm_report_window_advance(&c->reports, c->completed);
    }
    return PM_OK;
}

// Publishes a tick if more steps may be granted than before.
static pm_status grant(pm_lockstep_coordinator *c, int64_t complete) {
    const bool live = c->endpoint.system->scene->nlive_input > 0;
    if (pm_coordinator_is_at_gate(c)) {
        PM_TRY(pm_gate_refresh(&c->gate, c->endpoint.now));
    }
    if (complete >= 0) {
        pm_pace_begin(&c->pace, c->endpoint.now);
    }
    if (live && c->granted < c->endpoint.steps) {
        PM_TRY(pm_live_inputs_check(&c->live, c->endpoint.now));
    }
    const int64_t limit = pm_coordinator_grant_limit(c, complete);
    if (complete < 0 || limit <= c->granted) {
        return PM_OK;
    }
    c->progressed = true;
    c->granted = limit;
    if (live) {
        pm_live_inputs_take(&c->live);
    }
    return publish_tick(c);
}

// Tells the observer once in each wait of LIVE_WAIT on which channel the run waits for a message.
static void tell_live(pm_lockstep_coordinator *c) {
    char text[128];
    const char *awaited = c->held ? pm_live_inputs_awaited(&c->live) : NULL;
    if (awaited == NULL) {
        c->live_until = c->endpoint.now + LIVE_WAIT;
    } else if (c->endpoint.now >= c->live_until && c->observer.warn != NULL) {
        c->live_until = INFINITY;
        snprintf(text, sizeof text, "the run waits after step %lld for a message on %s",
                 (long long)c->completed, awaited);
        c->observer.warn(c->observer.context, text);
    }
}

// Grants steps first, so that the processes compute them while this one books the complete steps.
// The run is held when every granted step is complete, since only the gate, the pace or a live
// input withholds the next one.
static pm_status complete_steps(pm_lockstep_coordinator *c) {
    const int64_t complete =
        pm_report_window_complete(&c->reports, c->completed, c->endpoint.steps);
    if (complete > c->completed) {
        c->progressed = true;
        pm_step_controller_note(&c->step_controller,
                                pm_report_window_sample(&c->reports, complete));
    }
    PM_TRY(grant(c, complete));
    const pm_status status = book_steps(c, complete);
    c->failed = status != PM_OK;
    const bool held =
        c->completed >= 0 && c->completed == c->granted && c->completed < c->endpoint.steps;
    if (held && !c->held && pm_coordinator_is_at_gate(c) && c->observer.hold != NULL) {
        c->observer.hold(c->observer.context, (long)c->completed);
    }
    c->held = held;
    tell_live(c);
    if (status == PM_OK && c->completed >= c->endpoint.steps) {
        pm_coordinator_close_run(c);
    }
    return status;
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
    if (c->held) {
        return publish_tick(c);
    }
    const bool fluxes = c->hears_fluxes && !c->fluxes_requested && c->granted > 0;
    const int64_t shown = c->granted - c->endpoint.system->scene->window; // by every process
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
        // Before the first step, those that have not said hello yet have nothing to send.
        const bool here = c->completed >= 0 || remote->greeted[0] != 0;
        if (here && !pm_report_window_has(&c->reports, step, remote->id)) {
            PM_TRY(pm_endpoint_request(&c->endpoint, remote->address, remote->channel, step, 0));
        }
    }
    return PM_OK;
}

// Fails if a process has been silent for too long, or all show life but none makes progress.
static pm_status check_patience(const pm_lockstep_coordinator *c) {
    const double patience = c->endpoint.system->scene->patience, now = c->endpoint.now;
    const double since = c->endpoint.waiting.since, waited = now - since;
    char names[512];
    list_missing(c, patience, names, sizeof names);
    if (names[0] != 0) {
        return c->completed < 0
                   ? pm_fail(PM_ETIMEOUT, "nodes missing after %.3g s: %s", waited, names)
                   : pm_fail(PM_ETIMEOUT, "no word for %.3g s, in step %lld, from: %s", waited,
                             (long long)pm_coordinator_steps_shown(c), names);
    }
    const double idle = now - (c->moved > since ? c->moved : since);
    if (!c->held && idle > MOST_IDLE * patience) {
        list_missing(c, -1, names, sizeof names);
        return pm_fail(
            PM_ETIMEOUT,
            "no progress for %.3g s, in step %lld, though all processes are alive; reports are "
            "missing from: %s",
            idle, (long long)pm_coordinator_steps_shown(c), names);
    }
    return PM_OK;
}

static pm_status await(pm_lockstep_coordinator *c) {
    if (c->progressed) {
        pm_waiting_start(&c->endpoint.waiting, c->endpoint.now);
        c->progressed = c->fluxes_requested = false;
        tell_pause(c, false, "");
    }
    char silent[512];
    const double pause = fmax(PAUSE, 2 * pm_vitals_interval(c->nremote));
    list_missing(c, fmin(pause, c->endpoint.system->scene->patience / 2), silent, sizeof silent);
    if (silent[0] != 0) {
        tell_pause(c, true, silent);
    }
    PM_TRY(check_patience(c));
    return pm_waiting_request_due(&c->endpoint.waiting, c->endpoint.now) ? request_missing(c)
                                                                         : PM_OK;
}

int pm_lockstep_coordinator_present(const pm_lockstep_coordinator *c) {
    int count = 0;
    for (int i = 0; i < c->nremote; ++i) {
        count += c->completed >= 0 || c->remote[i].greeted[0] != 0;
    }
    return count;
}

// --- the end ---

// Books the steps that processes reported only after the run failed or was interrupted. A failure
// in one of these steps came first, and becomes the reason for the end of the run.
static void book_rest(pm_lockstep_coordinator *c) {
    if (c->failed || c->completed < 0) {
        return;
    }
    const int64_t complete =
        pm_report_window_complete(&c->reports, c->completed, c->endpoint.steps);
    const pm_status status = book_steps(c, complete);
    if (status != PM_OK) {
        c->failed = true;
        pm_endpoint_end(&c->endpoint, status, pm_error());
    }
}

// Repeats END or ABORT until every process has sent BYE or a short time has passed.
static void repeat_command(pm_lockstep_coordinator *c) {
    bool all_left = true;
    for (int i = 0; i < c->nremote; ++i) {
        all_left = all_left && c->remote[i].left;
    }
    if (all_left) {
        c->phase = PM_COORDINATOR_FINISHED;
    } else if (c->endpoint.now >= c->next) {
        c->next = c->endpoint.now + COMMAND_INTERVAL;
        // A node that does not receive it gives up by itself.
        (void)publish_command(c);
        c->commands += 1;
        c->phase = c->commands > COMMAND_COUNT ? PM_COORDINATOR_FINISHED : PM_COORDINATOR_CLOSING;
    }
}

// --- health ---

// Publishes once a second how the run is doing, and tells the observer. A run that is held or
// pauses because somebody is silent has no other reason to wait.
static pm_status tell_health(pm_lockstep_coordinator *c) {
    char text[256];
    if (!pm_health_is_due(&c->health, c->completed, c->endpoint.now)) {
        return PM_OK;
    }
    if (c->observer.health != NULL) {
        c->observer.health(c->observer.context, &c->health.message);
    }
    while (c->observer.warn != NULL && c->completed > 0 && !c->held && !c->paused &&
           pm_health_warn(&c->health, text, sizeof text)) {
        c->observer.warn(c->observer.context, text);
    }
    const size_t size = pm_health_encode(&c->health.message, c->health.data, c->health.capacity);
    return pm_transport_publish(c->endpoint.transport, c->health.channel, c->health.data, size);
}

// --- a poll ---

// Publishes a hello at the start, again and again until the initial state is known, and when a
// process asked for another coordinator.
static pm_status say_hello(pm_lockstep_coordinator *c) {
    const bool due = c->completed < 0 && c->endpoint.now >= c->hello_at;
    if (c->said_hello && !due && !c->hello_wanted) {
        return PM_OK;
    }
    c->said_hello = true;
    c->hello_wanted = false;
    c->hello_at = c->endpoint.now + HELLO_INTERVAL;
    return pm_identity_publish_hello(&c->endpoint.identity);
}

// Returns the time, in s, from which a tick may answer hellos.
static double next_tick(const pm_lockstep_coordinator *c) {
    return c->completed < 0 ? c->ticked_at + TICK_EACH * c->nremote : 0;
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
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_coordinator_check(c, say_hello(c));
    }
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_coordinator_check(c, complete_steps(c));
    }
    // One tick answers all requests for it since the last poll, or since the last tick while many
    // processes join: every tick wakes all of them.
    if (c->phase == PM_COORDINATOR_RUNNING && c->tick_wanted && now >= next_tick(c)) {
        pm_coordinator_check(c, publish_tick(c));
    }
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_coordinator_check(c, await(c));
        pm_coordinator_check(c, tell_health(c));
    }
    if (c->phase == PM_COORDINATOR_CLOSING) {
        book_rest(c);
        repeat_command(c);
    }
    switch (c->phase) {
    case PM_COORDINATOR_RUNNING: {
        const double next = c->endpoint.waiting.next;
        const double gate = pm_coordinator_is_at_gate(c) ? c->gate.read_at : INFINITY;
        const double tick = c->tick_wanted ? next_tick(c) : INFINITY;
        const double due = pm_pace_due(&c->pace, c->granted);
        const double first = fmin(next, fmin(gate, tick));
        return pm_endpoint_clock(&c->endpoint, due > now ? fmin(first, due) : first);
    }
    case PM_COORDINATOR_CLOSING:
        return pm_endpoint_clock(&c->endpoint, c->next);
    default:
        return INFINITY;
    }
}

// --- opening ---

static pm_status open_remotes(pm_lockstep_coordinator *c) {
    c->remote = pm_arena_array(&c->arena, (size_t)c->nremote, sizeof *c->remote);
    if (c->remote == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *remote = &c->remote[i];
        remote->coordinator = c;
        PM_TRY(pm_remote_process_init(remote, &c->arena, c->endpoint.system->scene, i));
    }
    c->tick_capacity = pm_tick_size(
        &(portmet_tick_t){.nanswer = c->nremote, .nlive = c->endpoint.system->scene->nlive});
    c->tick_data = pm_arena_alloc(&c->arena, c->tick_capacity);
    c->answer = pm_arena_array(&c->arena, (size_t)c->nremote, sizeof *c->answer);
    return c->tick_data != NULL && c->answer != NULL
               ? PM_OK
               : pm_fail(PM_ENOMEM, "coordinator: out of memory");
}

static pm_status prepare(pm_lockstep_coordinator *c,
                         const pm_lockstep_coordinator_options *options) {
    const pm_scene *scene = c->endpoint.system->scene;
    if (c->endpoint.steps > PM_STEPS_MAX) {
        return pm_fail(PM_ECONFIG, "scene %s: %lld steps, at most %lld", scene->name,
                       (long long)c->endpoint.steps, (long long)PM_STEPS_MAX);
    }
    c->lookahead = pm_lookahead(scene);
    c->hears_fluxes = pm_lookahead_uses_fluxes(scene);
    pm_ledger_init(&c->ledger, c->endpoint.system);
    PM_TRY(pm_step_controller_init(&c->step_controller, scene));
    c->sums = pm_scene_may_report_sums(scene) && !c->want_state;
    PM_TRY(pm_report_ports_between(scene, &c->arena, &c->nbetween, &c->between));
    PM_TRY(open_remotes(c));
    c->pace = pm_pace_of(scene);
    PM_TRY(pm_gate_init(&c->gate, options->gate));
    PM_TRY(pm_live_inputs_open(&c->live, scene, &c->arena, c->endpoint.transport, options->replay,
                               options->replayed, &c->endpoint.drops));
    PM_TRY(pm_coordinator_load_checkpoint(c, options->session));
    PM_TRY(
        pm_report_window_init(&c->reports, &c->arena, scene, c->lookahead + 1, c->completed + 1));
    PM_TRY(pm_channel_scene(c->ledger_channel, scene, "LEDGER"));
    PM_TRY(pm_health_init(&c->health, &c->arena, scene, (int64_t)c->endpoint.system->digest,
                          c->endpoint.session, c->endpoint.steps));
    return pm_coordinator_listen(c, options->session);
}

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
    pm_lockstep_coordinator *c = calloc(1, sizeof *c);
    if (c == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    const pm_lockstep_coordinator_options plain = {0};
    const pm_lockstep_coordinator_options *given = options == NULL ? &plain : options;
    c->endpoint.system = system;
    c->endpoint.transport = transport;
    c->observer = given->observer;
    c->checkpoint = given->checkpoint;
    c->want_state = given->want_state;
    c->endpoint.session = given->session > 0 ? given->session : pm_lockstep_session();
    c->endpoint.steps = given->steps > 0 ? given->steps : system->scene->steps;
    c->completed = -1;
    c->progressed = true;
    c->nremote = system->scene->nprocess;
    const pm_status status = prepare(c, given);
    if (status != PM_OK) {
        pm_lockstep_coordinator_close(c);
        return status;
    }
    *coordinator = c;
    return PM_OK;
}

void pm_lockstep_coordinator_close(pm_lockstep_coordinator *c) {
    if (c != NULL) {
        pm_report_window_free(&c->reports);
        pm_arena_free(&c->arena);
        free(c);
    }
}
