// The lock-step protocol over the memory transport, in virtual time: the same bits as the plain
// loop whatever the network does to messages, and a clear end whatever happens to a node.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
// cmocka needs the above.
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fixture.h"
#include "net/channel.h"
#include "net/codec.h"
#include "net/lockstep.h"
#include "sim/assembly.h"

#define MAX_NODES 5
#define STEPS 20
#define PATIENCE 2.0 // s, virtual
#define START 100.0  // s, virtual
#define TICK 0.001   // s by which virtual time moves when nobody has a message
#define TOO_LONG 60.0

// --- counting our own allocations (linked with --wrap) ---

static long allocations;

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *memory, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *memory, size_t size);

void *__wrap_malloc(size_t size) {
    ++allocations;
    return __real_malloc(size);
}

void *__wrap_calloc(size_t count, size_t size) {
    ++allocations;
    return __real_calloc(count, size);
}

void *__wrap_realloc(void *memory, size_t size) {
    ++allocations;
    return __real_realloc(memory, size);
}

// --- a coordinator and its nodes on one hub ---

typedef struct company {
    fixture f;
    pm_assembly *assembly; // the plain loop, stepped by the observer
    long steps_seen;
    long allocations_at_step_5;
    long fail_at_step; // the observer fails there; -1: never
    double now;        // s, virtual
    int count;
    pm_transport *transport[MAX_NODES];
    pm_lockstep_node *node[MAX_NODES]; // NULL: absent
    pm_transport *coordinator_transport;
    pm_lockstep_coordinator *coordinator;
} company;

// Compares every number of a sample with the plain loop's.
static pm_status compare(void *context, const pm_sample *sample) {
    company *c = context;
    if (sample->step > 0) {
        assert_int_equal(pm_assembly_step(c->assembly), PM_OK);
    }
    const pm_sample *plain = pm_assembly_sample(c->assembly);
    const size_t n = (size_t)c->count, number = sizeof(double);
    assert_int_equal(sample->step, c->steps_seen);
    assert_memory_equal(&sample->time, &plain->time, number);
    assert_memory_equal(sample->z, plain->z, (size_t)c->f.scene->nz * number);
    assert_memory_equal(sample->energy, plain->energy, n * number);
    assert_memory_equal(sample->entropy, plain->entropy, n * number);
    assert_memory_equal(sample->bulk_energy, plain->bulk_energy, n * number);
    assert_memory_equal(sample->bulk_entropy, plain->bulk_entropy, n * number);
    assert_memory_equal(sample->bulk_gross, plain->bulk_gross, 2 * n * number);
    assert_memory_equal(sample->evaluated, plain->evaluated, n * sizeof(long));
    assert_memory_equal(sample->skipped, plain->skipped, n * sizeof(long));
    if (n > 1) {
        assert_memory_equal(sample->flux, plain->flux, (n - 1) * sizeof(pm_flux[2]));
    }
    ++c->steps_seen;
    if (sample->step == 5) {
        c->allocations_at_step_5 = allocations;
    }
    if (sample->step == c->fail_at_step) {
        return pm_fail(PM_EFILE, "the recording is full");
    }
    return PM_OK;
}

// Everything but the nodes.
static void open_company(company *c, int count, int window, pm_hub *hub, int64_t session) {
    *c = (company){.count = count, .fail_at_step = -1, .now = START};
    fixture_open(&c->f, count, 1234);
    c->f.scene->window = window;
    c->f.scene->patience = PATIENCE;
    assert_int_equal(pm_assembly_open(&c->assembly, c->f.system), PM_OK);
    pm_assembly_set_state(c->assembly, c->f.z);
    for (int i = 0; i < count; ++i) {
        assert_int_equal(pm_transport_open(&c->transport[i], "memory://", hub), PM_OK);
    }
    assert_int_equal(pm_transport_open(&c->coordinator_transport, "memory://", hub), PM_OK);
    const pm_lockstep_coordinator_options options = {
        .steps = STEPS,
        .session = session,
        .want_state = true,
        .observer = {c, compare},
    };
    assert_int_equal(pm_lockstep_coordinator_open(&c->coordinator, c->f.system,
                                                  c->coordinator_transport, &options),
                     PM_OK);
}

