// A coordinator's life: grants steps, books those whose reports are all there, asks again for those
// that are missing, and ends the run.
#include "lockstep/lockstep_coordinator.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "base/rng.h"
#include "lockstep/coordinator.h"
#include "lockstep/lookahead.h"
#include "transport/channel.h"

#define HELLO_INTERVAL 0.1 // s
#define PAUSE 2.0          // s of silence after which a pause is told of, or half the patience
// How many times the scene's patience it may take until somebody gets on, though all show life.
#define ALIVE 3
#define COMMAND_INTERVAL 0.02 // s between repetitions of END or ABORT
#define COMMAND_COUNT 10      // repetitions at most
#define LEDGER_INTERVAL 0.001 // s between two ledgers at least: who looks sees no more

// --- the end ---

static void close_run(pm_lockstep_coordinator *c) {
    c->phase = PM_COORDINATOR_CLOSING;
    c->next = c->endpoint.now;
}

void pm_lockstep_coordinator_fail(pm_lockstep_coordinator *c, pm_status code, const char *message) {
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_endpoint_end(&c->endpoint, code, message);
        close_run(c);
    }
}

void pm_coordinator_check(pm_lockstep_coordinator *c, pm_status status) {
    if (status != PM_OK) {
        pm_lockstep_coordinator_fail(c, status, pm_error());
    }
}

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
        .substeps = c->pace.substeps,
        .want_state = c->want_state,
        .open = c->endpoint.identity.hello.session == 0,
    };
    unsigned char data[128];
    const size_t size = pm_tick_encode(&message, data, sizeof data);
    c->tick_wanted = false;
    return pm_transport_publish(c->endpoint.transport, c->endpoint.tick_channel, data, size);
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
        .kind = c->endpoint.status == PM_OK ? PORTMET_COMMAND_T_END : PORTMET_COMMAND_T_ABORT,
        .code = (int8_t)c->endpoint.status,
        .reason = c->endpoint.message,
    };
    unsigned char data[64 + PM_TEXT_MAX];
    const size_t size = pm_command_encode(&message, data, sizeof data);
    return pm_transport_publish(c->endpoint.transport, c->endpoint.identity.command_channel, data,
                                size);
}

// --- a step ---

static pm_status book(pm_lockstep_coordinator *c, pm_sample *sample) {
    PM_TRY(pm_ledger_book(&c->ledger, sample));
    if (c->observer.step != NULL) {
        PM_TRY(c->observer.step(c->observer.context, sample));
    }
    const bool due = sample->step % c->interval == 0 || sample->step == c->endpoint.steps;
    return c->checkpoint != NULL && due ? pm_coordinator_remember(c) : PM_OK;
}

static int64_t least(int64_t a, int64_t b) {
    return a < b ? a : b;
}

int64_t pm_coordinator_limit(const pm_lockstep_coordinator *c, int64_t complete) {
    const int window = c->endpoint.system->scene->window;
    int64_t limit = least(complete + c->lead, c->endpoint.steps);
    limit = least(limit, c->gate.steps > complete ? c->gate.steps : complete);
    for (int i = 0; c->hears_fluxes && i < c->nremote; ++i) {
        const int64_t done = c->remote[i].done;
        limit = least(limit, (done > complete ? done : complete) + window);
    }
    return limit;
}

static bool stands_at_gate(const pm_lockstep_coordinator *c) {
    return c->granted >= c->gate.steps;
}

static pm_status grant(pm_lockstep_coordinator *c, int64_t complete) {
    if (stands_at_gate(c)) {
        PM_TRY(pm_gate_look(&c->gate, c->endpoint.now));
    }
    const int64_t limit = pm_coordinator_limit(c, complete);
    if (complete < 0 || limit <= c->granted) {
        return PM_OK;
    }
    c->progressed = true;
    c->granted = limit;
    return publish_tick(c);
}

