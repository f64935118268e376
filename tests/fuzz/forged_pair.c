// A pair of nodes and its coordinator poll in turn on a memory hub; time advances only when nobody
// has a message, and once by more than a second, so that nodes tell how they are doing.
#include "tests/fuzz/forged_pair.h"

#include <stdlib.h>
#include <string.h>

#include "lockstep/coordinator.h"
#include "lockstep/node.h"
#include "tests/support/fixture.h"
#include "tests/support/memory_hub.h"
#include "transport/channel.h"

#define STEPS 24
#define MOST_FORGERIES 8
#define TICK 0.001 // s by which time advances when nobody has a message
#define STALL 2.0  // s, virtual
#define PATIENCE 30
#define SESSION 77
#define LARGEST 2048
#define MOST_STATE 16
#define JUMP_TURN 12 // the turn in which time advances by JUMP
#define JUMP 1.1     // s; nodes publish vitals once a second
#define ERRORS 64    // different errors that are counted
#define ERROR_SIZE 256

enum { NODES = 2, KEPT = 4 };

typedef struct message {
    unsigned char data[LARGEST];
    size_t size;
} message;

// The last messages on one channel.
typedef struct ear {
    const char *channel;
    int count;
    message message[KEPT];
} ear;

typedef struct pair {
    int scene;
    bool lossy;
    pm_hub *hub;
    pm_transport *transport[NODES + 1], *stranger; // the last but one is the coordinator's
    pm_lockstep_node *node[NODES];
    pm_lockstep_coordinator *coordinator;
    ear ears[FORGED_CHANNELS];
    int turns;
    double now, moved; // s, virtual; when the run last made progress
    double longest;    // s, virtual, without progress
    int64_t place;     // a number that changes with progress
    long messages;     // forged ones
    bool other_bits;   // a sample differs from that of an undisturbed run
    bool lonely, stalled;
} pair;

typedef struct input {
    const uint8_t *data;
    size_t size;
} input;

static const char *const channels[FORGED_CHANNELS] = {
    "chain_TICK",          "chain_COMMAND",      "chain_HELLO",        "chain_REQUEST",
    "chain_REQUEST_TICK",  "chain_HELLO_link1",  "chain_HELLO_link2",  "chain_FLUX_link1",
    "chain_FLUX_link2",    "chain_REPORT_link1", "chain_REPORT_link2", "chain_REQUEST_link1",
    "chain_REQUEST_link2", "chain_VITALS",
};
static fixture scenes[FORGED_SCENES];
static double truth[FORGED_SCENES][STEPS + 1][MOST_STATE];
static bool known[FORGED_SCENES];
static struct {
    char text[ERROR_SIZE];
    long count;
} errors[ERRORS];

static void check(bool holds, const char *what) {
    if (!holds) {
        fprintf(stderr, "%s\n", what);
        abort();
    }
}

// --- the pair ---

static pm_status observe(void *context, const pm_sample *sample) {
    pair *p = context;
    const size_t count = (size_t)scenes[p->scene].scene->physics.nz;
    if (!known[p->scene]) {
        memcpy(truth[p->scene][sample->step], sample->z, count * sizeof(double));
    } else if (memcmp(truth[p->scene][sample->step], sample->z, count * sizeof(double)) != 0) {
        p->other_bits = true;
    }
    return PM_OK;
}

static void hear(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    ear *e = context;
    message *m = &e->message[e->count++ % KEPT];
    check(size <= LARGEST, "a large message");
    memcpy(m->data, data, size);
    m->size = size;
}

