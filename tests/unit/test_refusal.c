// A second coordinator, a second node of the same name, and nodes that differ are refused by name,
// and the run that is under way continues undisturbed.
#include <string.h>

#include "lockstep/codec.h"
#include "tests/support/cluster_fixture.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

// Drives a cluster and one more node until that node has ended.
static pm_status run_stranger(cluster *c, pm_lockstep_node *node, pm_transport *transport) {
    while (!pm_lockstep_node_finished(node)) {
        assert_int_equal(pm_transport_wait(transport, 0, NULL), PM_OK);
        pm_lockstep_node_poll(node, c->now);
        cluster_turn(c);
        c->now += TICK; // which cluster_turn() does only in silence
    }
    const pm_status status = pm_lockstep_node_result(node);
    pm_lockstep_node_close(node);
    pm_transport_close(transport);
    return status;
}

static pm_status join(cluster *c, const pm_system *system, int i, int64_t session,
                      const char *checkpoint) {
    pm_transport *transport;
    pm_lockstep_node *node;
    const pm_lockstep_node_options options = {
        .z = c->f.z, .session = session, .checkpoint = checkpoint};
    assert_int_equal(pm_hub_connect(c->hub, &transport), PM_OK);
    assert_int_equal(pm_lockstep_node_open(&node, system, i, transport, &options), PM_OK);
    return run_stranger(c, node, transport);
}

static void finish(cluster *c) {
    cluster_run(c);
    assert_all_ok(c);
    cluster_close(c);
}

// A second node comes while the first waits, or during its run; with and without checkpoints.
static void test_second_node(void **context) {
    (void)context;
    for (int at = 0; at < 4; ++at) {
        scratch s;
        scratch_open(&s);
        pm_hub *hub = cluster_hub(NULL);
        cluster c;
        if (at < 2) {
            cluster_open(&c, 2, 1, hub, 0);
            cluster_add(&c, 0, c.f.system, 0);
        } else {
            cluster_open_keeping(&c, 2, 1, hub, 0, s.folder);
        }
        cluster_turn(&c);
        if (at % 2 == 1) {
            if (at == 1) {
                cluster_add(&c, 1, c.f.system, 0);
            }
            cluster_run_to(&c, 5);
        }
        const char *checkpoint = at < 2 ? NULL : scratch_path(&s, "second");
        assert_error(join(&c, c.f.system, 0, 0, checkpoint), PM_ENET, "link1");
        if (at == 0) {
            cluster_add(&c, 1, c.f.system, 0);
        }
        finish(&c);
        pm_hub_close(hub);
        scratch_close(&s);
    }
}

// The same, but its hello is lost, and it receives ticks first. It joins only when one of them
// answers its hello, whatever checkpoint it has.
static pm_status join_unheard(cluster *c, int i, const char *checkpoint) {
    pm_transport *transport;
    pm_lockstep_node *node;
    const pm_lockstep_node_options options = {.z = c->f.z, .session = 77, .checkpoint = checkpoint};
    assert_int_equal(pm_hub_connect(c->hub, &transport), PM_OK);
    assert_int_equal(pm_lockstep_node_open(&node, c->f.system, i, transport, &options), PM_OK);
    for (int turn = 0; turn < 12; ++turn) {
        cluster_turn(c);
    }
    assert_int_equal(pm_transport_wait(transport, 0, NULL), PM_OK);
    assert_int_equal(pm_lockstep_node_drops(node)->count[PM_KEEP], 0);
    assert_true(pm_lockstep_node_drops(node)->count[PM_DROP_SESSION] > 0);
    return run_stranger(c, node, transport);
}