// Books the steps up to `complete`, whose reports are all there.
static pm_status book_steps(pm_lockstep_coordinator *c, int64_t complete) {
    while (c->completed < complete) {
        c->completed += 1;
        PM_TRY(book(c, pm_report_window_sample(&c->window_reports, c->completed)));
        const bool due = c->endpoint.now >= c->ledger_at || complete == c->endpoint.steps;
        if (c->completed == complete && due) {
            PM_TRY(publish_ledger(c, pm_report_window_sample(&c->window_reports, complete)));
        }
        pm_report_window_move_on(&c->window_reports, c->completed);
    }
    return PM_OK;
}

// Steps that are granted are not yet complete, unless the gate stops the next one.
static void note_hold(pm_lockstep_coordinator *c) {
    const bool held =
        c->completed >= 0 && c->completed == c->granted && c->completed < c->endpoint.steps;
    if (held && !c->held && c->observer.hold != NULL) {
        c->observer.hold(c->observer.context, (long)c->completed);
    }
    c->held = held;
}

// Grants on, and books the steps whose reports are all there while the processes compute.
static pm_status complete_steps(pm_lockstep_coordinator *c) {
    const int64_t complete =
        pm_report_window_complete(&c->window_reports, c->completed, c->endpoint.steps);
    if (complete > c->completed) {
        c->progressed = true;
        pm_step_controller_note(&c->pace, pm_report_window_sample(&c->window_reports, complete));
    }
    PM_TRY(grant(c, complete));
    const pm_status status = book_steps(c, complete);
    c->failed = status != PM_OK;
    note_hold(c);
    if (status == PM_OK && c->completed >= c->endpoint.steps) {
        close_run(c);
    }
    return status;
}

// --- waiting ---

// Names of the nodes that are missed and, unless `patience` is negative, have been silent for
// longer than that; "" if there are none.
static void list_missing(const pm_lockstep_coordinator *c, double patience, char *list,
                         size_t size) {
    size_t used = 0;
    list[0] = 0;
    for (int i = 0; i < c->nremote && used < size; ++i) {
        const pm_remote_process *m = &c->remote[i];
        if (pm_report_window_has(&c->window_reports, c->completed + 1, m->id) ||
            (patience >= 0 &&
             !pm_waiting_over(&c->endpoint.waiting, m->heard, patience, c->endpoint.now))) {
            continue;
        }
        const int length =
            snprintf(list + used, size - used, "%s%s", used > 0 ? ", " : "", m->name);
        used += length < 0 ? 0 : (size_t)length;
    }
}

// Tells the observer that the run pauses, or goes on.
static void tell_pause(pm_lockstep_coordinator *c, bool paused, const char *silent) {
    if (c->observer.pause != NULL && paused != c->paused) {
        c->observer.pause(c->observer.context, silent);
    }
    c->paused = paused;
}

// The fluxes for want of which no more steps are granted; neighbours may miss them, too.
static pm_status request_fluxes(const pm_lockstep_coordinator *c, bool *any) {
    const int64_t told = c->granted - c->endpoint.system->scene->window; // by all, and more by some
    for (int i = 0; i < c->nremote; ++i) {
        const pm_remote_process *m = &c->remote[i];
        if (m->done <= told && m->shown.nend > 0) {
            *any = true;
            PM_TRY(pm_endpoint_request(&c->endpoint, m->address, m->flux_channel, told + 1, 0));
        }
    }
    return PM_OK;
}

static pm_status request_reports(const pm_lockstep_coordinator *c) {
    const int64_t step = c->completed + 1;
    for (int i = 0; i < c->nremote; ++i) {
        const pm_remote_process *m = &c->remote[i];
        if (!pm_report_window_has(&c->window_reports, step, m->id)) {
            PM_TRY(pm_endpoint_request(&c->endpoint, m->address, m->channel, step, 0));
        }
    }
    return PM_OK;
}