static void pair_open(pair *p, int scene, bool lossy) {
    const fixture *f = &scenes[scene];
    *p = (pair){.scene = scene, .lossy = lossy, .now = 100, .moved = 100};
    const pm_hub_faults faults = {.seed = 1, .drop = 0.1, .duplicate = 0.1};
    check(pm_hub_open(&p->hub, lossy ? &faults : NULL) == PM_OK, "hub");
    check(pm_hub_connect(p->hub, &p->stranger) == PM_OK, "transport");
    for (int i = 0; i < FORGED_CHANNELS; ++i) {
        p->ears[i].channel = channels[i];
        check(pm_transport_subscribe(p->stranger, channels[i], hear, &p->ears[i]) == PM_OK, "ear");
    }
    const pm_lockstep_coordinator_options options = {
        .steps = STEPS,
        .session = SESSION,
        .want_state = true,
        .observer = {.context = p, .step = observe},
    };
    const pm_lockstep_node_options node_options = {.z = f->z, .session = SESSION};
    for (int i = 0; i <= NODES; ++i) {
        check(pm_hub_connect(p->hub, &p->transport[i]) == PM_OK, "transport");
    }
    for (int i = 0; i < NODES; ++i) {
        check(pm_lockstep_node_open(&p->node[i], f->system, i, p->transport[i], &node_options) ==
                  PM_OK,
              "node");
    }
    check(pm_lockstep_coordinator_open(&p->coordinator, f->system, p->transport[NODES], &options) ==
              PM_OK,
          "coordinator");
}

static void pair_close(pair *p) {
    pm_lockstep_coordinator_close(p->coordinator);
    for (int i = 0; i < NODES; ++i) {
        pm_lockstep_node_close(p->node[i]);
    }
    for (int i = 0; i <= NODES; ++i) {
        pm_transport_close(p->transport[i]);
    }
    pm_transport_close(p->stranger);
    pm_hub_close(p->hub);
}

static bool is_over(const pair *p) {
    bool over = pm_lockstep_coordinator_finished(p->coordinator);
    for (int i = 0; i < NODES; ++i) {
        over = over && pm_lockstep_node_finished(p->node[i]);
    }
    return over || p->stalled;
}

// A number that changes when the run makes progress or an end comes closer.
static int64_t place_of(const pair *p) {
    int64_t place = 100 * p->coordinator->completed + 10 * (int64_t)p->coordinator->phase;
    for (int i = 0; i < NODES; ++i) {
        place = 1000 * place + 10 * p->node[i]->step + (int64_t)p->node[i]->phase;
    }
    return place;
}

// Looks how long the run has made no progress.
static void watch(pair *p) {
    const int64_t place = place_of(p);
    p->moved = place != p->place ? p->now : p->moved;
    p->place = place;
    const double waited = p->now - p->moved;
    // A node that has not joined yet, and misses the end of the run, waits for its patience.
    const bool lonely = pm_lockstep_coordinator_finished(p->coordinator);
    p->lonely = p->lonely || (lonely && waited > STALL);
    p->longest = !lonely && waited > p->longest ? waited : p->longest;
    p->stalled = p->stalled || waited > (lonely ? 1.1 * PATIENCE : STALL);
}

// Passes messages and polls, once for everybody.
static void turn(pair *p) {
    int total = 0, handled;
    check(pm_transport_wait(p->transport[NODES], 0, &handled) == PM_OK, "wait");
    pm_lockstep_coordinator_poll(p->coordinator, p->now);
    total += handled;
    for (int i = 0; i < NODES; ++i) {
        check(pm_transport_wait(p->transport[i], 0, &handled) == PM_OK, "wait");
        pm_lockstep_node_poll(p->node[i], p->now);
        total += handled;
    }
    check(pm_transport_wait(p->stranger, 0, NULL) == PM_OK, "wait");
    p->now += total == 0 ? TICK : 0;
    watch(p);
    if (++p->turns == JUMP_TURN) {
        p->now += JUMP;
        p->moved += JUMP;
    }
}

static void run_turns(pair *p, int turns) {
    while (p->turns < turns && !is_over(p)) {
        turn(p);
    }
}

// --- outcomes ---

// Counts the present error. Words with a digit count as equal, since they are steps, sums and
// names.
static void note_error(void) {
    char text[ERROR_SIZE], words[ERROR_SIZE] = "", *rest = text;
    snprintf(text, sizeof text, "%s", pm_error());
    for (char *word = strsep(&rest, " "); word != NULL; word = strsep(&rest, " ")) {
        const bool first = words[0] == 0, number = strpbrk(word, "0123456789") != NULL;
        const size_t used = strlen(words);
        snprintf(words + used, sizeof words - used, "%s%s", first ? "" : " ", number ? "#" : word);
    }
    int i = 0;
    while (i < ERRORS - 1 && errors[i].count > 0 && strcmp(errors[i].text, words) != 0) {
        ++i;
    }
    memcpy(errors[i].text, words, sizeof words);
    errors[i].count += 1;
}

