// The coordinator: gathers nodes and reports, and grants steps. Message handlers only store and
// answer; pm_lockstep_coordinator_poll assembles samples and moves on.
#include "net/lockstep_coordinator.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/rng.h"
#include "net/channel.h"
#include "net/member.h"
#include "net/waiting.h"

#define COMMAND_INTERVAL 0.02 // s between repetitions of END or ABORT
#define COMMAND_COUNT 10      // repetitions at most

typedef enum phase { RUNNING, CLOSING, FINISHED } phase;

struct pm_lockstep_coordinator {
    pm_arena arena;
    const pm_system *system;
    pm_transport *transport;
    pm_lockstep_observer observer;
    bool want_state;
    int64_t session, steps;

    phase phase;
    pm_status status;
    char message[PM_TEXT_MAX + 1];
    double now, next; // s: last poll; next command
    int commands;     // END or ABORT sent so far

    int64_t completed, granted; // steps; completed is -1 before the initial state is known
    bool progressed;            // since the last poll: a new wait begins
    pm_waiting waiting;

    int nmember;
    pm_member *member; // [nmember]
    pm_sample *sample;
    pm_ledger ledger;
    char tick_channel[PM_CHANNEL_SIZE], ledger_channel[PM_CHANNEL_SIZE];
    char command_channel[PM_CHANNEL_SIZE], request_channel[PM_CHANNEL_SIZE];
    pm_drops drops;
};

// --- the end ---

static void close_run(pm_lockstep_coordinator *c) {
    c->phase = CLOSING;
    c->next = c->now;
}

void pm_lockstep_coordinator_fail(pm_lockstep_coordinator *c, pm_status code, const char *message) {
    if (c->phase == RUNNING) {
        c->status = code;
        snprintf(c->message, sizeof c->message, "%s", message);
        close_run(c);
    }
}

// Handlers cannot return a failure; they leave it here.
static void check(pm_lockstep_coordinator *c, pm_status status) {
    if (status != PM_OK) {
        pm_lockstep_coordinator_fail(c, status, pm_error());
    }
}

// --- sending ---

static pm_status publish_tick(pm_lockstep_coordinator *c) {
    const portmet_tick_t message = {
        .session = c->session,
        .digest = (int64_t)c->system->digest,
        .granted = c->granted,
        .steps = c->steps,
        .t0 = 0,
        .dt = c->system->scene->dt,
        .want_state = c->want_state,
    };
    unsigned char data[128];
    const size_t size = pm_tick_encode(&message, data, sizeof data);
    return pm_transport_publish(c->transport, c->tick_channel, data, size);
}

static pm_status publish_ledger(pm_lockstep_coordinator *c) {
    const portmet_ledger_t message = {
        .session = c->session,
        .step = c->completed,
        .time = c->sample->time,
        .energy = c->ledger.energy,
        .entropy = c->ledger.entropy,
        .energy_residual = c->sample->energy_residual,
        .entropy_residual = c->sample->entropy_residual,
        .violations = c->ledger.violations,
    };
    unsigned char data[128];
    const size_t size = pm_ledger_encode(&message, data, sizeof data);
    if (size == 0) {
        return pm_fail(PM_ENUMERIC, "the ledger is not finite after step %lld",
                       (long long)c->completed);
    }
    return pm_transport_publish(c->transport, c->ledger_channel, data, size);
}

static pm_status publish_command(pm_lockstep_coordinator *c) {
    const portmet_command_t message = {
        .session = c->session,
        .kind = c->status == PM_OK ? PORTMET_COMMAND_T_END : PORTMET_COMMAND_T_ABORT,
        .code = (int8_t)c->status,
        .reason = c->message,
    };
    unsigned char data[64 + PM_TEXT_MAX];
    const size_t size = pm_command_encode(&message, data, sizeof data);
    return pm_transport_publish(c->transport, c->command_channel, data, size);
}

// --- a step ---

static bool has_step(const pm_lockstep_coordinator *c, const pm_member *member, int64_t step) {
    return pm_member_has_report(member, step) &&
           (!c->want_state || pm_member_has_state(member, step));
}