// Who still waits after a request for fluxes has reported what there is. At the gate nothing is
// missing, and the nodes only need a sign of life.
static pm_status request_missing(pm_lockstep_coordinator *c) {
    bool any = false;
    if (c->held) {
        return publish_tick(c);
    }
    if (c->hears_fluxes && !c->fluxes_asked && c->granted > 0) {
        PM_TRY(request_fluxes(c, &any));
    }
    c->fluxes_asked = true;
    return any ? PM_OK : request_reports(c);
}

// Steps that all have told of, by report or flux.
static int64_t steps_told(const pm_lockstep_coordinator *c) {
    int64_t told = INT64_MAX;
    for (int i = 0; i < c->nremote; ++i) {
        told = least(told, c->remote[i].done);
    }
    return told > c->completed ? told : c->completed;
}

// Ends the run if a node stays silent for too long, or all show life but nobody gets on.
static pm_status check_patience(const pm_lockstep_coordinator *c) {
    const double patience = c->endpoint.system->scene->patience, now = c->endpoint.now;
    const double since = c->endpoint.waiting.since, waited = now - since;
    char names[512];
    list_missing(c, patience, names, sizeof names);
    if (names[0] != 0) {
        return c->completed < 0
                   ? pm_fail(PM_ETIMEOUT, "nodes missing after %.3g s: %s", waited, names)
                   : pm_fail(PM_ETIMEOUT, "no word for %.3g s, in step %lld, from: %s", waited,
                             (long long)steps_told(c), names);
    }
    const double idle = now - (c->moved > since ? c->moved : since);
    if (!c->held && idle > ALIVE * patience) {
        list_missing(c, -1, names, sizeof names);
        return pm_fail(
            PM_ETIMEOUT,
            "no node got on for %.3g s, in step %lld, though alive; its reports are missing "
            "from: %s",
            idle, (long long)steps_told(c), names);
    }
    return PM_OK;
}

static pm_status await(pm_lockstep_coordinator *c) {
    if (c->progressed) {
        pm_waiting_start(&c->endpoint.waiting, c->endpoint.now);
        c->progressed = c->fluxes_asked = false;
        tell_pause(c, false, "");
    }
    char silent[512];
    const double patience = c->endpoint.system->scene->patience;
    list_missing(c, patience < 2 * PAUSE ? patience / 2 : PAUSE, silent, sizeof silent);
    if (silent[0] != 0) {
        tell_pause(c, true, silent);
    }
    PM_TRY(check_patience(c));
    return pm_waiting_ask(&c->endpoint.waiting, c->endpoint.now) ? request_missing(c) : PM_OK;
}

// What nodes had not yet told of a run that failed, or was interrupted, is booked, too; what fails
// there came first, and is why the run ends.
static void book_rest(pm_lockstep_coordinator *c) {
    if (c->failed || c->completed < 0) {
        return;
    }
    const int64_t complete =
        pm_report_window_complete(&c->window_reports, c->completed, c->endpoint.steps);
    const pm_status status = book_steps(c, complete);
    if (status != PM_OK) {
        c->failed = true;
        pm_endpoint_end(&c->endpoint, status, pm_error());
    }
}

// END or ABORT, until everybody has said BYE or a short time has passed.
static void repeat_command(pm_lockstep_coordinator *c) {
    bool all_left = true;
    for (int i = 0; i < c->nremote; ++i) {
        all_left = all_left && c->remote[i].left;
    }
    if (all_left) {
        c->phase = PM_COORDINATOR_FINISHED;
    } else if (c->endpoint.now >= c->next) {
        c->next = c->endpoint.now + COMMAND_INTERVAL;
        // A node that does not hear it gives up by itself.
        (void)publish_command(c);
        c->commands += 1;
        c->phase = c->commands > COMMAND_COUNT ? PM_COORDINATOR_FINISHED : PM_COORDINATOR_CLOSING;
    }
}

// Once, and until all initial states are there.
static pm_status greet(pm_lockstep_coordinator *c) {
    if (c->greeted && (c->completed >= 0 || c->endpoint.now < c->greet_at)) {
        return PM_OK;
    }
    c->greeted = true;
    c->greet_at = c->endpoint.now + HELLO_INTERVAL;
    return pm_identity_say(&c->endpoint.identity);
}