static void test_second_node_that_is_not_heard(void **context) {
    (void)context;
    for (int at = 0; at < 3; ++at) {
        scratch s;
        scratch_open(&s);
        pm_hub *hub = cluster_hub(NULL);
        cluster c;
        if (at == 0) {
            cluster_open_all(&c, 2, 1, hub, 77);
        } else {
            cluster_open_keeping(&c, 2, 1, hub, 77, s.folder);
        }
        cluster_run_to(&c, 8);
        // A folder of its own, or the first one's.
        const char *checkpoint = at == 0 ? NULL : at == 1 ? scratch_path(&s, "second") : c.path[0];
        assert_error(join_unheard(&c, 0, checkpoint), PM_ENET, "link1");
        finish(&c);
        pm_hub_close(hub);
        scratch_close(&s);
    }
}

// A node with other weights or other checkpoints is refused by a run that has begun.
static void test_nodes_that_differ(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_all(&c, 2, 1, hub, 77);
    cluster_run_to(&c, 5);
    fixture other = {0};
    fixture_open(&other, 2, 999);
    assert_error(join(&c, other.system, 1, 77, NULL), PM_ENET, "link2");
    fixture_close(&other);
    finish(&c);
    pm_hub_close(hub);
}

static void test_checkpoints_that_differ(void **context) {
    (void)context;
    scratch s;
    scratch_open(&s);
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open(&c, 2, 1, hub, 0);
    cluster_add(&c, 0, c.f.system, 0);
    assert_error(join(&c, c.f.system, 1, 0, scratch_path(&s, "x")), PM_ENET,
                 "node link2 keeps a checkpoint every 7 steps, the run every 0");
    cluster_run(&c);
    assert_all_failed(&c, PM_ENET, "link2 keeps a checkpoint");
    cluster_end(&c);
    scratch_close(&s);
}

static void test_other_version(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    pm_transport *stranger;
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    cluster c;
    cluster_open(&c, 2, 1, hub, 0);
    cluster_add(&c, 0, c.f.system, 0);
    const portmet_hello_t hello = {.protocol = c.coordinator->endpoint.identity.hello.protocol + 1,
                                   .instance = 5,
                                   .coordinator = cluster_instance(&c),
                                   .digest = (int64_t)c.f.system->digest,
                                   .sender = "link2"};
    unsigned char data[256];
    const size_t size = pm_hello_encode(&hello, data, sizeof data);
    assert_int_equal(pm_transport_publish(stranger, "chain_HELLO_link2", data, size), PM_OK);
    cluster_run(&c);
    assert_all_failed(&c, PM_ENET, "link2 speaks another version of the protocol");
    pm_transport_close(stranger);
    cluster_end(&c);
}

// A second coordinator comes while the first waits for nodes or runs; other sessions do not matter.
static void test_second_coordinator(void **context) {
    (void)context;
    for (int at = 0; at < 3; ++at) {
        pm_hub *hub = cluster_hub(NULL);
        cluster first, second;
        cluster_open_all(&first, 2, 1, hub, at == 2 ? 77 : 0);
        if (at > 0) {
            cluster_run_to(&first, 5);
        } else {
            cluster_turn(&first);
        }
        cluster_open(&second, 2, 1, hub, at == 2 ? 77 : 0);
        while (!cluster_is_over(&second)) {
            cluster_turn(&first);
            cluster_turn(&second);
        }
        assert_error(pm_lockstep_coordinator_result(second.coordinator), PM_ENET,
                     "there is a coordinator of scene chain already");
        finish(&first);
        cluster_end(&second);
    }
}

// A run for its own session is closed to nodes that ask for none.
static void test_closed_runs(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster a, b;
    cluster_open_all(&a, 2, 1, hub, 77);
    cluster_open_all(&b, 2, 1, hub, 0);
    while (!cluster_is_over(&a) || !cluster_is_over(&b)) {
        cluster_turn(&a);
        cluster_turn(&b);
    }
    assert_all_ok(&a);
    assert_all_ok(&b);
    cluster_close(&a);
    cluster_end(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_second_node),
        cmocka_unit_test(test_second_node_that_is_not_heard),
        cmocka_unit_test(test_nodes_that_differ),
        cmocka_unit_test(test_checkpoints_that_differ),
        cmocka_unit_test(test_other_version),
        cmocka_unit_test(test_second_coordinator),
        cmocka_unit_test(test_closed_runs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
