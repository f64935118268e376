// Death and return over the memory transport, in virtual time: whoever is killed, whenever and how
// often, and started again from its checkpoint, the run ends with the same bits.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
// cmocka needs the above.
#include <cmocka.h>

#include "base/rng.h"
#include "company.h"
#include "scratch.h"

typedef struct stage {
    scratch s;
    pm_hub *hub;
    company c;
} stage;

static void stage_open(stage *t, int count, int window, const pm_hub_faults *faults) {
    scratch_open(&t->s);
    t->hub = company_hub(faults);
    company_open_keeping(&t->c, count, window, t->hub, t->s.folder);
}

static void stage_close(stage *t) {
    company_close(&t->c);
    pm_hub_close(t->hub);
    scratch_close(&t->s);
}

// Without anybody dying: the nodes remove their checkpoints.
static void test_undisturbed(void **context) {
    (void)context;
    stage t;
    stage_open(&t, 3, 1, NULL);
    assert_true(company_run(&t.c) < 0.19);
    assert_all_ok(&t.c);
    assert_int_equal(scratch_files(&t.s, 0), 1); // the coordinator's
    stage_close(&t);
}

// Each of them, after every step, for a while.
static void test_each_at_every_step(void **context) {
    (void)context;
    for (int who = 0; who < 4; ++who) {
        stage t;
        stage_open(&t, 3, 1 + who % 2, NULL);
        for (long step = 0; step < STEPS; ++step) {
            company_run_to(&t.c, step);
            company_kill(&t.c, who);
            for (const double end = t.c.now + 0.05; t.c.now < end;) {
                company_turn(&t.c);
            }
            company_return(&t.c, who);
        }
        company_run(&t.c);
        assert_all_ok(&t.c);
        stage_close(&t);
    }
}

// All of them at once: everything goes on from the files.
static void test_all_at_once(void **context) {
    (void)context;
    stage t;
    stage_open(&t, 4, 2, NULL);
    for (long step = 3; step < STEPS; step += 4) {
        company_run_to(&t.c, step);
        for (int i = 0; i <= t.c.count; ++i) {
            company_kill(&t.c, i);
        }
        for (int i = 0; i <= t.c.count; ++i) {
            company_return(&t.c, i);
        }
    }
    company_run(&t.c);
    assert_all_ok(&t.c);
    stage_close(&t);
}

// Kills at random, several at a time, on a network that loses, repeats and reorders.
static void play(uint64_t seed, const pm_hub_faults *faults) {
    enum { KILLS = 25 };
    pm_rng rng;
    pm_rng_init(&rng, seed, 1);
    stage t;
    stage_open(&t, 2 + (int)(seed % 4), 1 + (int)(seed % 3), faults);
    for (int kills = 0; kills < KILLS && !company_is_over(&t.c);) {
        company_turn(&t.c);
        const int who = (int)pm_rng_below(&rng, (uint64_t)t.c.count + 1);
        const uint64_t dice = pm_rng_below(&rng, 100);
        if (company_has(&t.c, who) && dice < 2) {
            company_kill(&t.c, who);
            ++kills;
        } else if (!company_has(&t.c, who) && dice < 20) {
            company_return(&t.c, who);
        }
    }
    for (int i = 0; i <= t.c.count; ++i) {
        if (!company_has(&t.c, i)) {
            company_return(&t.c, i);
        }
    }
    company_run(&t.c);
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_undisturbed),
        cmocka_unit_test(test_each_at_every_step),
        cmocka_unit_test(test_all_at_once),
        cmocka_unit_test(test_at_random),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
