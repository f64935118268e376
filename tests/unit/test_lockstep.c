// The lock-step protocol over the memory transport, in virtual time: the same bits as the plain
// loop for any faults of the network, and a clear error for any failure of a node.
#include <string.h>

#include "lockstep/codec.h"
#include "tests/support/allocations.h"
#include "tests/support/cluster_fixture.h"
#include "tests/support/together.h"
#include "tests/support/unit.h"

static long count_allocations(void) {
    return allocations;
}

// --- the same bits ---

static void test_same_bits_as_plain_loop(void **context) {
    (void)context;
    for (int count = 1; count <= MAX_NODES; ++count) {
        for (int window = 1; window <= 7; window += 3) {
            pm_hub *hub = cluster_hub(NULL);
            cluster c;
            cluster_open_all(&c, count, window, hub, 0);
            // No waiting but for the nodes' lingering at the end.
            assert_true(cluster_run(&c) < 0.19);
            assert_all_ok(&c);
            cluster_end(&c);
        }
    }
}

// The subsystems are distributed to processes in several ways, with and without faults.
static void test_same_bits_in_any_processes(void **context) {
    (void)context;
    for (int count = 1; count < MAX_NODES; ++count) {
        for (uint64_t seed = 0; seed < 4; ++seed) {
            const double part = seed == 0 ? 0 : 0.2;
            const pm_hub_faults faults = {
                .seed = seed, .drop = part, .duplicate = part, .delay = part, .max_delay = 12};
            pm_hub *hub = cluster_hub(&faults);
            cluster c;
            cluster_open_dealt(&c, MAX_NODES, count, 1 + 5 * (int)seed, hub);
            cluster_run(&c);
            assert_all_ok(&c);
            cluster_end(&c);
        }
    }
}

static void test_same_bits_under_faults(void **context) {
    (void)context;
    for (uint64_t seed = 1; seed <= 24; ++seed) {
        const pm_hub_faults faults = {
            .seed = seed, .drop = 0.2, .duplicate = 0.2, .delay = 0.3, .max_delay = 12};
        pm_hub *hub = cluster_hub(&faults);
        cluster c;
        print_message("seed %d\n", (int)seed);
        cluster_open_all(&c, 2 + (int)(seed % 4), 1 + (int)(seed % 3), hub, 0);
        cluster_run(&c);
        assert_all_ok(&c);
        cluster_end(&c);
    }
}

static void test_no_requests_without_loss(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 3, 1, hub, 0);
    cluster_run(&c);
    for (int i = 0; i < c.count; ++i) {
        const pm_drops *drops = pm_lockstep_node_drops(c.node[i]);
        for (int drop = PM_KEEP + 1; drop < PM_NDROP; ++drop) {
            assert_int_equal(drops->count[drop], 0);
        }
    }
    cluster_end(&c);
}

static void count_message(void *context, const char *channel, const void *data, size_t size) {
    (void)channel, (void)data, (void)size;
    *(int *)context += 1;
}

// A request reaches only the silent process and the coordinator; after a long wait it reaches all.
static void test_requests_wake_few(void **context) {
    (void)context;
    static const char *const channel[] = {"chain_REQUEST_link3", "chain_REQUEST_TICK",
                                          "chain_REQUEST"};
    int count[3] = {0};
    pm_hub *hub = cluster_hub(NULL);
    pm_transport *stranger;
    cluster c;
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    for (int i = 0; i < 3; ++i) {
        assert_int_equal(pm_transport_subscribe(stranger, channel[i], count_message, &count[i]),
                         PM_OK);
    }
    cluster_open_all(&c, 3, 16, hub, 0);
    cluster_run_to(&c, 5);
    cluster_run_without(&c, 2, 0.05);
    assert_int_equal(pm_transport_wait(stranger, 0, NULL), PM_OK);
    assert_true(count[0] > 0);
    assert_int_equal(count[1] + count[2], 0);
    cluster_run_without(&c, 2, 0.2);
    assert_int_equal(pm_transport_wait(stranger, 0, NULL), PM_OK);
    assert_true(count[2] > 0);
    cluster_run(&c);
    assert_all_ok(&c);
    pm_transport_close(stranger);
    cluster_end(&c);
}

static void test_steps_allocate_nothing(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 3, 2, hub, 0);
    c.count_allocations = count_allocations;
    assert_true(allocations > 0);
    cluster_run(&c);
    assert_all_ok(&c);
    assert_int_equal(allocations - c.allocations_at_step_5, 0);
    cluster_end(&c);
}

// Two runs of one scene on one network keep apart by their sessions.
static void test_two_sessions_on_one_network(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster a, b;
    cluster_open_all(&a, 2, 1, hub, 111);
    cluster_open_all(&b, 2, 1, hub, 222);
    while (!cluster_is_over(&a) || !cluster_is_over(&b)) {
        cluster_turn(&a);
        cluster_turn(&b);
    }
    assert_all_ok(&a);
    assert_all_ok(&b);
    assert_true(pm_lockstep_node_drops(a.node[0])->count[PM_DROP_SESSION] > 0);
    cluster_close(&a);
    cluster_end(&b);
}

