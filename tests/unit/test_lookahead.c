// Grants ahead of reports: no process gets further ahead of another, the bits are the same, and
// every step that was computed is reported when a run fails.
#include <string.h>

#include "base/rng.h"
#include "lockstep/codec.h"
#include "lockstep/lookahead.h"
#include "tests/support/cluster_fixture.h"
#include "tests/support/unit.h"

#define LEAD (QUICK_CHECKPOINT / 2)
#define LONG_LEAD 16 // with checkpoints that are far apart

static void test_which_scenes_may(void **context) {
    (void)context;
    static const struct {
        int count, window, checkpoint, substeps;
        double tolerance;
        int lookahead;
        bool heard;
    } cases[] = {
        {4, 1, 100, 1, 0, LONG_LEAD, true}, {4, 7, 100, 1, 0, LONG_LEAD, true},
        {4, 8, 100, 1, 0, 8, false},        {4, 1, 100, 2, 0, 1, false},
        {4, 1, 100, 1, 1e-3, 1, false},     {4, 1, 12, 1, 0, 6, true},
        {4, 1, 11, 1, 0, 1, false},         {4, 1, 1, 1, 0, 1, false},
        {4, 50, 100, 1, 0, 50, false},      {2, 1, 100, 1, 0, LONG_LEAD, true},
        {2, 1, 100, 2, 0, 1, false},        {1, 1, 100, 1, 0, 1, false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        fixture f = {0};
        fixture_open(&f, cases[i].count, 1);
        f.scene->network.window = cases[i].window;
        f.scene->network.checkpoint = cases[i].checkpoint;
        f.scene->physics.integrator = pm_integrator_find("euler");
        f.scene->physics.substeps = cases[i].substeps;
        f.scene->physics.tolerance = cases[i].tolerance;
        if (pm_lookahead(f.scene) != cases[i].lookahead ||
            pm_lookahead_uses_fluxes(f.scene) != cases[i].heard) {
            fail_msg("case %d: lookahead %d, heard %d", (int)i, pm_lookahead(f.scene),
                     pm_lookahead_uses_fluxes(f.scene));
        }
        fixture_close(&f);
    }
}

static void test_same_bits(void **context) {
    (void)context;
    for (int count = 1; count <= MAX_NODES; ++count) {
        for (uint64_t seed = 0; seed < 12; ++seed) {
            const double part = seed < 3 ? 0 : 0.2;
            const pm_hub_faults faults = {
                .seed = seed, .drop = part, .duplicate = part, .delay = part, .max_delay = 12};
            pm_hub *hub = cluster_hub(&faults);
            cluster c;
            cluster_open_quick(&c, count, 1 + (int)(seed % 3), hub, 0, NULL);
            const double took = cluster_run(&c);
            assert_true(seed >= 3 || took < 0.19); // the nodes' lingering at the end
            assert_all_ok(&c);
            cluster_end(&c);
        }
    }
}

// Each process in turn is slow, with several windows.
static void test_nobody_is_ahead_by_more_than_the_window(void **context) {
    (void)context;
    pm_rng rng;
    pm_rng_init(&rng, 3, 0);
    for (int count = 2; count <= MAX_NODES; ++count) {
        for (int window = 1; window <= 2; ++window) {
            pm_hub *hub = cluster_hub(NULL);
            cluster c;
            long most = 0;
            cluster_open_quick(&c, count, window, hub, 0, NULL);
            while (!cluster_is_over(&c)) {
                const int slow = (int)pm_rng_below(&rng, (uint64_t)count);
                cluster_run_without(&c, slow, 10 * TICK);
                cluster_turn(&c);
                long first = STEPS, last = 0;
                for (int i = 0; i < count; ++i) {
                    const long step = cluster_node_step(c.node[i]);
                    first = step < first ? step : first;
                    last = step > last ? step : last;
                }
                most = last - first > most ? last - first : most;
            }
            assert_all_ok(&c);
            assert_in_range(most, count > 2 || window > 1, window);
            cluster_end(&c);
        }
    }
}

static void count_message(void *context, const char *channel, const void *data, size_t size) {
    (void)channel, (void)data, (void)size;
    *(int *)context += 1;
}

// Reports hold several steps each, and none is late by more than the lookahead.
static void test_reports_wait(void **context) {
    (void)context;
    for (int count = 2; count <= MAX_NODES; ++count) {
        pm_hub *hub = cluster_hub(NULL);
        pm_transport *stranger;
        cluster c;
        int reports = 0;
        assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
        assert_int_equal(
            pm_transport_subscribe(stranger, "chain_REPORT_link2", count_message, &reports), PM_OK);
        cluster_open_quick(&c, count, 1, hub, 0, NULL);
        while (cluster_coordinator_step(c.coordinator) < STEPS) {
            cluster_turn(&c);
            assert_true(cluster_node_step(c.node[1]) <=
                        cluster_coordinator_step(c.coordinator) + LEAD);
        }
        assert_int_equal(pm_transport_wait(stranger, 0, NULL), PM_OK);
        // The initial state, one soon after it, as no time passes here, and the last.
        assert_in_range(reports, STEPS / LEAD, 3 + STEPS / (LEAD / 2));
        cluster_run(&c);
        assert_all_ok(&c);
        pm_transport_close(stranger);
        cluster_end(&c);
    }
}

// Long steps are reported one by one.
static void test_slow_steps_are_reported(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    cluster c;
    cluster_open_quick(&c, 3, 1, hub, 0, NULL);
    cluster_run_to(&c, 5);
    for (long step = 6; step < STEPS; ++step) {
        c.now += 0.05;
        while (cluster_node_step(c.node[0]) <= step) {
            cluster_turn(&c);
        }
        assert_true(cluster_coordinator_step(c.coordinator) >= step - 1);
    }
    cluster_run(&c);
    assert_all_ok(&c);
    cluster_end(&c);
}

// Counts who requests the missing flux of link2.
static void note_asker(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    char *askers = context;
    portmet_request_t request;
    assert_int_equal(pm_request_decode(&request, data, size), PM_KEEP);
    if (strcmp(request.channel, "chain_FLUX_link2") == 0) {
        askers[request.sender[0] == 0 ? 0 : request.sender[4] - '0'] = 'x';
    }
}

// Every process that misses a flux requests it, with or without a grant. One answer serves all, and
// leads to the next grant.
static void test_the_flux_is_asked_for(void **context) {
    (void)context;
    char askers[] = "-----"; // the coordinator, link1 to link4
    pm_hub *hub = cluster_hub(NULL);
    pm_transport *stranger;
    cluster c;
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    assert_int_equal(pm_transport_subscribe(stranger, "chain_REQUEST_link2", note_asker, askers),
                     PM_OK);
    cluster_open_quick(&c, 4, 1, hub, 0, NULL);
    cluster_run_to(&c, 5);
    cluster_run_without(&c, 1, 0.01);
    assert_int_equal(pm_transport_wait(stranger, 0, NULL), PM_OK);
    assert_string_equal(askers, "xx-x-");
    cluster_run(&c);
    assert_all_ok(&c);
    pm_transport_close(stranger);
    cluster_end(&c);
}

// A flux shows progress only if its step is granted and its session is that of the run.
static void test_forged_fluxes_grant_nothing(void **context) {
    (void)context;
    static const struct {
        int64_t session, step;
        int32_t round;
        pm_drop drop;
    } cases[] = {
        {78, 6, 0, PM_DROP_SESSION},     {77, -1, 0, PM_DROP_IMPLAUSIBLE},
        {77, 9, 0, PM_DROP_RANGE},       {77, INT64_MAX, 0, PM_DROP_RANGE},
        {77, 1, 1, PM_DROP_IMPLAUSIBLE}, {77, 1, 0, PM_KEEP}, // late
    };
    pm_hub *hub = cluster_hub(NULL);
    pm_transport *stranger;
    cluster c;
    double y[3] = {1, 2, 3};
    unsigned char data[512];
    assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
    cluster_open_quick(&c, 3, 1, hub, 77, NULL);
    cluster_run_to(&c, 3);
    const pm_drops *drops = pm_lockstep_coordinator_drops(c.coordinator);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        assert_int_equal(pm_transport_wait(c.coordinator_transport, 0, NULL), PM_OK);
        const long before = drops->count[cases[i].drop];
        const portmet_flux_t flux = {.session = cases[i].session,
                                     .step = cases[i].step,
                                     .round = cases[i].round,
                                     .time = pm_scene_time(c.f.scene, (long)cases[i].step),
                                     .nend = 1,
                                     .energy_flux = y,
                                     .entropy_flux = y,
                                     .ny = 3,
                                     .y = y,
                                     .e = y,
                                     .eta = y};
        const size_t size = pm_flux_encode(&flux, data, sizeof data);
        assert_int_equal(pm_transport_publish(stranger, "chain_FLUX_link1", data, size), PM_OK);
        assert_int_equal(pm_transport_wait(c.coordinator_transport, 0, NULL), PM_OK);
        assert_int_equal(drops->count[cases[i].drop], before + 1);
    }
    cluster_run(&c);
    assert_all_ok(&c);
    pm_transport_close(stranger);
    cluster_end(&c);
}