static bool step_is_complete(const pm_lockstep_coordinator *c, int64_t step) {
    for (int i = 0; i < c->nmember; ++i) {
        if (!has_step(c, &c->member[i], step)) {
            return false;
        }
    }
    return true;
}

static void fill_sample(pm_lockstep_coordinator *c, int64_t step) {
    c->sample->step = (long)step;
    c->sample->time = (double)step * c->system->scene->dt;
    for (int i = 0; i < c->nmember; ++i) {
        pm_member_fill_sample(&c->member[i], step, c->sample);
    }
}

// Books every step whose reports are all there, and grants on.
static pm_status complete_steps(pm_lockstep_coordinator *c) {
    while (c->completed < c->steps && step_is_complete(c, c->completed + 1)) {
        fill_sample(c, c->completed + 1);
        c->completed += 1;
        c->progressed = true;
        PM_TRY(pm_ledger_book(&c->ledger, c->sample));
        PM_TRY(publish_ledger(c));
        if (c->observer.step != NULL) {
            PM_TRY(c->observer.step(c->observer.context, c->sample));
        }
    }
    if (c->completed == c->steps) {
        close_run(c);
        return PM_OK;
    }
    const int64_t limit = c->completed + c->system->scene->window;
    const int64_t granted = limit < c->steps ? limit : c->steps;
    if (c->completed >= 0 && granted > c->granted) {
        c->granted = granted;
        PM_TRY(publish_tick(c));
    }
    return PM_OK;
}

// --- waiting ---

// Names of the nodes that are given up; "" if there are none.
static void list_silent(const pm_lockstep_coordinator *c, char *list, size_t size) {
    size_t used = 0;
    list[0] = 0;
    for (int i = 0; i < c->nmember && used < size; ++i) {
        const pm_member *m = &c->member[i];
        if (has_step(c, m, c->completed + 1) ||
            !pm_waiting_over(&c->waiting, m->heard, c->system->scene->patience, c->now)) {
            continue;
        }
        const int length =
            snprintf(list + used, size - used, "%s%s", used > 0 ? ", " : "", m->subsystem->name);
        used += length < 0 ? 0 : (size_t)length;
    }
}

static pm_status request_missing(pm_lockstep_coordinator *c) {
    const int64_t step = c->completed + 1;
    for (int i = 0; i < c->nmember; ++i) {
        const pm_member *m = &c->member[i];
        if (!pm_member_has_report(m, step)) {
            PM_TRY(pm_waiting_request(c->transport, c->request_channel, c->session, "",
                                      m->report_channel, step, 0));
        }
        if (c->want_state && !pm_member_has_state(m, step)) {
            PM_TRY(pm_waiting_request(c->transport, c->request_channel, c->session, "",
                                      m->state_channel, step, 0));
        }
    }
    return PM_OK;
}

static pm_status await(pm_lockstep_coordinator *c) {
    if (c->progressed) {
        pm_waiting_start(&c->waiting, c->now);
        c->progressed = false;
    }
    char silent[512];
    list_silent(c, silent, sizeof silent);
    if (silent[0] != 0) {
        const double waited = c->now - c->waiting.since;
        return c->completed < 0
                   ? pm_fail(PM_ETIMEOUT, "nodes missing after %.3g s: %s", waited, silent)
                   : pm_fail(PM_ETIMEOUT, "no word for %.3g s, in step %lld, from: %s", waited,
                             (long long)c->completed, silent);
    }
    if (pm_waiting_ask(&c->waiting, c->now)) {
        PM_TRY(request_missing(c));
    }
    return PM_OK;
}

// END or ABORT, until everybody has said BYE or a short time has passed.
static void repeat_command(pm_lockstep_coordinator *c) {
    bool all_left = true;
    for (int i = 0; i < c->nmember; ++i) {
        all_left = all_left && c->member[i].left;
    }
    if (all_left) {
        c->phase = FINISHED;
    } else if (c->now >= c->next) {
        c->next = c->now + COMMAND_INTERVAL;
        // A node that does not hear it gives up by itself.
        (void)publish_command(c);
        c->commands += 1;
        c->phase = c->commands > COMMAND_COUNT ? FINISHED : CLOSING;
    }
}