static void add_node(company *c, int i, const pm_system *system, int64_t session) {
    const pm_lockstep_node_options options = {.z = c->f.z + c->f.scene->subsystem[i].first,
                                              .session = session};
    assert_int_equal(pm_lockstep_node_open(&c->node[i], system, i, c->transport[i], &options),
                     PM_OK);
}

static void open_all(company *c, int count, int window, pm_hub *hub, int64_t session) {
    open_company(c, count, window, hub, session);
    for (int i = 0; i < count; ++i) {
        add_node(c, i, c->f.system, session);
    }
}

static void close_company(company *c) {
    pm_lockstep_coordinator_close(c->coordinator);
    pm_transport_close(c->coordinator_transport);
    for (int i = 0; i < c->count; ++i) {
        pm_lockstep_node_close(c->node[i]);
        pm_transport_close(c->transport[i]);
    }
    pm_assembly_close(c->assembly);
    fixture_close(&c->f);
}

static bool is_over(const company *c) {
    bool over = c->coordinator == NULL || pm_lockstep_coordinator_finished(c->coordinator);
    for (int i = 0; i < c->count; ++i) {
        over = over && (c->node[i] == NULL || pm_lockstep_node_finished(c->node[i]));
    }
    return over;
}

// Everybody's turn; the number of messages handed out. Time passes when there are none.
static int turn(company *c) {
    int total = 0, handled;
    if (c->coordinator != NULL) {
        assert_int_equal(pm_transport_wait(c->coordinator_transport, 0, &handled), PM_OK);
        pm_lockstep_coordinator_poll(c->coordinator, c->now);
        total += handled;
    }
    for (int i = 0; i < c->count; ++i) {
        if (c->node[i] != NULL) {
            assert_int_equal(pm_transport_wait(c->transport[i], 0, &handled), PM_OK);
            pm_lockstep_node_poll(c->node[i], c->now);
            total += handled;
        }
    }
    c->now += total == 0 ? TICK : 0;
    // Nothing may hang.
    if (c->now > START + TOO_LONG) {
        fail_msg("still running after %g virtual seconds", TOO_LONG);
    }
    return total;
}

// Runs on until all are finished; the virtual seconds that took.
static double run(company *c) {
    const double start = c->now;
    while (!is_over(c)) {
        turn(c);
    }
    return c->now - start;
}

// Until `step` steps are complete.
static void run_to(company *c, long step) {
    while (pm_lockstep_coordinator_step(c->coordinator) < step) {
        turn(c);
    }
}

// For `seconds`, without node `absent`.
static void run_without(company *c, int absent, double seconds) {
    pm_lockstep_node *node = c->node[absent];
    c->node[absent] = NULL;
    for (const double end = c->now + seconds; c->now < end;) {
        turn(c);
    }
    c->node[absent] = node;
}

static void assert_all_ok(company *c) {
    const pm_status status = pm_lockstep_coordinator_result(c->coordinator);
    if (status != PM_OK) {
        fail_msg("coordinator: %s", pm_error());
    }
    assert_int_equal(c->steps_seen, STEPS + 1);
    for (int i = 0; i < c->count; ++i) {
        if (pm_lockstep_node_result(c->node[i]) != PM_OK) {
            fail_msg("node %d: %s", i, pm_error());
        }
        assert_int_equal(pm_lockstep_node_step(c->node[i]), STEPS);
    }
}

static void assert_error(pm_status status, pm_status expected, const char *part) {
    assert_int_equal(status, expected);
    if (strstr(pm_error(), part) == NULL) {
        fail_msg("error \"%s\" does not name \"%s\"", pm_error(), part);
    }
}

// The coordinator and every node ended with `code`; the coordinator's error contains `part`.
static void assert_all_failed(const company *c, pm_status code, const char *part) {
    assert_error(pm_lockstep_coordinator_result(c->coordinator), code, part);
    for (int i = 0; i < c->count; ++i) {
        if (c->node[i] != NULL) {
            assert_int_equal(pm_lockstep_node_result(c->node[i]), code);
        }
    }
}

static pm_hub *make_hub(const pm_hub_faults *faults) {
    pm_hub *hub = NULL;
    assert_int_equal(pm_hub_open(&hub, faults), PM_OK);
    return hub;
}

// --- the same bits ---

