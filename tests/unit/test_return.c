// Death and return over the memory transport, in virtual time: processes are killed at any step,
// once or often, and restarted from their checkpoints, and the run ends with the same bits.
#include <string.h>

#include "base/rng.h"
#include "lockstep/codec.h"
#include "tests/support/cluster_fixture.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

#define SESSION 77

typedef struct stage {
    scratch s;
    pm_hub *hub;
    cluster c;
} stage;

static void stage_open(stage *t, int count, int window, const pm_hub_faults *faults) {
    scratch_open(&t->s);
    t->hub = cluster_hub(faults);
    cluster_open_keeping(&t->c, count, window, t->hub, SESSION, t->s.folder);
}

// A chain with steps of one round, whose reports hold several steps.
static void stage_open_quick(stage *t, int count, int window, const pm_hub_faults *faults) {
    scratch_open(&t->s);
    t->hub = cluster_hub(faults);
    cluster_open_quick(&t->c, count, window, t->hub, SESSION, t->s.folder);
}

static void stage_close(stage *t) {
    cluster_close(&t->c);
    pm_hub_close(t->hub);
    scratch_close(&t->s);
}

// A run without deaths. The checkpoint files stay for a process that dies at the end.
static void test_undisturbed(void **context) {
    (void)context;
    stage t;
    stage_open(&t, 3, 1, NULL);
    assert_true(cluster_run(&t.c) < 0.19);
    assert_all_ok(&t.c);
    assert_int_equal(scratch_files(&t.s, 0), 4);
    stage_close(&t);
}

// A process that dies late may find at its return that the run is complete.
static long last_death(bool quick) {
    return quick ? STEPS - QUICK_CHECKPOINT / 2 : STEPS;
}

