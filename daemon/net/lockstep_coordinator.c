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
#include "net/history.h"
#include "net/identity.h"
#include "net/member.h"
#include "net/waiting.h"
#include "store/channel.h"
#include "store/snapshot.h"

#define HELLO_INTERVAL 0.1    // s
#define PAUSE 2.0             // s of silence after which a pause is told of, or half the patience
#define COMMAND_INTERVAL 0.02 // s between repetitions of END or ABORT
#define COMMAND_COUNT 10      // repetitions at most

typedef enum phase { RUNNING, CLOSING, FINISHED } phase;

// A step whose reports are being gathered.
typedef struct gathering {
    int64_t step;
    int missing; // members that have not reported it
    bool *has;   // [nmember]
    pm_sample *sample;
} gathering;

struct pm_lockstep_coordinator {
    pm_arena arena;
    const pm_system *system;
    pm_transport *transport;
    pm_lockstep_observer observer;
    bool want_state;
    int64_t session, steps;
    pm_identity identity;

    phase phase;
    pm_status status;
    char message[PM_TEXT_MAX + 1];
    double now, next; // s: last poll; next command
    int commands;     // END or ABORT sent so far
    bool greeted;     // said hello
    double greet_at;  // s, when to say it again

    int64_t completed, granted; // steps; completed is -1 before the initial state is known
    bool progressed;            // since the last poll: a new wait begins
    bool paused;                // and the observer was told
    bool tick_wanted;           // somebody asked for it since the last poll
    pm_waiting waiting;

    int nmember;
    pm_member *member;    // [nmember]
    int depth;            // steps that are gathered at once
    gathering *gathering; // [depth] by step modulo depth
    pm_ledger ledger;
    const char *checkpoint; // NULL: none
    int64_t interval;       // steps between two
    int nmemory;
    double *memory; // [nmemory] steps completed, then the ledger's, then the observer's
    char tick_channel[PM_CHANNEL_SIZE], ledger_channel[PM_CHANNEL_SIZE];
    char request_channel[PM_CHANNEL_SIZE];
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
        .open = c->identity.hello.session == 0,
    };
    unsigned char data[128];
    const size_t size = pm_tick_encode(&message, data, sizeof data);
    c->tick_wanted = false;
    return pm_transport_publish(c->transport, c->tick_channel, data, size);
}