static void test_same_bits_as_plain_loop(void **context) {
    (void)context;
    for (int count = 1; count <= MAX_NODES; ++count) {
        for (int window = 1; window <= 7; window += 3) {
            pm_hub *hub = make_hub(NULL);
            company c;
            open_all(&c, count, window, hub, 0);
            run(&c);
            assert_all_ok(&c);
            close_company(&c);
            pm_hub_close(hub);
        }
    }
}

static void test_same_bits_under_faults(void **context) {
    (void)context;
    for (uint64_t seed = 1; seed <= 24; ++seed) {
        const pm_hub_faults faults = {
            .seed = seed, .drop = 0.2, .duplicate = 0.2, .delay = 0.3, .max_delay = 12};
        pm_hub *hub = make_hub(&faults);
        company c;
        print_message("seed %d\n", (int)seed);
        open_all(&c, 2 + (int)(seed % 4), 1 + (int)(seed % 3), hub, 0);
        run(&c);
        assert_all_ok(&c);
        close_company(&c);
        pm_hub_close(hub);
    }
}

static void test_no_requests_without_loss(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_all(&c, 3, 1, hub, 0);
    run(&c);
    for (int i = 0; i < c.count; ++i) {
        const pm_drops *drops = pm_lockstep_node_drops(c.node[i]);
        for (int drop = PM_KEEP + 1; drop < PM_NDROP; ++drop) {
            assert_int_equal(drops->count[drop], 0);
        }
    }
    close_company(&c);
    pm_hub_close(hub);
}

static void test_steps_allocate_nothing(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_all(&c, 3, 2, hub, 0);
    assert_true(allocations > 0);
    run(&c);
    assert_all_ok(&c);
    assert_int_equal(allocations - c.allocations_at_step_5, 0);
    close_company(&c);
    pm_hub_close(hub);
}

// Two runs of one scene on one network keep apart by their sessions.
static void test_two_sessions_on_one_network(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company a, b;
    open_all(&a, 2, 1, hub, 111);
    open_all(&b, 2, 1, hub, 222);
    while (!is_over(&a) || !is_over(&b)) {
        turn(&a);
        turn(&b);
    }
    assert_all_ok(&a);
    assert_all_ok(&b);
    assert_true(pm_lockstep_node_drops(a.node[0])->count[PM_DROP_SESSION] > 0);
    close_company(&a);
    close_company(&b);
    pm_hub_close(hub);
}

// --- hostile and foreign messages ---

static void shout(pm_transport *transport, const char *channel, pm_rng *rng) {
    unsigned char data[300];
    for (size_t i = 0; i < sizeof data; ++i) {
        data[i] = (unsigned char)pm_rng_bits(rng);
    }
    assert_int_equal(
        pm_transport_publish(transport, channel, data, (size_t)pm_rng_below(rng, sizeof data)),
        PM_OK);
}

// Well-formed messages with another session, or steps that make no sense.
static void mislead(pm_transport *transport, int64_t session) {
    double y[2] = {1, 2};
    unsigned char data[512];
    size_t size;
    const portmet_tick_t tick = {.session = 1, .granted = 1000000, .steps = 2000000};
    size = pm_tick_encode(&tick, data, sizeof data);
    assert_int_equal(pm_transport_publish(transport, "chain_TICK", data, size), PM_OK);
    const portmet_command_t command = {.session = 1, .kind = 1, .code = 7, .reason = "foreign"};
    size = pm_command_encode(&command, data, sizeof data);
    assert_int_equal(pm_transport_publish(transport, "chain_COMMAND", data, size), PM_OK);
    portmet_flux_t flux = {.session = session, .step = 0, .ny = 2, .y = y, .e = y, .eta = y};
    size = pm_flux_encode(&flux, data, sizeof data);
    assert_int_equal(pm_transport_publish(transport, "chain_FLUX_link2_link1_joint1", data, size),
                     PM_OK);
    const portmet_request_t request = {.session = session,
                                       .sender = "link2",
                                       .channel = "chain_FLUX_link1_link2_joint1",
                                       .step = INT64_MAX,
                                       .round = INT32_MIN};
    size = pm_request_encode(&request, data, sizeof data);
    assert_int_equal(pm_transport_publish(transport, "chain_REQUEST", data, size), PM_OK);
}

