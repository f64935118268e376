// A run that is held, over the memory transport, in virtual time: no process completes a step
// beyond the one at which it is held, a run can be held for any time, and the bits stay the same.
#include <stdio.h>
#include <string.h>

#include "tests/support/cluster_fixture.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

#define SESSION 77
#define LONG (5 * PATIENCE) // s, virtual: longer than any patience

typedef struct stage {
    scratch s;
    pm_hub *hub;
    cluster c;
} stage;

static void let_go(const stage *t, long step) {
    pm_lockstep_coordinator_hold(t->c.coordinator, step);
}

// The run is held at its start. With `quick`, fluxes show progress and reports hold several steps
// (lockstep/lookahead.h).
static void stage_open(stage *t, int count, int window, bool quick, const pm_hub_faults *faults) {
    scratch_open(&t->s);
    t->hub = cluster_hub(faults);
    if (quick) {
        cluster_open_quick(&t->c, count, window, t->hub, SESSION, t->s.folder);
    } else {
        cluster_open_keeping(&t->c, count, window, t->hub, SESSION, t->s.folder);
    }
    cluster_kill(&t->c, count);
    remove(t->c.path[count]);
    t->c.held = true;
    cluster_return(&t->c, count);
}

static void stage_close(stage *t) {
    cluster_close(&t->c);
    pm_hub_close(t->hub);
    scratch_close(&t->s);
}

static void turn_at_most(cluster *c, long step) {
    cluster_turn(c);
    assert_true(cluster_coordinator_step(c->coordinator) <= step);
    for (int i = 0; i < c->count; ++i) {
        assert_true(c->node[i] == NULL || cluster_node_step(c->node[i]) <= step);
    }
}

static void run_for(cluster *c, double seconds, long step) {
    for (const double end = c->now + seconds; c->now < end;) {
        turn_at_most(c, step);
    }
}

// Runs until the coordinator says that the run is held, and checks that it is held after `step`.
static void run_to_hold(cluster *c, long step) {
    for (const int holds = c->holds; c->holds == holds;) {
        turn_at_most(c, step);
    }
    assert_int_equal(c->held_at, step);
    for (int i = 0; i < c->count; ++i) {
        assert_int_equal(cluster_node_step(c->node[i]), step);
    }
}

// The run is held at every step in turn, for several windows, with and without lost messages.
static void test_nobody_passes(void **context) {
    (void)context;
    for (int i = 0; i < 24; ++i) {
        const double part = i < 12 ? 0 : 0.2;
        const pm_hub_faults faults = {
            .seed = (uint64_t)i, .drop = part, .duplicate = part, .delay = part, .max_delay = 12};
        stage t;
        stage_open(&t, 1 + i % 4, 1 + i % 3 * 3, i % 2 == 0, &faults);
        for (long step = 0; step < STEPS; step += 1 + i % 5) {
            let_go(&t, step);
            run_to_hold(&t.c, step);
            run_for(&t.c, 0.05, step);
            assert_int_equal(t.c.holds, 1 + step / (1 + i % 5));
        }
        let_go(&t, STEPS);
        cluster_run(&t.c);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

static void count_message(void *context, const char *channel, const void *data, size_t size) {
    (void)channel, (void)data, (void)size;
    *(int *)context += 1;
}

// A long hold ends no run, and few messages are sent meanwhile.
static void test_a_long_hold(void **context) {
    (void)context;
    static const char *const channels[] = {
        "chain_TICK",          "chain_REQUEST",     "chain_REQUEST_link1", "chain_REQUEST_link2",
        "chain_REQUEST_link3", "chain_FLUX_link1",  "chain_FLUX_link2",    "chain_FLUX_link3",
        "chain_REPORT_link1",  "chain_REPORT_link2"};
    for (int quick = 0; quick < 2; ++quick) {
        stage t;
        pm_transport *listener;
        int messages = 0, handled;
        stage_open(&t, 3, 2, quick == 1, NULL);
        assert_int_equal(pm_hub_connect(t.hub, &listener), PM_OK);
        for (size_t i = 0; i < sizeof channels / sizeof channels[0]; ++i) {
            assert_int_equal(
                pm_transport_subscribe(listener, channels[i], count_message, &messages), PM_OK);
        }
        for (long step = 0; step < STEPS; step += 6) {
            let_go(&t, step);
            run_to_hold(&t.c, step);
            run_for(&t.c, 1, step); // until requests come at the longest interval
            assert_int_equal(pm_transport_wait(listener, 0, &handled), PM_OK);
            messages = 0;
            run_for(&t.c, LONG, step);
            assert_int_equal(pm_transport_wait(listener, 0, &handled), PM_OK);
            // The processes rest: a tick every second.
            assert_in_range(messages, LONG - 1, LONG + 2);
        }
        assert_int_equal(t.c.pauses, 0);
        let_go(&t, STEPS);
        cluster_run(&t.c);
        assert_all_ok(&t.c);
        pm_transport_close(listener);
        stage_close(&t);
    }
}

// While the run is held, a silent node is named; it is given up after the usual patience when the
// run goes on.
static void test_a_silent_node_is_named(void **context) {
    (void)context;
    stage t;
    stage_open(&t, 3, 1, false, NULL);
    let_go(&t, 5);
    run_to_hold(&t.c, 5);
    run_for(&t.c, LONG, 5);
    cluster_run_without(&t.c, 1, 1.5 * pm_health_silence(t.c.count, true));
    assert_string_equal(t.c.silent, "link2");
    assert_int_equal(t.c.pauses, 1);
    let_go(&t, 9);
    run_to_hold(&t.c, 9);
    assert_string_equal(t.c.silent, "");
    pm_lockstep_node *node = t.c.node[1];
    t.c.node[1] = NULL;
    cluster_run(&t.c);
    assert_all_failed(&t.c, PM_ETIMEOUT, "link2");
    t.c.node[1] = node;
    stage_close(&t);
}

// Each process in turn dies and returns while the run is held; a coordinator that returns knows
// where it is held, though no step has been made since.
static void test_a_death_while_held(void **context) {
    (void)context;
    for (int i = 0; i < 16; ++i) {
        stage t;
        stage_open(&t, 3, 1 + i / 8, i % 2 == 0, NULL);
        const int victim = i / 2 % 4;
        for (long step = 2; step < STEPS - QUICK_CHECKPOINT / 2; step += 3) {
            let_go(&t, step);
            run_to_hold(&t.c, step);
            const int holds = t.c.holds;
            cluster_kill(&t.c, victim);
            cluster_return(&t.c, victim);
            for (const double end = t.c.now + LONG; t.c.now < end;) {
                turn_at_most(&t.c, step);
            }
            assert_int_equal(t.c.holds, holds + (victim == t.c.count));
            assert_int_equal(t.c.held_at, step);
            assert_int_equal(cluster_coordinator_step(t.c.coordinator), step);
        }
        let_go(&t, STEPS);
        cluster_run(&t.c);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nobody_passes),
        cmocka_unit_test(test_a_long_hold),
        cmocka_unit_test(test_a_silent_node_is_named),
        cmocka_unit_test(test_a_death_while_held),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
