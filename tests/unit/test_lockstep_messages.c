// Messages that are malformed, foreign, late or forged: each is dropped for its own reason,
// counted, and changes no bit. The names of channels are tested here, too.
#include <string.h>

#include "base/rng.h"
#include "lockstep/codec.h"
#include "tests/support/cluster_fixture.h"
#include "tests/support/unit.h"
#include "transport/channel.h"

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
    portmet_flux_t flux = {.session = session,
                           .nend = 1,
                           .energy_flux = y,
                           .entropy_flux = y,
                           .ny = 2,
                           .y = y,
                           .e = y,
                           .eta = y};
    size = pm_flux_encode(&flux, data, sizeof data);
    assert_int_equal(pm_transport_publish(transport, "chain_FLUX_link2", data, size), PM_OK);
    const portmet_request_t request = {.session = session,
                                       .sender = "link2",
                                       .channel = "chain_FLUX_link1",
                                       .step = INT64_MAX,
                                       .round = INT32_MIN};
    size = pm_request_encode(&request, data, sizeof data);
    assert_int_equal(pm_transport_publish(transport, "chain_REQUEST", data, size), PM_OK);
}

static void test_garbage_changes_nothing(void **context) {
    (void)context;
    static const char *const channel[] = {
        "chain_TICK", "chain_COMMAND", "chain_FLUX_link1", "chain_REQUEST", "chain_REPORT_link1",
    };
    pm_rng rng;
    pm_rng_init(&rng, 5, 0);
    pm_hub *hub = cluster_hub(NULL);
    pm_transport *stranger;
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    cluster c;
    cluster_open_all(&c, 2, 2, hub, 77);
    while (!cluster_is_over(&c)) {
        for (size_t i = 0; i < sizeof channel / sizeof channel[0]; ++i) {
            shout(stranger, channel[i], &rng);
        }
        mislead(stranger, 77);
        cluster_turn(&c);
        c.now += TICK; // which cluster_turn() does only in silence
    }
    assert_all_ok(&c);
    const pm_drops *drops = pm_lockstep_node_drops(c.node[0]);
    assert_true(drops->count[PM_DROP_TYPE] + drops->count[PM_DROP_LENGTH] > 0);
    assert_true(drops->count[PM_DROP_COUNT] > 0);
    assert_true(drops->count[PM_DROP_SESSION] > 0);
    assert_true(drops->count[PM_DROP_IMPLAUSIBLE] > 0);
    pm_transport_close(stranger);
    cluster_end(&c);
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

enum { OWN = 77, FOREIGN = 78 }; // sessions

// A forger that sends messages to a cluster, and the messages that it changes.
typedef struct forger {
    cluster c;
    pm_transport *stranger;
    double y[5];
    int64_t n[1], first; // instance of the first node
} forger;

// Encodes a forged message and asserts why the node link2 or the coordinator drops it.
#define DROPS(listener, type, channel, reason, ...)                              \
    do {                                                                         \
        const portmet_##type##_t message_ = {__VA_ARGS__};                       \
        unsigned char data_[1024];                                               \
        const size_t size_ = pm_##type##_encode(&message_, data_, sizeof data_); \
        const bool node_ = strcmp(#listener, "node") == 0;                       \
        assert_dropped(f->stranger, channel, data_, size_,                       \
                       node_ ? f->c.transport[1] : f->c.coordinator_transport,   \
                       node_ ? pm_lockstep_node_drops(f->c.node[1])              \
                             : pm_lockstep_coordinator_drops(f->c.coordinator),  \
                       PM_DROP_##reason, __LINE__);                              \
    } while (0)

#define FLUX(reason, session_, step_, round_)                                         \
    DROPS(node, flux, "chain_FLUX_link1", reason, .session = session_, .step = step_, \
          .round = round_, .time = time_of(f, step_), .nend = 1, .energy_flux = f->y, \
          .entropy_flux = f->y, .ny = 3, .y = f->y, .e = f->y, .eta = f->y)
#define LIST_double f->y
#define LIST_long f->n
#define NUMBER(type, name, series, unit) .name = LIST_##type,
#define BULK(member, name, series, unit) .name = f->y,
#define END(member, name, series, unit) .name = f->y,
#define REPORT(reason, session_, kind_, step_, npart_, nend_, nz_)                            \
    DROPS(coordinator, report, "chain_REPORT_link1", reason, .session = session_,             \
          .digest = (int64_t)f->c.f.system->digest, .time = time_of(f, step_),                \
          .instance = f->first, .kind = kind_, .step = step_, .npart = npart_, .nend = nend_, \
          PM_SUBSYSTEM_NUMBERS(NUMBER, BULK) PM_END_NUMBERS(END).nz = nz_, .z = f->y,         \
          .message = "forged")
#define DONE(reason, session_, step_) \
    REPORT(reason, session_, PORTMET_REPORT_T_DONE, step_, 1, 1, 5)
#define WORD(reason, session_, kind_) REPORT(reason, session_, kind_, 0, 0, 0, 0)

// A tick of the run, of the coordinator or of the instance after it.
#define TICK_OF(reason, later_, granted_)                                                         \
    DROPS(node, tick, "chain_TICK", reason, .session = OWN,                                       \
          .instance = cluster_instance(&f->c) + later_, .digest = (int64_t)f->c.f.system->digest, \
          .granted = granted_, .steps = STEPS, .dt = f->c.f.scene->physics.dt, .want_state = 1,   \
          .served = OWN, .run = 1)

static double time_of(const forger *f, int64_t step) {
    return pm_scene_time(f->c.f.scene, (long)step);
}

// Before a node has begun.
static void forge_beginnings(forger *f) {
    const int64_t digest = (int64_t)f->c.f.system->digest;
    DROPS(node, tick, "chain_TICK", SESSION, .session = OWN, .served = OWN, .digest = digest + 1,
          .steps = 20);
    DROPS(node, tick, "chain_TICK", SESSION, .session = FOREIGN, .digest = digest, .steps = 20,
          .served = FOREIGN, .run = 1);
    DROPS(node, tick, "chain_TICK", IMPLAUSIBLE, .session = OWN, .served = OWN, .digest = digest,
          .instance = 1, .steps = -1);
    DROPS(node, tick, "chain_TICK", IMPLAUSIBLE, .session = OWN, .served = OWN, .digest = digest,
          .instance = 1, .steps = INT64_MAX);
    TICK_OF(SESSION, 0, 0); // answers nobody, such as one of an earlier run
    DROPS(node, command, "chain_COMMAND", SESSION, .session = FOREIGN, .kind = 1, .reason = "");
    DROPS(node, command, "chain_COMMAND", RANGE, .session = OWN, .kind = 1, .reason = "");
    DROPS(node, command, "chain_COMMAND", RANGE, .session = OWN, .kind = PORTMET_COMMAND_T_REFUSE,
          .addressee = cluster_node_instance(f->c.node[1]), .answer = 5, .reason = "");
    DROPS(node, request, "chain_REQUEST", SESSION, .sender = "", .channel = "");
}

// Within step 5.
static void forge_for_node(forger *f) {
    const int64_t leader = cluster_instance(&f->c);
    FLUX(SESSION, FOREIGN, 5, 0);
    FLUX(REPEATED, OWN, 1, 0);
    FLUX(RANGE, OWN, 15, 0);
    FLUX(IMPLAUSIBLE, OWN, -1, 0);
    FLUX(IMPLAUSIBLE, OWN, 5, 8);
    FLUX(IMPLAUSIBLE, OWN, 5, -1);
    FLUX(IMPLAUSIBLE, OWN, INT64_MAX, 0);
    DROPS(node, flux, "chain_FLUX_link1", IMPLAUSIBLE, .session = OWN, .step = 5, .round = 7,
          .time = time_of(f, 6), .nend = 1, .energy_flux = f->y, .entropy_flux = f->y, .ny = 3,
          .y = f->y, .e = f->y, .eta = f->y);
    DROPS(node, tick, "chain_TICK", SESSION, .session = FOREIGN, .granted = 20, .steps = 20);
    TICK_OF(REPEATED, 0, 2);
    TICK_OF(IMPLAUSIBLE, 0, 21);
    TICK_OF(IMPLAUSIBLE, 0, 9); // more than any coordinator grants now
    TICK_OF(IMPLAUSIBLE, 0, -1);
    TICK_OF(RANGE, 1, 7); // of nobody who has answered a question
    DROPS(node, command, "chain_COMMAND", SESSION, .session = FOREIGN, .kind = 1, .reason = "");
    DROPS(node, command, "chain_COMMAND", RANGE, .session = OWN, .instance = leader, .kind = 0,
          .reason = "");
    DROPS(node, command, "chain_COMMAND", RANGE, .session = OWN, .instance = leader + 1, .kind = 1,
          .reason = "");
    DROPS(node, command, "chain_COMMAND", IMPLAUSIBLE, .session = OWN, .kind = 9, .reason = "");
    DROPS(node, command, "chain_COMMAND", RANGE, .session = OWN, .kind = PORTMET_COMMAND_T_REFUSE,
          .addressee = cluster_node_instance(f->c.node[1]), .reason = "");
    DROPS(node, command, "chain_COMMAND", SESSION, .session = OWN, .kind = PORTMET_COMMAND_T_REFUSE,
          .addressee = 1, .reason = "");
    DROPS(node, request, "chain_REQUEST", SESSION, .session = FOREIGN, .sender = "", .channel = "");
    DROPS(node, request, "chain_REQUEST", RANGE, .session = OWN, .sender = "", .channel = "",
          .instance = leader + 1);
    DROPS(node, request, "chain_REQUEST", IMPLAUSIBLE, .session = OWN, .sender = "", .channel = "",
          .step = -1);
    DROPS(node, request, "chain_REQUEST", IMPLAUSIBLE, .session = OWN, .sender = "", .channel = "",
          .step = INT64_MAX);
    DROPS(node, request, "chain_REQUEST", IMPLAUSIBLE, .session = OWN, .sender = "", .channel = "",
          .round = 8);
}

static void forge_for_coordinator(forger *f) {
    DONE(SESSION, FOREIGN, 6);
    DONE(RANGE, OWN, 7);
    DONE(IMPLAUSIBLE, OWN, -1);
    DONE(IMPLAUSIBLE, OWN, INT64_MAX);
    REPORT(COUNT, OWN, PORTMET_REPORT_T_DONE, 6, 0, 0, 0); // no step
    REPORT(COUNT, OWN, PORTMET_REPORT_T_DONE, 6, 1, 0, 5); // a port is missing
    REPORT(COUNT, OWN, PORTMET_REPORT_T_DONE, 6, 1, 1, 4); // the state is incomplete
    REPORT(COUNT, OWN, PORTMET_REPORT_T_DONE, 6, 1, 1, 0); // the state is missing
    DROPS(coordinator, hello, "chain_HELLO_link1", SESSION, .session = FOREIGN, .sender = "link1");
    DROPS(coordinator, hello, "chain_HELLO_link1", SESSION, .session = 0, .sender = "link1");
    DROPS(coordinator, hello, "chain_HELLO", IMPLAUSIBLE, .session = OWN, .sender = "link9",
          .coordinator = cluster_instance(&f->c));
    WORD(SESSION, FOREIGN, PORTMET_REPORT_T_FAILED);
    WORD(SESSION, 0, PORTMET_REPORT_T_FAILED);
    WORD(IMPLAUSIBLE, OWN, PORTMET_REPORT_T_FAILED); // for another coordinator
    WORD(IMPLAUSIBLE, OWN, PORTMET_REPORT_T_BYE);
    WORD(IMPLAUSIBLE, OWN, 9);
    f->first += 1;
    DONE(REPEATED, OWN, 6); // by another node of that name
    DROPS(coordinator, request, "chain_REQUEST", SESSION, .session = FOREIGN, .sender = "",
          .channel = "");
}

static void test_forged_messages_are_dropped(void **context) {
    (void)context;
    forger f = {.y = {1, 2, 3, 4, 5}, .n = {1}};
    pm_hub *hub = cluster_hub(NULL);
    assert_int_equal(pm_hub_connect(hub, &f.stranger), PM_OK);
    cluster_open_all(&f.c, 3, 1, hub, OWN);
    forge_beginnings(&f);
    f.first = cluster_node_instance(f.c.node[0]);
    cluster_run_to(&f.c, 5);
    forge_for_node(&f);
    forge_for_coordinator(&f);
    cluster_run(&f.c);
    assert_all_ok(&f.c);
    cluster_close(&f.c);
    pm_transport_close(f.stranger);
    pm_hub_close(hub);
}

// A coordinator that has returned may grant less than the one before it: no node computes beyond
// that. A node follows it when it has answered a question, and no tick that answers nothing.
static void test_later_coordinator_grants_anew(void **context) {
    (void)context;
    static const struct {
        int64_t instance, granted;
        bool answers;
        long step; // that the nodes then stand at
    } ticks[] = {
        {INT64_MAX, 7, false, 6}, {5, 7, true, 7}, {6, 6, true, 7},  {5, 8, false, 7},
        {6, 8, false, 8},         {5, 8, true, 8}, {5, 9, false, 9},
    };
    pm_hub *hub = cluster_hub(NULL);
    pm_transport *stranger;
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    cluster c;
    cluster_open_all(&c, 2, 1, hub, 77);
    cluster_run_to(&c, 5);
    for (size_t i = 0; i < sizeof ticks / sizeof ticks[0]; ++i) {
        // Asked for by a tick that answers nothing.
        for (int answers = 0; answers <= ticks[i].answers; ++answers) {
            int64_t nonces[2] = {cluster_nonce(c.node[0]), cluster_nonce(c.node[1])};
            const portmet_tick_t tick = {.session = 77,
                                         .instance = ticks[i].instance,
                                         .digest = (int64_t)c.f.system->digest,
                                         .granted = ticks[i].granted,
                                         .steps = STEPS,
                                         .dt = c.f.scene->physics.dt,
                                         .want_state = 1,
                                         .served = 77,
                                         .run = 1,
                                         .nanswer = answers ? 2 : 0,
                                         .answer = nonces};
            unsigned char data[256];
            const size_t size = pm_tick_encode(&tick, data, sizeof data);
            assert_int_equal(pm_transport_publish(stranger, "chain_TICK", data, size), PM_OK);
            for (int k = 0; k < 2; ++k) {
                assert_int_equal(pm_transport_wait(c.transport[k], 0, NULL), PM_OK);
                pm_lockstep_node_poll(c.node[k], c.now);
            }
        }
        c.now += 0.05;
        for (int turn = 0; turn < 100; ++turn) {
            for (int k = 0; k < 2; ++k) {
                assert_int_equal(pm_transport_wait(c.transport[k], 0, NULL), PM_OK);
                pm_lockstep_node_poll(c.node[k], c.now);
            }
        }
        assert_int_equal(cluster_node_step(c.node[0]), ticks[i].step);
    }
    pm_transport_close(stranger);
    cluster_end(&c);
}

static void count_message(void *context, const char *channel, const void *data, size_t size) {
    (void)channel, (void)data, (void)size;
    ++*(int *)context;
}

// A request is answered once, and only if the message exists.
static void test_requests_are_answered_once(void **context) {
    (void)context;
    static const char flux[] = "chain_FLUX_link1", report[] = "chain_REPORT_link1";
    static const struct {
        const char *channel;
        int64_t step;
        int round, answers;
    } cases[] = {
        {report, 5, 0, 1}, {report, 4, 0, 1}, {report, 6, 0, 0}, {report, 0, 0, 0},
        {flux, 5, 0, 1},   {flux, 4, 7, 0},   {flux, 6, 0, 0},   {"chain_REPORT_link2", 5, 0, 0},
    };
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 3, 1, hub, 77);
    cluster_run_to(&c, 5);
    pm_transport *stranger;
    int count = 0;
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    assert_int_equal(pm_transport_subscribe(stranger, flux, count_message, &count), PM_OK);
    assert_int_equal(pm_transport_subscribe(stranger, report, count_message, &count), PM_OK);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        const portmet_request_t request = {.session = 77,
                                           .sender = "link2",
                                           .channel = (char *)cases[i].channel,
                                           .step = cases[i].step,
                                           .round = cases[i].round};
        unsigned char data[256];
        const size_t size = pm_request_encode(&request, data, sizeof data);
        assert_int_equal(pm_transport_publish(stranger, "chain_REQUEST", data, size), PM_OK);
        count = 0;
        assert_int_equal(pm_transport_wait(c.transport[0], 0, NULL), PM_OK);
        assert_int_equal(pm_transport_wait(stranger, 0, NULL), PM_OK);
        if (count != cases[i].answers) {
            fail_msg("%s step %d: %d answers, expected %d", cases[i].channel, (int)cases[i].step,
                     count, cases[i].answers);
        }
    }
    cluster_run(&c);
    assert_all_ok(&c);
    pm_transport_close(stranger);
    cluster_end(&c);
}

static void note_step(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    double number[3];
    portmet_flux_t flux = {.nend = 1,
                           .energy_flux = number,
                           .entropy_flux = number,
                           .ny = 3,
                           .y = number,
                           .e = number,
                           .eta = number};
    assert_int_equal(pm_flux_decode(&flux, data, size), PM_KEEP);
    *(int64_t *)context = flux.step;
}

// The step of the last flux of three nodes that have done all that is granted: six steps.
static int64_t last_shown(double tolerance) {
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 3, 1, hub, 77);
    c.f.scene->physics.tolerance = tolerance;
    cluster_run_to(&c, 5);
    pm_transport *stranger;
    int64_t shown = -1;
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    assert_int_equal(pm_transport_subscribe(stranger, "chain_FLUX_link1", note_step, &shown),
                     PM_OK);
    for (int turn = 0; turn < 100; ++turn) {
        for (int k = 0; k < 3; ++k) {
            assert_int_equal(pm_transport_wait(c.transport[k], 0, NULL), PM_OK);
            pm_lockstep_node_poll(c.node[k], c.now);
        }
    }
    assert_int_equal(cluster_node_step(c.node[0]), 6);
    assert_int_equal(pm_transport_wait(stranger, 0, NULL), PM_OK);
    pm_transport_close(stranger);
    cluster_end(&c);
    return shown;
}