static void test_garbage_changes_nothing(void **context) {
    (void)context;
    static const char *const channel[] = {
        "chain_TICK",    "chain_COMMAND",      "chain_FLUX_link1_link2_joint1",
        "chain_REQUEST", "chain_REPORT_link1", "chain_STATE_link2",
    };
    pm_rng rng;
    pm_rng_init(&rng, 5, 0);
    pm_hub *hub = make_hub(NULL);
    pm_transport *stranger;
    assert_int_equal(pm_transport_open(&stranger, "memory://", hub), PM_OK);
    company c;
    open_all(&c, 2, 2, hub, 77);
    while (!is_over(&c)) {
        for (size_t i = 0; i < sizeof channel / sizeof channel[0]; ++i) {
            shout(stranger, channel[i], &rng);
        }
        mislead(stranger, 77);
        turn(&c);
    }
    assert_all_ok(&c);
    const pm_drops *drops = pm_lockstep_node_drops(c.node[0]);
    assert_true(drops->count[PM_DROP_TYPE] + drops->count[PM_DROP_LENGTH] > 0);
    assert_true(drops->count[PM_DROP_COUNT] > 0);
    assert_true(drops->count[PM_DROP_SESSION] > 0);
    assert_true(drops->count[PM_DROP_RANGE] > 0);
    close_company(&c);
    pm_transport_close(stranger);
    pm_hub_close(hub);
}

// Publishes one message and hands it to `listener`; it must be dropped for the reason `expected`.
static void assert_dropped(pm_transport *stranger, const char *channel, const void *data,
                           size_t size, pm_transport *listener, const pm_drops *drops,
                           pm_drop expected, int line) {
    assert_int_equal(pm_transport_wait(listener, 0, NULL), PM_OK);
    pm_drops before = *drops;
    assert_true(size > 0);
    assert_int_equal(pm_transport_publish(stranger, channel, data, size), PM_OK);
    assert_int_equal(pm_transport_wait(listener, 0, NULL), PM_OK);
    before.count[expected] += 1;
    for (int i = 0; i < PM_NDROP; ++i) {
        if (drops->count[i] != before.count[i]) {
            fail_msg("line %d: expected a drop for \"%s\", got \"%s\" %ld times", line,
                     pm_drop_name(expected), pm_drop_name((pm_drop)i),
                     drops->count[i] - before.count[i]);
        }
    }
}