// --- failures ---

// A peer that waits for another one is not given up: its requests are signs of life.
static void test_who_waits_is_alive(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 4, 1, hub, 0);
    cluster_run_to(&c, 5);
    for (int absent = 3; absent > 0; --absent) {
        cluster_run_without(&c, absent, 0.7 * PATIENCE);
    }
    cluster_run(&c);
    assert_all_ok(&c);
    cluster_end(&c);
}

// Who is silent for a while is named, once, and so is the end of the pause.
static void test_a_pause_is_told(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 3, 1, hub, 0);
    cluster_run_to(&c, 5);
    cluster_run_without(&c, 1, 0.4 * PATIENCE);
    assert_int_equal(c.pauses, 0);
    cluster_run_to(&c, 7);
    cluster_run_without(&c, 1, 0.7 * PATIENCE);
    assert_int_equal(c.pauses, 1);
    assert_string_equal(c.silent, "link2");
    cluster_run(&c);
    assert_all_ok(&c);
    assert_int_equal(c.pauses, 2);
    assert_string_equal(c.silent, "");
    cluster_end(&c);
}

// All processes are absent at once for longer than the patience, as in a frozen container, before
// the first step and in the middle of the run. Nobody counts that as the silence of others.
static void test_an_absence_of_all_is_no_silence(void **context) {
    (void)context;
    for (long step = 0; step < 10; step += 5) {
        pm_hub *hub = cluster_hub(NULL);
        cluster c;
        cluster_open_all(&c, 3, 1, hub, 0);
        cluster_turn(&c);
        c.now += 3 * PATIENCE;
        cluster_run_to(&c, step);
        for (int i = 1; i < 4; ++i) {
            c.now += 3 * PATIENCE;
            cluster_run_to(&c, step + i);
        }
        cluster_run(&c);
        assert_all_ok(&c);
        assert_int_equal(c.pauses, 0);
        cluster_end(&c);
    }
}

// Signs of life alone do not help: here everything that link2 sends but its requests is lost.
static void test_life_without_progress_ends(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    pm_transport *stranger;
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    cluster c;
    cluster_open_all(&c, 2, 1, hub, 77);
    cluster_run_to(&c, 5);
    pm_lockstep_node *node = c.node[1];
    c.node[1] = NULL;
    const double start = c.now;
    for (bool over = false; !over; over = cluster_is_over(&c)) {
        const portmet_request_t request = {
            .session = 77, .sender = "link2", .channel = "chain_TICK"};
        unsigned char data[256];
        const size_t size = pm_request_encode(&request, data, sizeof data);
        assert_int_equal(pm_transport_publish(stranger, "chain_REQUEST", data, size), PM_OK);
        cluster_turn(&c);
        c.now += TICK;
    }
    assert_in_range((int)((c.now - start) / PATIENCE), 3, 4);
    assert_error(pm_lockstep_coordinator_result(c.coordinator), PM_ETIMEOUT, "link2");
    pm_lockstep_node_close(node);
    pm_transport_close(stranger);
    cluster_end(&c);
}

static void test_other_digest_is_refused_by_name(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open(&c, 3, 1, hub, 0);
    fixture other = {0};
    fixture_open(&other, 3, 999);
    cluster_add(&c, 0, c.f.system, 0);
    cluster_add(&c, 1, other.system, 0);
    cluster_add(&c, 2, c.f.system, 0);
    cluster_run(&c);
    assert_all_failed(&c, PM_ENET, "link2");
    assert_int_equal(c.steps_seen, 0);
    cluster_close(&c);
    fixture_close(&other);
    pm_hub_close(hub);
}

// The step is the coordinator's to tell: a node that would step otherwise says so.
static void test_other_step_is_refused(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open(&c, 2, 1, hub, 0);
    fixture other = {0};
    fixture_open(&other, 2, 1234);
    other.scene->physics.dt *= 2;
    cluster_add(&c, 0, other.system, 0);
    cluster_add(&c, 1, c.f.system, 0);
    cluster_run(&c);
    assert_all_failed(&c, PM_ENET, "link1 failed: the coordinator's scene steps by 0.02");
    cluster_close(&c);
    fixture_close(&other);
    pm_hub_close(hub);
}

static void test_missing_node_is_named(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open(&c, 3, 1, hub, 0);
    cluster_add(&c, 0, c.f.system, 0);
    cluster_add(&c, 1, c.f.system, 0);
    const double took = cluster_run(&c);
    assert_true(took < 2 * PATIENCE);
    assert_all_failed(&c, PM_ETIMEOUT, "missing");
    assert_non_null(strstr((pm_lockstep_coordinator_result(c.coordinator), pm_error()), "link3"));
    assert_null(strstr(pm_error(), "link1"));
    cluster_end(&c);
}

