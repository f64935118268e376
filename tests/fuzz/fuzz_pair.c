// Feeds forged messages into a running pair of nodes and its coordinator, in virtual time. Whatever
// is sent, no process crashes, the run makes progress or ends within two seconds, and it ends with
// the same bits or with an error that says why. (Where the network loses messages, a forged one may
// stand in for a lost one; then nobody can tell.) The input is a list of forgeries: when, which of
// the messages that were heard last, and what is changed in it.
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lockstep/coordinator.h"
#include "lockstep/node.h"
#include "tests/support/fixture.h"
#include "transport/channel.h"

#define STEPS 24
#define MOST_FORGERIES 8
#define TICK 0.001 // s by which time advances when nobody has a message
#define STALL 2.0  // s, virtual
#define PATIENCE 30
#define SESSION 77
#define LARGEST 2048
#define MOST_STATE 16

enum { NODES = 2, CHANNELS = 12, KEPT = 4 };

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

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
    pm_hub *hub;
    pm_transport *transport[NODES + 1], *stranger; // the last but one is the coordinator's
    pm_lockstep_node *node[NODES];
    pm_lockstep_coordinator *coordinator;
    ear ears[CHANNELS];
    double now, moved; // s, virtual; when the run last made progress
    int64_t place;     // a number that changes with progress
    bool other_bits;   // a sample differs from that of an undisturbed run
} pair;

typedef struct input {
    const uint8_t *data;
    size_t size;
} input;

static fixture scenes[2]; // steps of several rounds, and of one round
static double truth[2][STEPS + 1][MOST_STATE];
static bool known[2];
static int scene_id;

static void check(bool holds, const char *what) {
    if (!holds) {
        fprintf(stderr, "%s\n", what);
        abort();
    }
}

static unsigned next(input *in) {
    const unsigned byte = in->size > 0 ? in->data[0] : 0;
    in->data += in->size > 0;
    in->size -= in->size > 0;
    return byte;
}

// --- the pair ---