static void note_life(pm_lockstep_coordinator *c) {
    for (int i = 0; i < c->nmember; ++i) {
        if (c->member[i].alive) {
            c->member[i].heard = c->now;
            c->member[i].alive = false;
        }
    }
}

double pm_lockstep_coordinator_poll(pm_lockstep_coordinator *c, double now) {
    c->now = now;
    note_life(c);
    if (c->phase == RUNNING) {
        check(c, complete_steps(c));
    }
    if (c->phase == RUNNING) {
        check(c, await(c));
    }
    if (c->phase == CLOSING) {
        repeat_command(c);
    }
    return c->phase == RUNNING ? c->waiting.next : c->phase == CLOSING ? c->next : INFINITY;
}

// --- receiving ---

static void count(pm_lockstep_coordinator *c, pm_drop drop) {
    c->drops.count[drop] += 1;
}

static pm_drop accept_hello(pm_member *m) {
    pm_lockstep_coordinator *c = m->coordinator;
    const portmet_report_t *report = &m->report_scratch;
    if (report->session != 0 && report->session != c->session) {
        return PM_DROP_SESSION;
    }
    if (c->phase != RUNNING || has_step(c, m, 0) || c->completed >= 0) {
        return PM_DROP_REPEATED;
    }
    m->alive = true;
    if (report->digest != (int64_t)c->system->digest) {
        check(c, pm_fail(PM_ENET,
                         "node %s holds another scene, weights or initial state: digest "
                         "%016llx, expected %016llx",
                         m->subsystem->name, (unsigned long long)report->digest,
                         (unsigned long long)c->system->digest));
        return PM_KEEP;
    }
    check(c, publish_tick(c));
    return PM_KEEP;
}

// Reports and states are of use beyond the last complete step, as far as granted.
static pm_drop judge_step(const pm_lockstep_coordinator *c, int64_t step) {
    if (step < 0 || step > c->granted) {
        return PM_DROP_RANGE;
    }
    return step <= c->completed ? PM_DROP_REPEATED : PM_KEEP;
}

static pm_drop accept_done(pm_member *m) {
    const pm_drop drop = judge_step(m->coordinator, m->report_scratch.step);
    return drop == PM_KEEP ? pm_member_keep_report(m) : drop;
}

static pm_drop accept_report(pm_member *m) {
    pm_lockstep_coordinator *c = m->coordinator;
    const portmet_report_t *report = &m->report_scratch;
    if (report->kind == PORTMET_REPORT_T_HELLO) {
        return accept_hello(m);
    }
    if (report->session != c->session) {
        return PM_DROP_SESSION;
    }
    m->alive = true;
    switch (report->kind) {
    case PORTMET_REPORT_T_DONE:
        return accept_done(m);
    case PORTMET_REPORT_T_FAILED: {
        const bool known = report->code >= PM_EUSAGE && report->code <= PM_EINTERRUPTED;
        check(c, pm_fail(known ? (pm_status)report->code : PM_ENET, "node %s failed: %s",
                         m->subsystem->name, report->message));
        return PM_KEEP;
    }
    case PORTMET_REPORT_T_BYE:
        m->left = c->phase == CLOSING;
        return m->left ? PM_KEEP : PM_DROP_RANGE;
    default:
        return PM_DROP_RANGE;
    }
}

static void on_report(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_member *m = context;
    pm_drop drop = pm_report_decode(&m->report_scratch, data, size);
    if (drop == PM_KEEP) {
        drop = accept_report(m);
    }
    count(m->coordinator, drop);
}

static pm_drop accept_state(pm_member *m) {
    pm_lockstep_coordinator *c = m->coordinator;
    if (m->state_scratch.session != c->session) {
        return PM_DROP_SESSION;
    }
    m->alive = true;
    const pm_drop drop = judge_step(c, m->state_scratch.step);
    return drop == PM_KEEP ? pm_member_keep_state(m) : drop;
}

static void on_state(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_member *m = context;
    pm_drop drop = pm_state_decode(&m->state_scratch, data, size);
    if (drop == PM_KEEP) {
        drop = accept_state(m);
    }
    count(m->coordinator, drop);
}

