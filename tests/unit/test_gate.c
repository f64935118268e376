// The gate over the memory transport, in virtual time: no process completes a step beyond it, a run
// can be held for any time, and the bits stay the same.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
// cmocka needs the above.
#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "lockstep/gate.h"
#include "tests/support/cluster_fixture.h"
#include "tests/support/scratch.h"

#define SESSION 77
#define LONG (5 * PATIENCE) // s, virtual: longer than any patience

typedef struct stage {
    scratch s;
    char gate[128];
    pm_hub *hub;
    cluster c;
} stage;

static void write_gate(const stage *t, const char *text) {
    FILE *file = fopen(t->gate, "w");
    assert_non_null(file);
    assert_true(fputs(text, file) >= 0);
    assert_int_equal(fclose(file), 0);
}

static void open_gate(const stage *t, long step) {
    char text[32];
    snprintf(text, sizeof text, "%ld\n", step);
    write_gate(t, text);
}

// The file is absent at first. With `quick`, fluxes show progress and reports hold several steps
// (lockstep/lookahead.h).
static void stage_open(stage *t, int count, int window, bool quick, const pm_hub_faults *faults) {
    scratch_open(&t->s);
    snprintf(t->gate, sizeof t->gate, "%s/gate", t->s.folder);
    t->hub = cluster_hub(faults);
    if (quick) {
        cluster_open_quick(&t->c, count, window, t->hub, SESSION, t->s.folder);
    } else {
        cluster_open_keeping(&t->c, count, window, t->hub, SESSION, t->s.folder);
    }
    cluster_kill(&t->c, count);
    remove(t->c.path[count]);
    t->c.gate = t->gate;
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

// The gate stands at every step in turn, for several windows, with and without lost messages.
static void test_nobody_passes(void **context) {
    (void)context;
    for (int i = 0; i < 24; ++i) {
        const double part = i < 12 ? 0 : 0.2;
        const pm_hub_faults faults = {
            .seed = (uint64_t)i, .drop = part, .duplicate = part, .delay = part, .max_delay = 12};
        stage t;
        stage_open(&t, 1 + i % 4, 1 + i % 3 * 3, i % 2 == 0, &faults);
        for (long step = 0; step < STEPS; step += 1 + i % 5) {
            open_gate(&t, step);
            run_to_hold(&t.c, step);
            run_for(&t.c, 0.05, step);
            assert_int_equal(t.c.holds, 1 + step / (1 + i % 5));
        }
        open_gate(&t, STEPS);
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
            open_gate(&t, step);
            run_to_hold(&t.c, step);
            run_for(&t.c, 1, step); // until requests come at the longest interval
            assert_int_equal(pm_transport_wait(listener, 0, &handled), PM_OK);
            messages = 0;
            run_for(&t.c, LONG, step);
            assert_int_equal(pm_transport_wait(listener, 0, &handled), PM_OK);
            // A tick and a request from everybody, each every 0.1 s.
            assert_in_range(messages, LONG / 0.1, 1.1 * LONG / 0.1 * (1 + t.c.count));
        }
        assert_int_equal(t.c.pauses, 0);
        open_gate(&t, STEPS);
        cluster_run(&t.c);
        assert_all_ok(&t.c);
        pm_transport_close(listener);
        stage_close(&t);
    }
}

// While the run is held, a silent node is named, and given up after the usual patience.
static void test_a_silent_node_is_named(void **context) {
    (void)context;
    stage t;
    stage_open(&t, 3, 1, false, NULL);
    open_gate(&t, 5);
    run_to_hold(&t.c, 5);
    run_for(&t.c, LONG, 5);
    cluster_run_without(&t.c, 1, 0.75 * PATIENCE);
    assert_string_equal(t.c.silent, "link2");
    assert_int_equal(t.c.pauses, 1);
    open_gate(&t, 9);
    run_to_hold(&t.c, 9);
    assert_string_equal(t.c.silent, "");
    pm_lockstep_node *node = t.c.node[1];
    t.c.node[1] = NULL;
    cluster_run(&t.c);
    assert_all_failed(&t.c, PM_ETIMEOUT, "link2");
    t.c.node[1] = node;
    stage_close(&t);
}