// Each process in turn is absent for a while after every step.
static void test_each_at_every_step(void **context) {
    (void)context;
    for (int k = 0; k < 8; ++k) {
        const int who = k / 2;
        stage t;
        const bool quick = k % 2 != 0;
        (quick ? stage_open_quick : stage_open)(&t, 3, 1 + who % 2, NULL);
        for (long step = 0; step < last_death(quick); ++step) {
            cluster_run_to(&t.c, step);
            cluster_kill(&t.c, who);
            for (const double end = t.c.now + 0.05; t.c.now < end;) {
                cluster_turn(&t.c);
            }
            cluster_return(&t.c, who);
        }
        cluster_run(&t.c);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

// All processes die at once, and continue from the files.
static void test_all_at_once(void **context) {
    (void)context;
    for (int k = 0; k < 2; ++k) {
        const bool quick = k == 1;
        stage t;
        (quick ? stage_open_quick : stage_open)(&t, 4, 2, NULL);
        for (long step = 3; step < last_death(quick); step += 4) {
            cluster_run_to(&t.c, step);
            for (int i = 0; i <= t.c.count; ++i) {
                cluster_kill(&t.c, i);
            }
            for (int i = 0; i <= t.c.count; ++i) {
                cluster_return(&t.c, i);
            }
        }
        cluster_run(&t.c);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

// Random kills, several at a time, on a network that loses, repeats and reorders messages.
static void play(uint64_t seed, const pm_hub_faults *faults) {
    enum { KILLS = 25 };
    pm_rng rng;
    pm_rng_init(&rng, seed, 1);
    stage t;
    (seed % 8 < 4 ? stage_open : stage_open_quick)(&t, 2 + (int)(seed % 4), 1 + (int)(seed % 3),
                                                   faults);
    for (int kills = 0; kills < KILLS && !cluster_is_over(&t.c);) {
        cluster_turn(&t.c);
        const int who = (int)pm_rng_below(&rng, (uint64_t)t.c.count + 1);
        const uint64_t dice = pm_rng_below(&rng, 100);
        if (cluster_has(&t.c, who) && dice < 2) {
            cluster_kill(&t.c, who);
            ++kills;
        } else if (!cluster_has(&t.c, who) && dice < 20) {
            cluster_return(&t.c, who);
        }
    }
    for (int i = 0; i <= t.c.count; ++i) {
        if (!cluster_has(&t.c, i)) {
            cluster_return(&t.c, i);
        }
    }
    cluster_run(&t.c);
    assert_int_equal(pm_lockstep_coordinator_result(t.c.coordinator), PM_OK);
    assert_int_equal(t.c.steps_seen, STEPS + 1);
    stage_close(&t);
}

static void test_at_random(void **context) {
    (void)context;
    for (uint64_t seed = 1; seed <= 40; ++seed) {
        const pm_hub_faults faults = {
            .seed = seed, .drop = 0.1, .duplicate = 0.1, .delay = 0.2, .max_delay = 12};
        print_message("seed %d\n", (int)seed);
        play(seed, seed % 2 == 0 ? &faults : NULL);
    }
}

// The coordinator dies when all steps are done, and ends the run once more.
static void test_coordinator_at_the_end(void **context) {
    (void)context;
    for (int turns = 0; turns < 4; ++turns) {
        stage t;
        stage_open(&t, 3, 2, NULL);
        cluster_run_to(&t.c, STEPS);
        for (int i = 0; i < turns; ++i) {
            cluster_turn(&t.c);
        }
        cluster_kill(&t.c, 3);
        cluster_return(&t.c, 3);
        assert_true(cluster_run(&t.c) < 1);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

// A coordinator that dies between two checkpoints receives reports of steps that it has not
// granted.
static void test_coordinator_and_long_reports(void **context) {
    (void)context;
    for (int count = 2; count <= MAX_NODES; ++count) {
        stage t;
        stage_open_quick(&t, count, 1, NULL);
        cluster_run_to(&t.c, QUICK_CHECKPOINT / 2);
        cluster_kill(&t.c, count);
        cluster_return(&t.c, count);
        assert_true(cluster_run(&t.c) < 1);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

// The coordinator dies while the run begins, at any turn, and returns after any pause. A node that
// has joined asks the dead one again and again, and yet hears its successor.
static void test_coordinator_at_the_beginning(void **context) {
    (void)context;
    for (int k = 0; k < 12 * 40; ++k) {
        const int turns = 1 + k % 12;
        const double pause = 0.003 * (k / 12.0);
        stage t;
        (k % 2 == 0 ? stage_open : stage_open_quick)(&t, 1 + k % 4, 1, NULL);
        for (int i = 0; i < turns; ++i) {
            cluster_turn(&t.c);
        }
        cluster_kill(&t.c, t.c.count);
        for (const double end = t.c.now + pause; t.c.now < end;) {
            cluster_turn(&t.c);
        }
        cluster_return(&t.c, t.c.count);
        assert_true(cluster_run(&t.c) < 1);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

// A node that returns during the end of the run receives END as the answer to its hello, with
// checkpoints and without them: a client may have stopped the run before its last step. It ignores
// an END that answers nothing, such as one of an earlier run.
static void test_node_at_the_end(void **context) {
    (void)context;
    for (int i = 0; i < 4; ++i) {
        const bool keeps = i % 2 == 1, answers = i / 2 == 1;
        scratch s;
        scratch_open(&s);
        fixture f = {0};
        fixture_open(&f, 2, 1);
        pm_hub *hub = cluster_hub(NULL);
        pm_transport *transport, *stranger;
        pm_lockstep_node *node;
        const pm_lockstep_node_options options = {
            .session = SESSION, .checkpoint = keeps ? scratch_path(&s, "node") : NULL};
        assert_int_equal(pm_hub_connect(hub, &transport), PM_OK);
        assert_int_equal(pm_hub_connect(hub, &stranger), PM_OK);
        assert_int_equal(pm_lockstep_node_open(&node, f.system, 0, transport, &options), PM_OK);
        pm_lockstep_node_poll(node, 1);
        const portmet_command_t end = {.session = SESSION,
                                       .addressee = answers ? cluster_node_instance(node) : 0,
                                       .answer = answers ? cluster_nonce(node) : 0,
                                       .reason = ""};
        unsigned char data[128];
        const size_t size = pm_command_encode(&end, data, sizeof data);
        assert_int_equal(pm_transport_publish(stranger, "chain_COMMAND", data, size), PM_OK);
        assert_int_equal(pm_transport_wait(transport, 0, NULL), PM_OK);
        assert_int_equal(node->phase >= PM_NODE_LEAVING, answers);
        assert_int_equal(pm_lockstep_node_result(node), PM_OK);
        pm_lockstep_node_close(node);
        pm_transport_close(stranger);
        pm_transport_close(transport);
        pm_hub_close(hub);
        fixture_close(&f);
        scratch_close(&s);
    }
}

// Recomputing lost steps may take longer than the patience with a silent process.
static void test_patience_with_who_computes_again(void **context) {
    (void)context;
    stage t;
    stage_open(&t, 3, 1, NULL);
    cluster_run_to(&t.c, 2 * CHECKPOINT - 1);
    const double start = t.c.now;
    for (int deaths = 0; cluster_coordinator_step(t.c.coordinator) < 2 * CHECKPOINT;) {
        if (deaths < 3 && cluster_node_step(t.c.node[1]) == 2 * CHECKPOINT - 1) {
            cluster_kill(&t.c, 1);
            cluster_return(&t.c, 1);
            ++deaths;
        }
        t.c.now += 0.1 * PATIENCE;
        cluster_turn(&t.c);
    }
    assert_true(t.c.now - start > 4 * PATIENCE);
    assert_int_equal(t.c.pauses, 0);
    cluster_run(&t.c);
    assert_all_ok(&t.c);
    stage_close(&t);
}

// --- requests that are not new ---

typedef struct recorded {
    unsigned char data[64][256];
    size_t size[64];
    int count;
} recorded;

static const char *const request_channel[] = {"chain_REQUEST", "chain_REQUEST_TICK",
                                              "chain_REQUEST_link1", "chain_REQUEST_link2",
                                              "chain_REQUEST_link3"};
#define REQUEST_CHANNELS (int)(sizeof request_channel / sizeof request_channel[0])

static void record(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    recorded *r = context;
    if (r->count < 64 && size <= sizeof r->data[0]) {
        memcpy(r->data[r->count], data, size);
        r->size[r->count++] = size;
    }
}

// Replayed requests of a process that returned, after they were answered, roll nobody back.
static void test_old_requests_change_nothing(void **context) {
    (void)context;
    for (int who = 0; who < 4; ++who) {
        stage t;
        stage_open(&t, 3, 1, NULL);
        pm_transport *stranger;
        recorded r = {.count = 0};
        assert_int_equal(pm_hub_connect(t.hub, &stranger), PM_OK);
        for (int i = 0; i < REQUEST_CHANNELS; ++i) {
            assert_int_equal(pm_transport_subscribe(stranger, request_channel[i], record, &r),
                             PM_OK);
        }
        cluster_run_to(&t.c, CHECKPOINT + 5);
        cluster_kill(&t.c, who);
        cluster_return(&t.c, who);
        cluster_run_to(&t.c, 2 * CHECKPOINT + 3);
        assert_int_equal(pm_transport_wait(stranger, 0, NULL), PM_OK);
        assert_true(r.count > 0);
        long before[3];
        for (int i = 0; i < 3; ++i) {
            before[i] = cluster_node_step(t.c.node[i]);
        }
        for (int i = 0; i < r.count; ++i) {
            pm_transport_publish(stranger, "chain_REQUEST", r.data[i], r.size[i]);
        }
        for (int i = 0; i < 3; ++i) {
            assert_int_equal(pm_transport_wait(t.c.transport[i], 0, NULL), PM_OK);
            assert_true(cluster_node_step(t.c.node[i]) >= before[i]);
        }
        cluster_run(&t.c);
        assert_all_ok(&t.c);
        pm_transport_close(stranger);
        stage_close(&t);
    }
}

// --- another number of steps ---

// A run that continues from checkpoints may have fewer or more steps than before.
static void test_other_number_of_steps(void **context) {
    (void)context;
    static const long steps[] = {STEPS - 4, STEPS + 9};
    for (int k = 0; k < 2; ++k) {
        stage t;
        stage_open(&t, 2, 3, NULL);
        cluster_run_to(&t.c, STEPS - 5);
        cluster_kill(&t.c, 2);
        t.c.steps = steps[k];
        cluster_return(&t.c, 2);
        cluster_run(&t.c);
        assert_int_equal(pm_lockstep_coordinator_result(t.c.coordinator), PM_OK);
        assert_int_equal(t.c.steps_seen, steps[k] + 1);
        for (int i = 0; i < t.c.count; ++i) {
            assert_int_equal(pm_lockstep_node_result(t.c.node[i]), PM_OK);
        }
        stage_close(&t);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_undisturbed),
        cmocka_unit_test(test_each_at_every_step),
        cmocka_unit_test(test_all_at_once),
        cmocka_unit_test(test_at_random),
        cmocka_unit_test(test_coordinator_at_the_beginning),
        cmocka_unit_test(test_coordinator_at_the_end),
        cmocka_unit_test(test_coordinator_and_long_reports),
        cmocka_unit_test(test_node_at_the_end),
        cmocka_unit_test(test_patience_with_who_computes_again),
        cmocka_unit_test(test_old_requests_change_nothing),
        cmocka_unit_test(test_other_number_of_steps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