// Encodes a forged message and asserts why the node link1 or the coordinator drops it.
#define DROPS(listener, type, channel, reason, ...)                              \
    do {                                                                         \
        const portmet_##type##_t message_ = {__VA_ARGS__};                       \
        unsigned char data_[1024];                                               \
        const size_t size_ = pm_##type##_encode(&message_, data_, sizeof data_); \
        const bool node_ = strcmp(#listener, "node") == 0;                       \
        assert_dropped(stranger, channel, data_, size_,                          \
                       node_ ? c.transport[0] : c.coordinator_transport,         \
                       node_ ? pm_lockstep_node_drops(c.node[0])                 \
                             : pm_lockstep_coordinator_drops(c.coordinator),     \
                       PM_DROP_##reason, __LINE__);                              \
    } while (0)

#define FLUX(reason, session_, step_, round_)                                                      \
    DROPS(node, flux, "chain_FLUX_link2_link1_joint1", reason, .session = session_, .step = step_, \
          .round = round_, .ny = 3, .y = y, .e = y, .eta = y)
#define DONE(reason, session_, step_)                                                            \
    DROPS(coordinator, report, "chain_REPORT_link1", reason, .session = session_, .step = step_, \
          .kind = PORTMET_REPORT_T_DONE, .nport = 1, .energy_flux = y, .entropy_flux = y,        \
          .energy_gross = y, .entropy_gross = y, .message = "")
#define WORD(reason, session_, kind_)                                                             \
    DROPS(coordinator, report, "chain_REPORT_link1", reason, .session = session_, .kind = kind_,  \
          .nport = 1, .energy_flux = y, .entropy_flux = y, .energy_gross = y, .entropy_gross = y, \
          .message = "forged")
#define STATE(reason, session_, step_)                                                         \
    DROPS(coordinator, state, "chain_STATE_link1", reason, .session = session_, .step = step_, \
          .nz = 5, .z = y)

// Well-formed messages that make no sense at this point of the run, one by one.
static void test_forged_messages_are_dropped(void **context) {
    (void)context;
    enum { OWN = 77, FOREIGN = 78 };
    double y[5] = {1, 2, 3, 4, 5};
    pm_hub *hub = make_hub(NULL);
    pm_transport *stranger;
    assert_int_equal(pm_transport_open(&stranger, "memory://", hub), PM_OK);
    company c;
    open_all(&c, 2, 1, hub, OWN);
    run_to(&c, 5);

    FLUX(SESSION, FOREIGN, 5, 0);
    FLUX(REPEATED, OWN, 1, 0);
    FLUX(RANGE, OWN, 15, 0);
    FLUX(RANGE, OWN, -1, 0);
    FLUX(RANGE, OWN, 5, 8);
    FLUX(RANGE, OWN, 5, -1);
    FLUX(RANGE, OWN, INT64_MAX, 0);
    DROPS(node, tick, "chain_TICK", SESSION, .session = FOREIGN, .granted = 20, .steps = 20);
    DROPS(node, tick, "chain_TICK", REPEATED, .session = OWN, .granted = 2, .steps = 20);
    DROPS(node, tick, "chain_TICK", RANGE, .session = OWN, .granted = 21, .steps = 20);
    DROPS(node, tick, "chain_TICK", RANGE, .session = OWN, .granted = -1, .steps = 20);
    DROPS(node, command, "chain_COMMAND", SESSION, .session = FOREIGN, .kind = 1, .reason = "");
    DROPS(node, command, "chain_COMMAND", RANGE, .session = OWN, .kind = 0, .reason = "");
    DROPS(node, command, "chain_COMMAND", RANGE, .session = OWN, .kind = 9, .reason = "");
    DROPS(node, request, "chain_REQUEST", SESSION, .session = FOREIGN, .sender = "", .channel = "");
    DROPS(node, request, "chain_REQUEST", RANGE, .session = OWN, .sender = "", .channel = "",
          .step = -1);
    DROPS(node, request, "chain_REQUEST", RANGE, .session = OWN, .sender = "", .channel = "",
          .step = INT64_MAX);
    DROPS(node, request, "chain_REQUEST", RANGE, .session = OWN, .sender = "", .channel = "",
          .round = 8);

    DONE(SESSION, FOREIGN, 6);
    DONE(REPEATED, OWN, 5);
    DONE(RANGE, OWN, 7);
    DONE(RANGE, OWN, -1);
    WORD(SESSION, FOREIGN, PORTMET_REPORT_T_HELLO);
    WORD(REPEATED, OWN, PORTMET_REPORT_T_HELLO);
    WORD(SESSION, FOREIGN, PORTMET_REPORT_T_FAILED);
    WORD(SESSION, 0, PORTMET_REPORT_T_FAILED);
    WORD(RANGE, OWN, PORTMET_REPORT_T_BYE);
    WORD(RANGE, OWN, 9);
    STATE(SESSION, FOREIGN, 6);
    STATE(REPEATED, OWN, 5);
    STATE(RANGE, OWN, 7);
    DROPS(coordinator, request, "chain_REQUEST", SESSION, .session = FOREIGN, .sender = "",
          .channel = "");

    run(&c);
    assert_all_ok(&c);
    close_company(&c);
    pm_transport_close(stranger);
    pm_hub_close(hub);
}

// What arrives twice is used once.
static void test_repetitions_are_counted(void **context) {
    (void)context;
    const pm_hub_faults faults = {.seed = 1, .duplicate = 1};
    pm_hub *hub = make_hub(&faults);
    company c;
    open_all(&c, 2, 2, hub, 0);
    run(&c);
    assert_all_ok(&c);
    // 8 rounds a step, and one report and state a step from each node.
    assert_true(pm_lockstep_node_drops(c.node[0])->count[PM_DROP_REPEATED] >= 8 * STEPS);
    assert_true(pm_lockstep_coordinator_drops(c.coordinator)->count[PM_DROP_REPEATED] >= 4 * STEPS);
    close_company(&c);
    pm_hub_close(hub);
}

// --- failures ---

// A peer that waits for another one is not given up: its requests are signs of life.
static void test_who_waits_is_alive(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_all(&c, 4, 1, hub, 0);
    run_to(&c, 5);
    for (int absent = 3; absent > 0; --absent) {
        run_without(&c, absent, 0.7 * PATIENCE);
    }
    run(&c);
    assert_all_ok(&c);
    close_company(&c);
    pm_hub_close(hub);
}

static void test_other_digest_is_refused_by_name(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_company(&c, 3, 1, hub, 0);
    fixture other = {0};
    fixture_open(&other, 3, 999);
    add_node(&c, 0, c.f.system, 0);
    add_node(&c, 1, other.system, 0);
    add_node(&c, 2, c.f.system, 0);
    run(&c);
    assert_all_failed(&c, PM_ENET, "link2");
    assert_int_equal(c.steps_seen, 0);
    close_company(&c);
    fixture_close(&other);
    pm_hub_close(hub);
}

// The step is the coordinator's to tell: a node that would step otherwise says so.
static void test_other_step_is_refused(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_company(&c, 2, 1, hub, 0);
    fixture other = {0};
    fixture_open(&other, 2, 1234);
    other.scene->dt *= 2;
    add_node(&c, 0, other.system, 0);
    add_node(&c, 1, c.f.system, 0);
    run(&c);
    assert_all_failed(&c, PM_ENET, "link1 failed: the coordinator's scene steps by 0.02");
    close_company(&c);
    fixture_close(&other);
    pm_hub_close(hub);
}

static void test_missing_node_is_named(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_company(&c, 3, 1, hub, 0);
    add_node(&c, 0, c.f.system, 0);
    add_node(&c, 1, c.f.system, 0);
    const double took = run(&c);
    assert_true(took < 2 * PATIENCE);
    assert_all_failed(&c, PM_ETIMEOUT, "missing");
    assert_non_null(strstr((pm_lockstep_coordinator_result(c.coordinator), pm_error()), "link3"));
    assert_null(strstr(pm_error(), "link1"));
    close_company(&c);
    pm_hub_close(hub);
}

static void test_node_without_coordinator_gives_up(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_all(&c, 2, 1, hub, 0);
    pm_lockstep_coordinator_close(c.coordinator);
    pm_transport_close(c.coordinator_transport);
    c.coordinator = NULL;
    c.coordinator_transport = NULL;
    run(&c);
    assert_error(pm_lockstep_node_result(c.node[1]), PM_ETIMEOUT, "no coordinator");
    close_company(&c);
    pm_hub_close(hub);
}

// A node that stops in the middle of a run; the end of it names that node and no other.
static void test_dead_node_is_named(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_all(&c, 4, 2, hub, 0);
    run_to(&c, 5);
    pm_lockstep_node *dead = c.node[2];
    c.node[2] = NULL;
    const double took = run(&c);
    assert_true(took < 2 * PATIENCE);
    assert_error(pm_lockstep_coordinator_result(c.coordinator), PM_ETIMEOUT, "link3");
    for (int i = 0; i < c.count; ++i) {
        if (c.node[i] != NULL) {
            assert_int_equal(pm_lockstep_node_result(c.node[i]), PM_ETIMEOUT);
        }
    }
    pm_lockstep_node_close(dead);
    close_company(&c);
    pm_hub_close(hub);
}

static void test_dead_coordinator_is_named(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_all(&c, 3, 1, hub, 0);
    run_to(&c, 5);
    pm_lockstep_coordinator *dead = c.coordinator;
    c.coordinator = NULL;
    const double took = run(&c);
    assert_true(took < 2 * PATIENCE);
    for (int i = 0; i < c.count; ++i) {
        assert_error(pm_lockstep_node_result(c.node[i]), PM_ETIMEOUT, "coordinator");
    }
    c.coordinator = dead;
    close_company(&c);
    pm_hub_close(hub);
}

static void test_failure_of_a_node_ends_all(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_all(&c, 3, 1, hub, 0);
    run_to(&c, 3);
    pm_lockstep_node_fail(c.node[1], PM_ENUMERIC, "z[2] is nan");
    const double took = run(&c);
    assert_true(took < 1);
    assert_all_failed(&c, PM_ENUMERIC, "link2 failed: z[2] is nan");
    assert_error(pm_lockstep_node_result(c.node[0]), PM_ENUMERIC, "link2");
    close_company(&c);
    pm_hub_close(hub);
}

static void test_divergence_ends_all(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_company(&c, 2, 1, hub, 0);
    c.f.z[0] = c.f.z[2] = 1e200;
    add_node(&c, 0, c.f.system, 0);
    add_node(&c, 1, c.f.system, 0);
    run(&c);
    assert_all_failed(&c, PM_ENUMERIC, "link1");
    close_company(&c);
    pm_hub_close(hub);
}

static void test_failure_of_the_observer_ends_all(void **context) {
    (void)context;
    pm_hub *hub = make_hub(NULL);
    company c;
    open_all(&c, 2, 1, hub, 0);
    c.fail_at_step = 4;
    run(&c);
    assert_all_failed(&c, PM_EFILE, "the recording is full");
    assert_int_equal(c.steps_seen, 5);
    close_company(&c);
    pm_hub_close(hub);
}

static void test_failure_arrives_under_faults(void **context) {
    (void)context;
    for (uint64_t seed = 1; seed <= 8; ++seed) {
        const pm_hub_faults faults = {
            .seed = seed, .drop = 0.3, .duplicate = 0.2, .delay = 0.3, .max_delay = 12};
        pm_hub *hub = make_hub(&faults);
        company c;
        open_all(&c, 3, 1, hub, 0);
        run_to(&c, 3);
        pm_lockstep_node_fail(c.node[2], PM_EINTERRUPTED, "interrupted");
        run(&c);
        assert_all_failed(&c, PM_EINTERRUPTED, "link3 failed: interrupted");
        close_company(&c);
        pm_hub_close(hub);
    }
}

static void test_together_and_interrupted(void **context) {
    (void)context;
    volatile sig_atomic_t stop = 0;
    for (int interrupted = 0; interrupted < 2; ++interrupted) {
        pm_hub *hub = make_hub(NULL);
        company c;
        open_all(&c, 3, 1, hub, 0);
        stop = interrupted;
        const pm_status status = pm_lockstep_run_together(c.coordinator, c.count, c.node, &stop);
        if (interrupted) {
            assert_error(status, PM_EINTERRUPTED, "interrupted");
        } else {
            assert_int_equal(status, PM_OK);
            assert_int_equal(c.steps_seen, STEPS + 1);
        }
        close_company(&c);
        pm_hub_close(hub);
    }
}

// --- names of channels ---

static void test_channel_names(void **context) {
    (void)context;
    fixture f = {0};
    fixture_open(&f, 3, 1);
    char channel[PM_CHANNEL_SIZE];
    assert_int_equal(pm_channel_flux(channel, f.scene, 1, PM_END_B), PM_OK);
    assert_string_equal(channel, "chain_FLUX_link3_link2_joint2");
    // link1 to x_joint through y, and link1 to x through joint_y, read the same.
    f.scene->subsystem[1].name = "x_joint";
    f.scene->port[0].subsystem[1] = 1;
    f.scene->port[0].name = "y";
    f.scene->subsystem[2].name = "x";
    f.scene->port[1].subsystem[0] = 0;
    f.scene->port[1].name = "joint_y";
    assert_error(pm_channel_flux(channel, f.scene, 0, PM_END_A), PM_ECONFIG, "share the channel");
    f.scene->name = "a_scene_with_a_name_that_is_much_too_long_for_a_channel_of_lcm";
    assert_error(pm_channel_scene(channel, f.scene, "TICK"), PM_ECONFIG, "at most 63");
    fixture_close(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_bits_as_plain_loop),
        cmocka_unit_test(test_same_bits_under_faults),
        cmocka_unit_test(test_no_requests_without_loss),
        cmocka_unit_test(test_steps_allocate_nothing),
        cmocka_unit_test(test_two_sessions_on_one_network),
        cmocka_unit_test(test_garbage_changes_nothing),
        cmocka_unit_test(test_forged_messages_are_dropped),
        cmocka_unit_test(test_repetitions_are_counted),
        cmocka_unit_test(test_who_waits_is_alive),
        cmocka_unit_test(test_other_digest_is_refused_by_name),
        cmocka_unit_test(test_other_step_is_refused),
        cmocka_unit_test(test_missing_node_is_named),
        cmocka_unit_test(test_node_without_coordinator_gives_up),
        cmocka_unit_test(test_dead_node_is_named),
        cmocka_unit_test(test_dead_coordinator_is_named),
        cmocka_unit_test(test_failure_of_a_node_ends_all),
        cmocka_unit_test(test_divergence_ends_all),
        cmocka_unit_test(test_failure_of_the_observer_ends_all),
        cmocka_unit_test(test_failure_arrives_under_faults),
        cmocka_unit_test(test_together_and_interrupted),
        cmocka_unit_test(test_channel_names),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