static void note_life(pm_lockstep_coordinator *c) {
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *m = &c->remote[i];
        m->heard = m->alive ? c->endpoint.now : m->heard;
        c->moved = m->moved ? c->endpoint.now : c->moved;
        m->alive = m->moved = false;
    }
}

static double next_look(const pm_lockstep_coordinator *c) {
    const double next = c->endpoint.waiting.next;
    return stands_at_gate(c) && c->gate.read_at < next ? c->gate.read_at : next;
}

double pm_lockstep_coordinator_poll(pm_lockstep_coordinator *c, double now) {
    c->endpoint.now = now;
    note_life(c);
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_coordinator_check(c, greet(c));
    }
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_coordinator_check(c, complete_steps(c));
    }
    // All who asked since the last poll get one answer.
    if (c->phase == PM_COORDINATOR_RUNNING && c->tick_wanted) {
        pm_coordinator_check(c, publish_tick(c));
    }
    if (c->phase == PM_COORDINATOR_RUNNING) {
        pm_coordinator_check(c, await(c));
    }
    if (c->phase == PM_COORDINATOR_CLOSING) {
        book_rest(c);
        repeat_command(c);
    }
    return c->phase == PM_COORDINATOR_RUNNING   ? next_look(c)
           : c->phase == PM_COORDINATOR_CLOSING ? c->next
                                                : INFINITY;
}

// --- opening ---

static pm_status open_members(pm_lockstep_coordinator *c) {
    c->remote = pm_arena_array(&c->arena, (size_t)c->nremote, sizeof *c->remote);
    if (c->remote == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    for (int i = 0; i < c->nremote; ++i) {
        pm_remote_process *m = &c->remote[i];
        m->coordinator = c;
        PM_TRY(pm_remote_process_init(m, &c->arena, c->endpoint.system->scene, i));
    }
    return PM_OK;
}

static pm_status prepare(pm_lockstep_coordinator *c, int64_t wanted, const char *gate) {
    const pm_scene *scene = c->endpoint.system->scene;
    if (c->endpoint.steps > PM_STEPS_MAX) {
        return pm_fail(PM_ECONFIG, "scene %s: %lld steps, at most %lld", scene->name,
                       (long long)c->endpoint.steps, (long long)PM_STEPS_MAX);
    }
    c->lead = pm_lookahead(scene);
    c->hears_fluxes = pm_lookahead_is_heard(scene);
    pm_ledger_init(&c->ledger, c->endpoint.system);
    PM_TRY(pm_step_controller_init(&c->pace, scene));
    PM_TRY(open_members(c));
    PM_TRY(pm_gate_init(&c->gate, gate));
    PM_TRY(pm_coordinator_recall(c, wanted));
    PM_TRY(pm_report_window_init(&c->window_reports, &c->arena, scene, c->completed + 1));
    PM_TRY(pm_channel_scene(c->ledger_channel, scene, "LEDGER"));
    return pm_coordinator_listen(c, wanted);
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
    const pm_status status = prepare(c, given->session, given->gate);
    if (status != PM_OK) {
        pm_lockstep_coordinator_close(c);
        return status;
    }
    *coordinator = c;
    return PM_OK;
}

void pm_lockstep_coordinator_close(pm_lockstep_coordinator *c) {
    if (c != NULL) {
        pm_report_window_free(&c->window_reports);
        pm_arena_free(&c->arena);
        free(c);
    }
}

// --- asking ---

bool pm_lockstep_coordinator_finished(const pm_lockstep_coordinator *c) {
    return c->phase == PM_COORDINATOR_FINISHED;
}

pm_status pm_lockstep_coordinator_result(const pm_lockstep_coordinator *c) {
    return pm_endpoint_result(&c->endpoint);
}

long pm_lockstep_coordinator_step(const pm_lockstep_coordinator *c) {
    return (long)c->completed;
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