// True if the present error ends before it says why.
static bool says_nothing(void) {
    const size_t length = strlen(pm_error());
    return length == 0 || pm_error()[length - 1] == ' ' || pm_error()[length - 1] == ':';
}

static forged_end end_of(const pair *p) {
    if (p->stalled) {
        return FORGED_STALL;
    }
    if (pm_lockstep_coordinator_result(p->coordinator) != PM_OK) {
        return says_nothing() ? FORGED_NO_WORDS : FORGED_ERROR;
    }
    if (p->other_bits) {
        return p->lossy ? FORGED_REPLACED : FORGED_OTHER_BITS;
    }
    return FORGED_SAME_BITS;
}

// Runs the pair to its end, enters the outcome and closes the pair.
static void finish(pair *p, forged_figures *figures) {
    while (!is_over(p)) {
        turn(p);
    }
    const forged_end end = end_of(p);
    if (end == FORGED_ERROR) {
        note_error();
    }
    figures->runs += 1;
    figures->messages += p->messages;
    figures->end[end] += 1;
    figures->lonely += p->lonely;
    figures->longest = p->longest > figures->longest ? p->longest : figures->longest;
    pair_close(p);
}

// Before the first run of a scene: makes the scene, and runs it undisturbed.
static void prepare(int scene) {
    if (known[scene]) {
        return;
    }
    fixture_open(&scenes[scene], NODES, 1234);
    scenes[scene].scene->network.patience = PATIENCE;
    if (scene == 1) {
        scenes[scene].scene->physics.integrator = pm_integrator_find("euler");
        scenes[scene].scene->physics.substeps = 1;
    }
    check(scenes[scene].scene->physics.nz <= MOST_STATE, "a large state");
    pair p;
    forged_figures none = {.runs = 0};
    pair_open(&p, scene, false);
    finish(&p, &none);
    known[scene] = true;
    check(none.end[FORGED_SAME_BITS] == 1, "an undisturbed run fails");
}

long forged_pair_failures(const forged_figures *figures) {
    return figures->end[FORGED_OTHER_BITS] + figures->end[FORGED_NO_WORDS] +
           figures->end[FORGED_STALL];
}

void forged_pair_print(FILE *file, const forged_figures *f) {
    fprintf(
        file,
        "%ld forged messages into %ld runs: %ld ended with the same bits, %ld with an error that "
        "says why\n"
        "%ld runs stood still for over 2 s, %ld had other bits, %ld ended without words\n"
        "longest time without progress: %.3f s (virtual)\n",
        f->messages, f->runs, f->end[FORGED_SAME_BITS], f->end[FORGED_ERROR], f->end[FORGED_STALL],
        f->end[FORGED_OTHER_BITS], f->end[FORGED_NO_WORDS], f->longest);
    fprintf(
        file,
        "in %ld runs the network lost a message and a forged one stood in for it; in %ld a node "
        "had not joined when the run ended\n",
        f->end[FORGED_REPLACED], f->lonely);
    for (int i = 0; i < ERRORS && errors[i].count > 0; ++i) {
        fprintf(file, "%8ld  %s\n", errors[i].count, errors[i].text);
    }
}

// --- forgeries ---

static void put(message *m, size_t at, size_t size, uint64_t bits) {
    for (size_t i = 0; i < size && at + i < m->size; ++i) {
        m->data[at + i] = (unsigned char)(bits >> (8 * (size - 1 - i)));
    }
}

static uint64_t get(const message *m, size_t at, size_t size) {
    uint64_t bits = 0;
    for (size_t i = 0; i < size; ++i) {
        bits = bits << 8 | (at + i < m->size ? m->data[at + i] : 0);
    }
    return bits;
}

static uint64_t limit(unsigned value) {
    static const uint64_t limits[FORGED_LIMITS] = {
        0,
        1,
        UINT64_MAX,
        INT32_MAX,
        UINT64_C(0x80000000),
        INT64_MAX,
        UINT64_C(1) << 63,
        UINT64_C(0x7ff8000000000000), // NaN
        UINT64_C(0x7ff0000000000000), // infinity
        UINT64_C(0x3ff0000000000000), // 1.0
        UINT64_C(0x7fefffffffffffff), // the largest number
    };
    return limits[value % FORGED_LIMITS];
}