// The tick then finds everybody with the neighbours' fluxes at hand, unless it is to say how they
// are reckoned.
static void test_fluxes_are_sent_ahead_of_the_grant(void **context) {
    (void)context;
    assert_int_equal(last_shown(0), 6);
    assert_int_equal(last_shown(1e-3), 5);
}

// What arrives twice is used once.
static void test_repetitions_are_counted(void **context) {
    (void)context;
    const pm_hub_faults faults = {.seed = 1, .duplicate = 1};
    pm_hub *hub = cluster_hub(&faults);
    cluster c;
    cluster_open_all(&c, 2, 2, hub, 0);
    cluster_run(&c);
    assert_all_ok(&c);
    // 8 rounds a step, and one report a step from each node.
    assert_true(pm_lockstep_node_drops(c.node[0])->count[PM_DROP_REPEATED] >= 8 * STEPS);
    assert_true(pm_lockstep_coordinator_drops(c.coordinator)->count[PM_DROP_REPEATED] >= 2 * STEPS);
    cluster_end(&c);
}

// --- names of channels ---

static void test_channel_names(void **context) {
    (void)context;
    fixture f = {0};
    fixture_open(&f, 3, 1);
    char channel[PM_CHANNEL_SIZE];
    assert_int_equal(pm_channel_process(channel, f.scene, "FLUX", 2), PM_OK);
    assert_string_equal(channel, "chain_FLUX_link3");
    f.scene->name = "a_scene_with_a_name_that_is_much_too_long_for_a_channel_of_lcm";
    assert_error(pm_channel_scene(channel, f.scene->name, "TICK"), PM_ECONFIG, "at most 63");
    fixture_close(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_garbage_changes_nothing),
        cmocka_unit_test(test_forged_messages_are_dropped),
        cmocka_unit_test(test_later_coordinator_grants_anew),
        cmocka_unit_test(test_requests_are_answered_once),
        cmocka_unit_test(test_fluxes_are_sent_ahead_of_the_grant),
        cmocka_unit_test(test_repetitions_are_counted),
        cmocka_unit_test(test_channel_names),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