static pm_status observe(void *context, const pm_sample *sample) {
    pair *p = context;
    const size_t count = (size_t)scenes[scene_id].scene->nz;
    if (!known[scene_id]) {
        memcpy(truth[scene_id][sample->step], sample->z, count * sizeof(double));
    } else if (memcmp(truth[scene_id][sample->step], sample->z, count * sizeof(double)) != 0) {
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

static void pair_open(pair *p, bool lossy) {
    static const char *const channels[CHANNELS] = {
        "chain_TICK",         "chain_COMMAND",      "chain_HELLO",        "chain_REQUEST",
        "chain_REQUEST_TICK", "chain_HELLO_link1",  "chain_HELLO_link2",  "chain_FLUX_link1",
        "chain_FLUX_link2",   "chain_REPORT_link1", "chain_REPORT_link2", "chain_REQUEST_link1"};
    const fixture *f = &scenes[scene_id];
    *p = (pair){.now = 100, .moved = 100};
    const pm_hub_faults faults = {.seed = 1, .drop = 0.1, .duplicate = 0.1};
    check(pm_hub_open(&p->hub, lossy ? &faults : NULL) == PM_OK, "hub");
    check(pm_transport_open(&p->stranger, "memory://", p->hub) == PM_OK, "transport");
    for (int i = 0; i < CHANNELS; ++i) {
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
        check(pm_transport_open(&p->transport[i], "memory://", p->hub) == PM_OK, "transport");
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
    return over;
}

// A number that changes when the run makes progress or an end comes closer.
static int64_t place_of(const pair *p) {
    int64_t place = 100 * p->coordinator->completed + 10 * (int64_t)p->coordinator->phase;
    for (int i = 0; i < NODES; ++i) {
        place = 1000 * place + 10 * p->node[i]->step + (int64_t)p->node[i]->phase;
    }
    return place;
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
    const int64_t place = place_of(p);
    p->moved = place != p->place ? p->now : p->moved;
    p->place = place;
    // A node that has not joined yet, and misses the end of the run, waits for its patience.
    const bool lonely = pm_lockstep_coordinator_finished(p->coordinator);
    check(p->now - p->moved <= (lonely ? 1.1 * PATIENCE : STALL), "the run stalls");
}

// --- forgeries ---

static void put(message *m, size_t at, size_t size, uint64_t bits) {
    for (size_t i = 0; i < size && at + i < m->size; ++i) {
        m->data[at + i] = (unsigned char)(bits >> (8 * (size - 1 - i)));
    }
}

// Changes a number of 1, 4 or 8 bytes: to a limit, to one near the present one, or to any.
static void edit(message *m, input *in) {
    static const uint64_t limits[] = {0,
                                      1,
                                      UINT64_MAX,
                                      INT32_MAX,
                                      UINT64_C(0x80000000),
                                      INT64_MAX,
                                      UINT64_C(1) << 63,
                                      UINT64_C(0x7ff8000000000000),  // NaN
                                      UINT64_C(0x7ff0000000000000),  // infinity
                                      UINT64_C(0x3ff0000000000000),  // 1.0
                                      UINT64_C(0x7fefffffffffffff)}; // the largest number
    static const size_t sizes[] = {8, 8, 4, 1};
    const unsigned kind = next(in), where = next(in) + 256 * (kind >> 6), value = next(in);
    const size_t size = sizes[kind & 3], body = m->size > 8 ? m->size - 8 : 1;
    size_t at = 8 + where % body; // the type stays
    at -= (kind & 4) != 0 ? at % 8 : 0;
    uint64_t bits = 0;
    for (size_t i = 0; i < size; ++i) {
        bits = bits << 8 | (at + i < m->size ? m->data[at + i] : 0);
    }
    switch (kind >> 3 & 3) {
    case 0:
        put(m, at, size, bits + (value < 128 ? value : value - 256));
        break;
    case 1:
        put(m, at, size, bits ^ UINT64_C(1) << value % 64);
        break;
    default:
        put(m, at, size, limits[value % (sizeof limits / sizeof limits[0])]);
    }
}

static void forge(pair *p, input *in) {
    const unsigned which = next(in), edits = next(in);
    const ear *e = &p->ears[which % CHANNELS];
    if (e->count == 0) {
        return;
    }
    const int age = (int)(which / CHANNELS) % KEPT, kept = e->count < KEPT ? e->count : KEPT;
    message m = e->message[(e->count - 1 - age % kept) % KEPT];
    for (unsigned i = 0; i <= edits % 3; ++i) {
        edit(&m, in);
    }
    const char *channel = e->channel;
    if (edits >= 224) { // the same on another channel
        channel = p->ears[edits % CHANNELS].channel;
    }
    check(pm_transport_publish(p->stranger, channel, m.data, m.size) == PM_OK, "publish");
}

static void run(input *in, bool lossy) {
    pair p;
    pair_open(&p, lossy);
    for (int i = 0; i < MOST_FORGERIES && in->size > 0 && !is_over(&p); ++i) {
        for (unsigned turns = next(in) % 12; turns > 0 && !is_over(&p); --turns) {
            turn(&p);
        }
        forge(&p, in);
    }
    while (!is_over(&p)) {
        turn(&p);
    }
    const pm_status status = pm_lockstep_coordinator_result(p.coordinator);
    check(status != PM_OK || !p.other_bits || lossy, "other bits, and no error");
    check(status == PM_OK || pm_error()[0] != 0, "an error without words");
    pair_close(&p);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    input in = {data, size}, none = {NULL, 0};
    const unsigned shape = next(&in);
    scene_id = (int)(shape % 2);
    if (!known[scene_id]) {
        fixture_open(&scenes[scene_id], NODES, 1234);
        scenes[scene_id].scene->patience = PATIENCE;
        if (scene_id == 1) {
            scenes[scene_id].scene->integrator = pm_integrator_find("euler");
            scenes[scene_id].scene->substeps = 1;
        }
        check(scenes[scene_id].scene->nz <= MOST_STATE, "a large state");
        run(&none, false);
        known[scene_id] = true;
    }
    run(&in, shape / 2 % 4 == 0);
    return 0;
}