// The last message on the forgery's channel; NULL: there is none, or the run is over.
static const message *last_message(const pair *p, int channel) {
    const ear *e = &p->ears[channel];
    return is_over(p) || e->count == 0 ? NULL : &e->message[(e->count - 1) % KEPT];
}

size_t forged_pair_message_size(int scene, int turn, int channel) {
    prepare(scene);
    pair p;
    pair_open(&p, scene, false);
    run_turns(&p, turn);
    const message *last = last_message(&p, channel);
    const size_t size = last == NULL ? 0 : last->size;
    pair_close(&p);
    return size;
}

void forged_pair_run_one(const forgery *f, forged_figures *figures) {
    prepare(f->scene);
    pair p;
    pair_open(&p, f->scene, false);
    run_turns(&p, f->turn);
    const message *last = last_message(&p, f->channel);
    if (last == NULL || f->at + f->size > last->size) {
        pair_close(&p);
        return;
    }
    message m = *last;
    const uint64_t present = get(&m, f->at, f->size);
    const uint64_t changed[] = {present + 1, present - 1,
                                present ^ UINT64_C(1) << (8 * f->size - 1)};
    put(&m, f->at, f->size,
        f->value < FORGED_LIMITS ? limit((unsigned)f->value) : changed[f->value - FORGED_LIMITS]);
    if (memcmp(m.data, last->data, m.size) == 0) {
        pair_close(&p);
        return;
    }
    check(pm_transport_publish(p.stranger, channels[f->channel], m.data, m.size) == PM_OK,
          "publish");
    p.messages += 1;
    finish(&p, figures);
}

// --- random forgeries ---

static unsigned next(input *in) {
    const unsigned byte = in->size > 0 ? in->data[0] : 0;
    in->data += in->size > 0;
    in->size -= in->size > 0;
    return byte;
}

// Changes a number of 1, 4 or 8 bytes: to a limit, to one near the present one, or to any.
static void edit(message *m, input *in) {
    static const size_t sizes[] = {8, 8, 4, 1};
    const unsigned kind = next(in), where = next(in) + 256 * (kind >> 6), value = next(in);
    const size_t size = sizes[kind & 3], body = m->size > 8 ? m->size - 8 : 1;
    size_t at = 8 + where % body; // the type stays
    at -= (kind & 4) != 0 ? at % 8 : 0;
    const uint64_t bits = get(m, at, size);
    switch (kind >> 3 & 3) {
    case 0:
        put(m, at, size, bits + (value < 128 ? value : value - 256));
        break;
    case 1:
        put(m, at, size, bits ^ UINT64_C(1) << value % 64);
        break;
    default:
        put(m, at, size, limit(value));
    }
}

static void forge(pair *p, input *in) {
    const unsigned which = next(in), edits = next(in);
    const ear *e = &p->ears[which % FORGED_CHANNELS];
    if (e->count == 0) {
        return;
    }
    const int age = (int)(which / FORGED_CHANNELS) % KEPT, kept = e->count < KEPT ? e->count : KEPT;
    message m = e->message[(e->count - 1 - age % kept) % KEPT];
    for (unsigned i = 0; i <= edits % 3; ++i) {
        edit(&m, in);
    }
    const char *channel = e->channel;
    if (edits >= 224) { // the same on another channel
        channel = p->ears[edits % FORGED_CHANNELS].channel;
    }
    check(pm_transport_publish(p->stranger, channel, m.data, m.size) == PM_OK, "publish");
    p->messages += 1;
}

void forged_pair_run_many(const uint8_t *data, size_t size, forged_figures *figures) {
    input in = {data, size};
    const unsigned shape = next(&in);
    const int scene = (int)(shape % FORGED_SCENES);
    prepare(scene);
    pair p;
    pair_open(&p, scene, shape / FORGED_SCENES % 4 == 0);
    for (int i = 0; i < MOST_FORGERIES && in.size > 0 && !is_over(&p); ++i) {
        run_turns(&p, p.turns + (int)(next(&in) % 12));
        if (!is_over(&p)) {
            forge(&p, &in);
        }
    }
    finish(&p, figures);
}