static pm_drop answer(pm_lockstep_coordinator *c, const portmet_request_t *request) {
    if (request->session != c->session) {
        return PM_DROP_SESSION;
    }
    for (int i = 0; i < c->nmember; ++i) {
        if (strcmp(c->member[i].subsystem->name, request->sender) == 0) {
            c->member[i].alive = true;
        }
    }
    if (strcmp(request->channel, c->tick_channel) == 0 && request->step < c->granted) {
        check(c, publish_tick(c));
    }
    return PM_KEEP;
}

static void on_request(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_coordinator *c = context;
    portmet_request_t request;
    pm_drop drop = pm_request_decode(&request, data, size);
    if (drop == PM_KEEP) {
        drop = answer(c, &request);
    }
    count(c, drop);
}

// --- opening ---

static pm_status open_member(pm_lockstep_coordinator *c, int subsystem_id) {
    const pm_scene *scene = c->system->scene;
    pm_member *m = &c->member[subsystem_id];
    m->coordinator = c;
    // Nodes run at most `window` steps beyond the last complete one.
    PM_TRY(pm_member_init(m, &c->arena, scene, subsystem_id, scene->window + 1));
    PM_TRY(pm_transport_subscribe(c->transport, m->report_channel, on_report, m));
    if (!c->want_state) {
        return PM_OK;
    }
    return pm_transport_subscribe(c->transport, m->state_channel, on_state, m);
}

static pm_status prepare(pm_lockstep_coordinator *c) {
    const pm_scene *scene = c->system->scene;
    if (c->steps > PM_STEPS_MAX) {
        return pm_fail(PM_ECONFIG, "scene %s: %lld steps, at most %lld", scene->name,
                       (long long)c->steps, (long long)PM_STEPS_MAX);
    }
    PM_TRY(pm_sample_new(&c->sample, scene));
    pm_ledger_init(&c->ledger, c->system);
    c->member = pm_arena_array(&c->arena, (size_t)c->nmember, sizeof *c->member);
    if (c->member == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    for (int i = 0; i < c->nmember; ++i) {
        PM_TRY(open_member(c, i));
    }
    PM_TRY(pm_channel_scene(c->tick_channel, scene, "TICK"));
    PM_TRY(pm_channel_scene(c->ledger_channel, scene, "LEDGER"));
    PM_TRY(pm_channel_scene(c->command_channel, scene, "COMMAND"));
    PM_TRY(pm_channel_scene(c->request_channel, scene, "REQUEST"));
    return pm_transport_subscribe(c->transport, c->request_channel, on_request, c);
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
    c->system = system;
    c->transport = transport;
    c->observer = given->observer;
    c->want_state = given->want_state;
    c->session = given->session > 0 ? given->session : pm_lockstep_session();
    c->steps = given->steps > 0 ? given->steps : system->scene->steps;
    c->completed = -1;
    c->progressed = true;
    c->nmember = system->scene->nsubsystem;
    const pm_status status = prepare(c);
    if (status != PM_OK) {
        pm_lockstep_coordinator_close(c);
        return status;
    }
    *coordinator = c;
    return PM_OK;
}

void pm_lockstep_coordinator_close(pm_lockstep_coordinator *c) {
    if (c != NULL) {
        pm_sample_free(c->sample);
        pm_arena_free(&c->arena);
        free(c);
    }
}

// --- asking ---

bool pm_lockstep_coordinator_finished(const pm_lockstep_coordinator *c) {
    return c->phase == FINISHED;
}

pm_status pm_lockstep_coordinator_result(const pm_lockstep_coordinator *c) {
    return c->status == PM_OK ? PM_OK : pm_fail(c->status, "%s", c->message);
}

long pm_lockstep_coordinator_step(const pm_lockstep_coordinator *c) {
    return (long)c->completed;
}

const pm_ledger *pm_lockstep_coordinator_ledger(const pm_lockstep_coordinator *c) {
    return &c->ledger;
}

pm_transport *pm_lockstep_coordinator_transport(const pm_lockstep_coordinator *c) {
    return c->transport;
}

const pm_drops *pm_lockstep_coordinator_drops(const pm_lockstep_coordinator *c) {
    return &c->drops;
}