static pm_status publish_ledger(const pm_lockstep_coordinator *c, const pm_sample *sample) {
    const portmet_ledger_t message = {
        .session = c->session,
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
    return pm_transport_publish(c->transport, c->identity.command_channel, data, size);
}

// --- a step ---

static gathering *gathering_of(const pm_lockstep_coordinator *c, int64_t step) {
    return &c->gathering[step % c->depth];
}

// Makes room for the reports of a step.
static void begin_gathering(pm_lockstep_coordinator *c, int64_t step) {
    gathering *g = gathering_of(c, step);
    g->step = step;
    g->missing = c->nmember;
    memset(g->has, 0, (size_t)c->nmember * sizeof *g->has);
    g->sample->step = (long)step;
    g->sample->time = (double)step * c->system->scene->dt;
}

static bool has_step(const pm_lockstep_coordinator *c, const pm_member *member, int64_t step) {
    const gathering *g = gathering_of(c, step);
    return g->step == step && g->has[member->id];
}

// Steps whose reports are all there; -1: not even the initial state.
static int64_t gathered(const pm_lockstep_coordinator *c) {
    int64_t step = c->completed;
    while (step < c->steps && gathering_of(c, step + 1)->step == step + 1 &&
           gathering_of(c, step + 1)->missing == 0) {
        ++step;
    }
    return step;
}

static pm_status save(pm_lockstep_coordinator *c) {
    c->memory[0] = (double)c->completed;
    pm_ledger_save(&c->ledger, c->memory + 1);
    if (c->observer.nmemory > 0) {
        PM_TRY(c->observer.save(c->observer.context, c->memory + 1 + PM_LEDGER_MEMORY));
    }
    return pm_snapshot_save(c->checkpoint, c->system->digest, c->session, c->nmemory, c->memory);
}

static pm_status book(pm_lockstep_coordinator *c, pm_sample *sample) {
    PM_TRY(pm_ledger_book(&c->ledger, sample));
    if (c->observer.step != NULL) {
        PM_TRY(c->observer.step(c->observer.context, sample));
    }
    const bool due = sample->step % c->interval == 0 || sample->step == c->steps;
    return c->checkpoint != NULL && due ? save(c) : PM_OK;
}

static int64_t limit_of(const pm_lockstep_coordinator *c, int64_t complete) {
    const int64_t limit = complete + c->system->scene->window;
    return limit < c->steps ? limit : c->steps;
}

static pm_status grant(pm_lockstep_coordinator *c, int64_t complete) {
    c->granted = limit_of(c, complete);
    return publish_tick(c);
}

// Grants on from the last step whose reports are all there, and books up to it while the processes
// compute.
static pm_status complete_steps(pm_lockstep_coordinator *c) {
    const int64_t complete = gathered(c);
    if (c->completed >= c->steps) {
        close_run(c);
    }
    if (complete == c->completed) {
        return PM_OK;
    }
    c->progressed = true;
    if (complete < c->steps) {
        PM_TRY(grant(c, complete));
    }
    while (c->completed < complete) {
        c->completed += 1;
        PM_TRY(book(c, gathering_of(c, c->completed)->sample));
        if (c->completed == complete) {
            PM_TRY(publish_ledger(c, gathering_of(c, complete)->sample));
        }
        begin_gathering(c, c->completed + c->depth);
    }
    if (c->completed == c->steps) {
        close_run(c);
    }
    return PM_OK;
}

// --- waiting ---

// Names of the nodes that are missed and have been silent for longer than `patience`; "" if there
// are none.
static void list_silent(const pm_lockstep_coordinator *c, double patience, char *list,
                        size_t size) {
    size_t used = 0;
    list[0] = 0;
    for (int i = 0; i < c->nmember && used < size; ++i) {
        const pm_member *m = &c->member[i];
        if (has_step(c, m, c->completed + 1) ||
            !pm_waiting_over(&c->waiting, m->heard, patience, c->now)) {
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

static pm_status request_missing(const pm_lockstep_coordinator *c) {
    const int64_t step = c->completed + 1;
    for (int i = 0; i < c->nmember; ++i) {
        const pm_member *m = &c->member[i];
        if (!has_step(c, m, step)) {
            PM_TRY(pm_waiting_request(c->transport, c->request_channel, c->session, "", m->channel,
                                      step, 0));
        }
    }
    return PM_OK;
}

static pm_status ask_again(pm_lockstep_coordinator *c) {
    return pm_waiting_ask(&c->waiting, c->now) ? request_missing(c) : PM_OK;
}

static pm_status await(pm_lockstep_coordinator *c) {
    if (c->progressed) {
        pm_waiting_start(&c->waiting, c->now);
        c->progressed = false;
        tell_pause(c, false, "");
    }
    char silent[512];
    const double patience = c->system->scene->patience;
    list_silent(c, patience < 2 * PAUSE ? patience / 2 : PAUSE, silent, sizeof silent);
    if (silent[0] == 0) {
        return ask_again(c);
    }
    tell_pause(c, true, silent);
    list_silent(c, patience, silent, sizeof silent);
    if (silent[0] != 0) {
        const double waited = c->now - c->waiting.since;
        return c->completed < 0
                   ? pm_fail(PM_ETIMEOUT, "nodes missing after %.3g s: %s", waited, silent)
                   : pm_fail(PM_ETIMEOUT, "no word for %.3g s, in step %lld, from: %s", waited,
                             (long long)c->completed, silent);
    }
    return ask_again(c);
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

// Once, and until all initial states are there.
static pm_status greet(pm_lockstep_coordinator *c) {
    if (c->greeted && (c->completed >= 0 || c->now < c->greet_at)) {
        return PM_OK;
    }
    c->greeted = true;
    c->greet_at = c->now + HELLO_INTERVAL;
    return pm_identity_say(&c->identity);
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
        check(c, greet(c));
    }
    if (c->phase == RUNNING) {
        check(c, complete_steps(c));
    }
    // All who asked since the last poll get one answer.
    if (c->phase == RUNNING && c->tick_wanted) {
        check(c, publish_tick(c));
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

static pm_member *find_member(const pm_lockstep_coordinator *c, const char *name) {
    for (int i = 0; i < c->nmember; ++i) {
        if (strcmp(c->member[i].name, name) == 0) {
            return &c->member[i];
        }
    }
    return NULL;
}

// A node that cannot take part ends a run that has not begun, and is sent away from one that has.
static pm_drop refuse(pm_lockstep_coordinator *c, const portmet_hello_t *hello, const char *reason,
                      bool late) {
    check(c, pm_identity_refuse(&c->identity, hello, PM_ENET, reason));
    if (!late) {
        check(c, pm_fail(PM_ENET, "%s", reason));
    }
    return PM_KEEP;
}

static pm_drop greet_node(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    char reason[512];
    pm_member *m = find_member(c, hello->sender);
    if (m == NULL) {
        snprintf(reason, sizeof reason, "scene %s has no process %.64s", c->system->scene->name,
                 hello->sender);
        return refuse(c, hello, reason, true);
    }
    const bool late = has_step(c, m, 0) || c->completed >= 0;
    if (pm_identity_differs(&c->identity, hello, reason, sizeof reason)) {
        return refuse(c, hello, reason, late);
    }
    if (late && c->checkpoint == NULL) {
        // Its first hello may have been lost, as others' bring the tick, too.
        m->instance = m->instance == 0 ? hello->instance : m->instance;
        if (hello->instance == m->instance) {
            return PM_DROP_REPEATED;
        }
        snprintf(
            reason, sizeof reason,
            "node %s: the run goes on without it; only runs with --checkpoint take a node back",
            m->name);
        return refuse(c, hello, reason, true);
    }
    m->instance = hello->instance;
    m->alive = true;
    c->tick_wanted = true;
    return PM_KEEP;
}

static pm_drop accept_hello(pm_lockstep_coordinator *c, const portmet_hello_t *hello) {
    if (hello->session != c->identity.hello.session) {
        return PM_DROP_SESSION;
    }
    if (c->phase == CLOSING && c->status != PM_OK && hello->sender[0] != 0) {
        // It has not joined, and need not wait for it.
        check(c, pm_identity_refuse(&c->identity, hello, c->status, c->message));
        return PM_KEEP;
    }
    if (c->phase != RUNNING) {
        return PM_DROP_REPEATED;
    }
    if (hello->sender[0] != 0) {
        return greet_node(c, hello);
    }
    const bool first = c->completed >= 0 || pm_identity_precedes(&c->identity, hello);
    if (first && pm_identity_rivals(&c->identity, hello)) {
        char reason[256];
        snprintf(reason, sizeof reason, "there is a coordinator of scene %s already",
                 c->system->scene->name);
        check(c, pm_identity_refuse(&c->identity, hello, PM_ENET, reason));
    }
    return PM_KEEP;
}

static void on_hello(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_coordinator *c = context;
    portmet_hello_t hello;
    pm_drop drop = pm_hello_decode(&hello, data, size);
    if (drop == PM_KEEP) {
        drop = accept_hello(c, &hello);
    }
    count(c, drop);
}

// Its own commands are heard, too.
static void on_command(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_lockstep_coordinator *c = context;
    portmet_command_t command;
    const pm_drop drop = pm_command_decode(&command, data, size);
    if (drop == PM_KEEP && c->phase == RUNNING && pm_identity_is_refused(&c->identity, &command)) {
        c->status = PM_ENET;
        snprintf(c->message, sizeof c->message, "%s", command.reason);
        c->phase = FINISHED;
    }
    count(c, drop);
}

// Takes what is new: steps beyond the last complete one, as far as granted.
static pm_drop accept_done(pm_member *m) {
    pm_lockstep_coordinator *c = m->coordinator;
    const int64_t first = m->scratch.step;
    const int rows = pm_member_rows(m);
    if (first < 0 || first > c->granted || rows - 1 > c->granted - first) {
        return PM_DROP_RANGE;
    }
    pm_drop drop = PM_DROP_REPEATED;
    for (int row = 0; row < rows; ++row) {
        gathering *g = gathering_of(c, first + row);
        if (g->step == first + row && !g->has[m->id]) {
            pm_member_fill(m, row, g->sample);
            g->has[m->id] = true;
            g->missing -= 1;
            drop = PM_KEEP;
        }
    }
    return drop;
}

static pm_drop accept_report(pm_member *m) {
    pm_lockstep_coordinator *c = m->coordinator;
    const portmet_report_t *report = &m->scratch;
    if (report->session != c->session) {
        return PM_DROP_SESSION;
    }
    m->alive = true;
    switch (report->kind) {
    case PORTMET_REPORT_T_DONE:
        return accept_done(m);
    case PORTMET_REPORT_T_FAILED: {
        const bool known = report->code >= PM_EUSAGE && report->code <= PM_EINTERRUPTED;
        check(c, pm_fail(known ? (pm_status)report->code : PM_ENET, "node %s failed: %s", m->name,
                         report->message));
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
    pm_drop drop = pm_member_decode(m, data, size, m->coordinator->want_state);
    if (drop == PM_KEEP) {
        drop = accept_report(m);
    }
    count(m->coordinator, drop);
}

static pm_drop answer(pm_lockstep_coordinator *c, const portmet_request_t *request) {
    if (request->session != c->session) {
        return PM_DROP_SESSION;
    }
    pm_member *m = find_member(c, request->sender);
    if (m != NULL) {
        m->alive = true;
    }
    if (strcmp(request->channel, c->tick_channel) == 0 && request->step < c->granted) {
        c->tick_wanted = true;
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

static pm_status open_members(pm_lockstep_coordinator *c) {
    c->member = pm_arena_array(&c->arena, (size_t)c->nmember, sizeof *c->member);
    if (c->member == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    for (int i = 0; i < c->nmember; ++i) {
        pm_member *m = &c->member[i];
        m->coordinator = c;
        PM_TRY(pm_member_init(m, &c->arena, c->system->scene, i));
        PM_TRY(pm_transport_subscribe(c->transport, m->channel, on_report, m));
    }
    return PM_OK;
}

// Processes run at most `window` steps beyond the last complete one.
static pm_status open_gatherings(pm_lockstep_coordinator *c) {
    const int depth = c->system->scene->window + 1;
    c->gathering = pm_arena_array(&c->arena, (size_t)depth, sizeof *c->gathering);
    bool *has = pm_arena_array(&c->arena, (size_t)depth * (size_t)c->nmember, sizeof *has);
    if (c->gathering == NULL || has == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    for (int i = 0; i < depth; ++i) {
        c->gathering[i].has = has + (size_t)i * (size_t)c->nmember;
        PM_TRY(pm_sample_new(&c->gathering[i].sample, c->system->scene));
        c->depth = i + 1;
    }
    for (int i = 0; i < depth; ++i) {
        begin_gathering(c, c->completed + 1 + i);
    }
    return PM_OK;
}

// Takes up what a coordinator left that died, if it was of the session wanted (0: any); else leaves
// the first checkpoint, so that this one's session is known.
static pm_status open_checkpoint(pm_lockstep_coordinator *c, int64_t wanted) {
    int64_t session;
    bool found;
    c->interval = pm_history_interval(c->system->scene);
    if (c->checkpoint == NULL) {
        return PM_OK;
    }
    c->nmemory = 1 + PM_LEDGER_MEMORY + c->observer.nmemory;
    c->memory = pm_arena_array(&c->arena, (size_t)c->nmemory, sizeof *c->memory);
    if (c->memory == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    c->memory[0] = -1;
    PM_TRY(pm_snapshot_session(c->checkpoint, c->system->digest, &session, &found));
    if (!found || (wanted > 0 && wanted != session)) {
        return pm_snapshot_save(c->checkpoint, c->system->digest, c->session, c->nmemory,
                                c->memory);
    }
    PM_TRY(pm_snapshot_load(c->checkpoint, c->system->digest, &c->session, c->nmemory, c->memory,
                            &found));
    if (c->memory[0] < -1 || c->memory[0] > (double)c->steps) {
        return pm_fail(PM_EFILE, "%s: a snapshot of step %g, the run has %lld", c->checkpoint,
                       c->memory[0], (long long)c->steps);
    }
    c->completed = (int64_t)c->memory[0];
    if (c->completed < 0) {
        return PM_OK;
    }
    pm_ledger_restore(&c->ledger, c->memory + 1);
    c->granted = limit_of(c, c->completed);
    c->tick_wanted = true;
    return c->observer.nmemory == 0 ? PM_OK
                                    : c->observer.restore(c->observer.context, (long)c->completed,
                                                          c->memory + 1 + PM_LEDGER_MEMORY);
}

static pm_status prepare(pm_lockstep_coordinator *c, int64_t wanted) {
    const pm_scene *scene = c->system->scene;
    if (c->steps > PM_STEPS_MAX) {
        return pm_fail(PM_ECONFIG, "scene %s: %lld steps, at most %lld", scene->name,
                       (long long)c->steps, (long long)PM_STEPS_MAX);
    }
    pm_ledger_init(&c->ledger, c->system);
    PM_TRY(open_checkpoint(c, wanted));
    PM_TRY(open_members(c));
    PM_TRY(open_gatherings(c));
    PM_TRY(pm_channel_scene(c->tick_channel, scene, "TICK"));
    PM_TRY(pm_channel_scene(c->ledger_channel, scene, "LEDGER"));
    PM_TRY(pm_channel_scene(c->request_channel, scene, "REQUEST"));
    PM_TRY(
        pm_identity_init(&c->identity, c->system, "", wanted, c->checkpoint != NULL, c->transport));
    PM_TRY(pm_transport_subscribe(c->transport, c->identity.hello_channel, on_hello, c));
    PM_TRY(pm_transport_subscribe(c->transport, c->identity.command_channel, on_command, c));
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
    c->checkpoint = given->checkpoint;
    c->want_state = given->want_state;
    c->session = given->session > 0 ? given->session : pm_lockstep_session();
    c->steps = given->steps > 0 ? given->steps : system->scene->steps;
    c->completed = -1;
    c->progressed = true;
    c->nmember = system->scene->nprocess;
    const pm_status status = prepare(c, given->session);
    if (status != PM_OK) {
        pm_lockstep_coordinator_close(c);
        return status;
    }
    *coordinator = c;
    return PM_OK;
}

void pm_lockstep_coordinator_close(pm_lockstep_coordinator *c) {
    if (c != NULL) {
        for (int i = 0; i < c->depth; ++i) {
            pm_sample_free(c->gathering[i].sample);
        }
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