static void test_node_without_coordinator_gives_up(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 2, 1, hub, 0);
    pm_lockstep_coordinator_close(c.coordinator);
    pm_transport_close(c.coordinator_transport);
    c.coordinator = NULL;
    c.coordinator_transport = NULL;
    cluster_run(&c);
    assert_error(pm_lockstep_node_result(c.node[1]), PM_ETIMEOUT, "no coordinator");
    cluster_end(&c);
}

// A node that stops in the middle of a run; the end of it names that node and no other.
static void test_dead_node_is_named(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 4, 2, hub, 0);
    cluster_run_to(&c, 5);
    pm_lockstep_node *dead = c.node[2];
    c.node[2] = NULL;
    const double took = cluster_run(&c);
    assert_true(took < 2 * PATIENCE);
    assert_error(pm_lockstep_coordinator_result(c.coordinator), PM_ETIMEOUT, "link3");
    for (int i = 0; i < c.count; ++i) {
        if (c.node[i] != NULL) {
            assert_int_equal(pm_lockstep_node_result(c.node[i]), PM_ETIMEOUT);
        }
    }
    pm_lockstep_node_close(dead);
    cluster_end(&c);
}

static void test_dead_coordinator_is_named(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 3, 1, hub, 0);
    cluster_run_to(&c, 5);
    pm_lockstep_coordinator *dead = c.coordinator;
    c.coordinator = NULL;
    const double took = cluster_run(&c);
    assert_true(took < 2 * PATIENCE);
    for (int i = 0; i < c.count; ++i) {
        assert_error(pm_lockstep_node_result(c.node[i]), PM_ETIMEOUT, "coordinator");
    }
    c.coordinator = dead;
    cluster_end(&c);
}

static void test_failure_of_a_node_ends_all(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 3, 1, hub, 0);
    cluster_run_to(&c, 3);
    pm_lockstep_node_fail(c.node[1], PM_ENUMERIC, "z[2] is nan");
    const double took = cluster_run(&c);
    assert_true(took < 1);
    assert_all_failed(&c, PM_ENUMERIC, "link2 failed: z[2] is nan");
    assert_error(pm_lockstep_node_result(c.node[0]), PM_ENUMERIC, "link2");
    cluster_end(&c);
}

static void test_divergence_ends_all(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open(&c, 2, 1, hub, 0);
    c.f.z[0] = c.f.z[2] = 1e200;
    cluster_add(&c, 0, c.f.system, 0);
    cluster_add(&c, 1, c.f.system, 0);
    cluster_run(&c);
    assert_all_failed(&c, PM_ENUMERIC, "link1");
    cluster_end(&c);
}

static void test_failure_of_the_observer_ends_all(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 2, 1, hub, 0);
    c.fail_at_step = 4;
    cluster_run(&c);
    assert_all_failed(&c, PM_EFILE, "the recording is full");
    assert_int_equal(c.steps_seen, 5);
    cluster_end(&c);
}

// The failing node may also be paused, longer than it would otherwise wait for an answer.
static void test_failure_arrives_under_faults(void **context) {
    (void)context;
    for (uint64_t seed = 1; seed <= 16; ++seed) {
        const pm_hub_faults faults = {
            .seed = seed, .drop = 0.3, .duplicate = 0.2, .delay = 0.3, .max_delay = 12};
        pm_hub *hub = cluster_hub(&faults);
        cluster c;
        cluster_open_all(&c, 3, 1, hub, 0);
        cluster_run_to(&c, 3);
        pm_lockstep_node_fail(c.node[2], PM_EINTERRUPTED, "interrupted");
        pm_lockstep_node_poll(c.node[2], c.now);
        c.now += seed % 2 == 0 ? 1 : 0;
        cluster_run(&c);
        assert_all_failed(&c, PM_EINTERRUPTED, "link3 failed: interrupted");
        cluster_end(&c);
    }
}

static void test_together_and_interrupted(void **context) {
    (void)context;
    volatile sig_atomic_t stop = 0;
    for (int interrupted = 0; interrupted < 2; ++interrupted) {
        pm_hub *hub = cluster_hub(NULL);
        cluster c;
        cluster_open_all(&c, 3, 1, hub, 0);
        stop = interrupted;
        const pm_status status = run_together(c.coordinator, c.count, c.node, &stop);
        if (interrupted) {
            assert_error(status, PM_EINTERRUPTED, "interrupted");
        } else {
            assert_int_equal(status, PM_OK);
            assert_int_equal(c.steps_seen, STEPS + 1);
        }
        cluster_end(&c);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_bits_as_plain_loop),
        cmocka_unit_test(test_same_bits_in_any_processes),
        cmocka_unit_test(test_same_bits_under_faults),
        cmocka_unit_test(test_no_requests_without_loss),
        cmocka_unit_test(test_requests_wake_few),
        cmocka_unit_test(test_steps_allocate_nothing),
        cmocka_unit_test(test_two_sessions_on_one_network),
        cmocka_unit_test(test_who_waits_is_alive),
        cmocka_unit_test(test_a_pause_is_told),
        cmocka_unit_test(test_an_absence_of_all_is_no_silence),
        cmocka_unit_test(test_life_without_progress_ends),
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
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