// Each process in turn dies and returns at the gate; a coordinator that returns reads the file
// again.
static void test_death_at_the_gate(void **context) {
    (void)context;
    for (int i = 0; i < 16; ++i) {
        stage t;
        stage_open(&t, 3, 1 + i / 8, i % 2 == 0, NULL);
        const int victim = i / 2 % 4;
        for (long step = 2; step < STEPS - QUICK_CHECKPOINT / 2; step += 3) {
            open_gate(&t, step);
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
        open_gate(&t, STEPS);
        cluster_run(&t.c);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

// A number smaller than the steps done, or a removed file, holds the run where it is.
static void check_closing(bool gone) {
    stage t;
    stage_open(&t, 2, 1, false, NULL);
    open_gate(&t, 10);
    run_to_hold(&t.c, 10);
    if (gone) {
        remove(t.gate);
    } else {
        open_gate(&t, 3);
    }
    cluster_kill(&t.c, t.c.count);
    cluster_return(&t.c, t.c.count);
    run_for(&t.c, 1, 10);
    const long step = cluster_coordinator_step(t.c.coordinator);
    assert_int_equal(step, CHECKPOINT); // as the coordinator's checkpoint has it
    assert_int_equal(t.c.holds, 2);
    assert_int_equal(t.c.held_at, step);
    open_gate(&t, STEPS);
    cluster_run(&t.c);
    assert_all_ok(&t.c);
    stage_close(&t);
}

static void test_a_gate_that_closes(void **context) {
    (void)context;
    check_closing(false);
    check_closing(true);
}

static void test_what_a_file_says(void **context) {
    (void)context;
    static const struct {
        const char *text;
        int64_t steps; // -1: an error
    } cases[] = {{"", 0},
                 {"\n", 0},
                 {"0", 0},
                 {"12", 12},
                 {" 12 \n", 12},
                 {"twelve", -1},
                 {"12 13\n", -1},
                 {"-1", -1},
                 {"1.5\n", -1},
                 {"99999999999999999999\n", -1},
                 {"123456789012345678901234567890123456", -1}};
    stage t;
    scratch_open(&t.s);
    snprintf(t.gate, sizeof t.gate, "%s/gate", t.s.folder);
    pm_gate gate;
    assert_int_equal(pm_gate_init(&gate, NULL), PM_OK);
    assert_true(gate.steps == INT64_MAX);
    assert_int_equal(pm_gate_init(&gate, t.gate), PM_OK); // absent
    assert_int_equal(gate.steps, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        write_gate(&t, cases[i].text);
        const pm_status status = pm_gate_refresh(&gate, (double)i);
        if (cases[i].steps < 0) {
            assert_error(status, PM_EFILE, "gate: expected a number of steps, found \"");
        } else {
            assert_int_equal(status, PM_OK);
            assert_int_equal(gate.steps, cases[i].steps);
        }
    }
    assert_error(pm_gate_init(&gate, t.s.folder), PM_EFILE, "cannot be read");
    scratch_close(&t.s);
}

// A file that holds no number ends the run.
static void test_a_bad_file_ends_the_run(void **context) {
    (void)context;
    stage t;
    stage_open(&t, 2, 1, false, NULL);
    open_gate(&t, 4);
    run_to_hold(&t.c, 4);
    write_gate(&t, "four\n");
    cluster_run(&t.c);
    assert_all_failed(&t.c, PM_EFILE, "expected a number of steps, found \"four\"");
    stage_close(&t);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_nobody_passes),           cmocka_unit_test(test_a_long_hold),
        cmocka_unit_test(test_a_silent_node_is_named),  cmocka_unit_test(test_death_at_the_gate),
        cmocka_unit_test(test_a_gate_that_closes),      cmocka_unit_test(test_what_a_file_says),
        cmocka_unit_test(test_a_bad_file_ends_the_run),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