// --- the end of runs that fail ---

// Runs until a node has computed `step` steps. Returns how many all nodes have computed.
static long run_nodes_to(cluster *c, long step) {
    long all = 0;
    for (bool done = false; !done;) {
        cluster_turn(c);
        all = STEPS;
        for (int i = 0; i < c->count; ++i) {
            const long own = cluster_node_step(c->node[i]);
            all = own < all ? own : all;
            done = done || own >= step;
        }
    }
    return all;
}

// Before the end, the failing node and the others report every step that they computed.
static void test_failure_leaves_nothing_untold(void **context) {
    (void)context;
    for (int count = 2; count <= MAX_NODES; ++count) {
        for (long step = 3; step < 3 + LEAD; ++step) {
            pm_hub *hub = cluster_hub(NULL);
            cluster c;
            cluster_open_quick(&c, count, 1, hub, 0, NULL);
            const long all = run_nodes_to(&c, step);
            pm_lockstep_node_fail(c.node[1], PM_ENUMERIC, "z[2] is nan");
            cluster_run(&c);
            assert_all_failed(&c, PM_ENUMERIC, "link2 failed: z[2] is nan");
            assert_true(c.steps_seen > all);
            cluster_end(&c);
        }
    }
}

// The earliest failure is the reason for the end of the run, even if it is found later.
static void test_earliest_failure_counts(void **context) {
    (void)context;
    for (long step = 3; step < 3 + LEAD; ++step) {
        pm_hub *hub = cluster_hub(NULL);
        cluster c;
        cluster_open_quick(&c, 4, 1, hub, 0, NULL);
        const long all = run_nodes_to(&c, step);
        c.fail_at_step = all;
        pm_lockstep_node_fail(c.node[1], PM_ENUMERIC, "z[2] is nan");
        if (cluster_coordinator_step(c.coordinator) < all) {
            cluster_run(&c);
            assert_error(pm_lockstep_coordinator_result(c.coordinator), PM_EFILE,
                         "the recording is full");
            assert_int_equal(c.steps_seen, all + 1);
        }
        cluster_end(&c);
    }
}

// The same, where reports of later steps are there already.
static void test_nothing_is_booked_after_a_failure(void **context) {
    (void)context;
    for (long step = 3; step < 14; ++step) {
        pm_hub *hub = cluster_hub(NULL);
        cluster c;
        cluster_open_quick(&c, 3, 1, hub, 0, NULL);
        c.fail_at_step = step;
        cluster_run(&c);
        assert_int_equal(c.steps_seen, step + 1);
        cluster_end(&c);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_which_scenes_may),
        cmocka_unit_test(test_same_bits),
        cmocka_unit_test(test_nobody_is_ahead_by_more_than_the_window),
        cmocka_unit_test(test_reports_wait),
        cmocka_unit_test(test_slow_steps_are_reported),
        cmocka_unit_test(test_the_flux_is_asked_for),
        cmocka_unit_test(test_forged_fluxes_grant_nothing),
        cmocka_unit_test(test_failure_leaves_nothing_untold),
        cmocka_unit_test(test_earliest_failure_counts),
        cmocka_unit_test(test_nothing_is_booked_after_a_failure),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
