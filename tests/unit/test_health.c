// The coordinator finds out from the vitals of processes who waits for whom and whose messages get
// lost, and gives each warning once.
#include <string.h>

#include "lockstep/health.h"
#include "tests/support/fixture.h"
#include "tests/support/unit.h"

enum { SESSION = 77, NODES = 3 };

typedef struct stage {
    fixture f;
    pm_arena arena;
    pm_health health;
    double elapsed;
    portmet_vitals_t sums[NODES];
    int64_t numbers[NODES][16], drops[PM_NDROP];
    double waited[NODES][4];
} stage;

// link2 has two neighbours, the others one; each waits for the coordinator, too.
static void stage_open(stage *s) {
    static const int64_t peers[NODES][3] = {{1, -1}, {0, 2, -1}, {1, -1}};
    memset(s, 0, sizeof *s);
    fixture_open(&s->f, NODES, 1);
    assert_int_equal(pm_health_init(&s->health, &s->arena, s->f.scene, 5, SESSION, 1000), PM_OK);
    for (int i = 0; i < NODES; ++i) {
        portmet_vitals_t *v = &s->sums[i];
        *v = (portmet_vitals_t){.session = SESSION,
                                .process = i,
                                .npeer = i == 1 ? 3 : 2,
                                .peer = s->numbers[i],
                                .waited = s->waited[i],
                                .asked = s->numbers[i] + 3,
                                .used = s->numbers[i] + 6,
                                .answered = s->numbers[i] + 9,
                                .ndrop = PM_NDROP,
                                .drops = s->drops};
        memcpy(v->peer, peers[i], (size_t)v->npeer * sizeof(int64_t));
    }
}

static void stage_close(stage *s) {
    pm_arena_free(&s->arena);
    fixture_close(&s->f);
}

static void tell(stage *s, int i) {
    unsigned char data[1024];
    s->sums[i].elapsed = s->elapsed;
    const size_t size = pm_vitals_encode(&s->sums[i], data, sizeof data);
    assert_true(size > 0);
    assert_int_equal(pm_health_take(&s->health, data, size, 100 + s->elapsed), PM_KEEP);
}

// A second passes, in which process `slow` computes and each other one waits for the peer on the
// way to it.
static void pass(stage *s, int slow) {
    s->elapsed += 1;
    for (int i = 0; i < NODES; ++i) {
        portmet_vitals_t *v = &s->sums[i];
        v->step += 50;
        v->cpu += 0.25;
        for (int k = 0; k < v->npeer - 1; ++k) {
            v->used[k] += 100;
            const bool towards = i < slow ? v->peer[k] > i : v->peer[k] < i;
            v->waited[k] += i != slow && towards ? 0.9 : 0.01;
        }
        v->computing += i == slow ? 0.95 : 0.05;
        tell(s, i);
    }
    assert_true(pm_health_is_due(&s->health, s->sums[0].step, 100 + s->elapsed));
}

static void test_the_blocker_is_found_along_the_way(void **context) {
    (void)context;
    for (int slow = 0; slow < NODES; ++slow) {
        stage s;
        char text[256];
        stage_open(&s);
        pass(&s, slow);
        pass(&s, slow);
        const portmet_health_t *h = &s.health.message;
        assert_int_equal(h->blocker, slow);
        assert_true(h->process_rate[0] == 50);
        assert_true(h->rate == 50);
        assert_in_range((int)(100 * h->cpu[1] + 0.5), 24, 26);
        assert_in_range((int)(100 * h->computing[slow] + 0.5), 94, 96);
        assert_int_equal(h->waits_for[slow == 0 ? 2 : 0], 1);
        assert_true(pm_health_warn(&s.health, text, sizeof text));
        assert_non_null(strstr(text, s.f.scene->network.process[slow].name));
        assert_non_null(strstr(text, "makes all others wait"));
        assert_false(pm_health_warn(&s.health, text, sizeof text));
        stage_close(&s);
    }
}

static void test_nobody_blocks(void **context) {
    (void)context;
    stage s;
    char text[256];
    stage_open(&s);
    for (int i = 0; i < 4; ++i) {
        pass(&s, i % 2); // now this one, now that one
        for (int k = 0; k < NODES; ++k) {
            s.sums[k].elapsed += 1;
        }
        s.elapsed += 1; // and a second in which nobody waits
    }
    assert_int_equal(s.health.message.blocker, PM_HEALTH_NOBODY);
    assert_false(pm_health_warn(&s.health, text, sizeof text));
    stage_close(&s);
}

// Requests alone are no loss: a slow process is asked, too. A message that is sent again was lost.
static void test_losses(void **context) {
    (void)context;
    stage s;
    char text[256];
    stage_open(&s);
    pass(&s, 1);
    s.sums[0].asked[0] += 50;
    pass(&s, 1);
    assert_int_equal(s.health.message.loses_from[0], PM_HEALTH_NOBODY);
    assert_true(s.health.message.asks[0] == 50);
    s.sums[1].answered[0] += 12; // link2 sent so many to link1 again
    pass(&s, 1);
    assert_int_equal(s.health.message.loses_from[0], 1);
    assert_true(s.health.message.loss[0] == 0.12);
    assert_true(s.health.message.answers[1] == 12);
    assert_true(pm_health_warn(&s.health, text, sizeof text));
    assert_string_equal(text, "link1 had to be sent 12 % of the messages of link2 again");
    stage_close(&s);
}

// A process that says nothing any more, and one that was started again.
static void test_silence_and_return(void **context) {
    (void)context;
    stage s;
    stage_open(&s);
    assert_true(pm_health_is_due(&s.health, -1, 100));
    assert_false(pm_health_is_due(&s.health, -1, 100.5));
    assert_true(s.health.message.silent[2] < 0);
    pass(&s, 1);
    pass(&s, 1);
    assert_true(pm_health_is_due(&s.health, 100, 110));
    assert_true(s.health.message.silent[2] == 8);
    s.elapsed = 0.5;
    memset(s.waited[2], 0, sizeof s.waited[2]);
    tell(&s, 2); // its sums begin anew
    s.elapsed = 1.5;
    s.waited[2][0] = 0.5;
    tell(&s, 2);
    assert_true(s.health.message.waits_part[2] == 0.5);
    stage_close(&s);
}

static void test_foreign_vitals_are_dropped(void **context) {
    (void)context;
    stage s;
    unsigned char data[1024];
    stage_open(&s);
    const struct {
        int64_t session;
        int32_t process;
        pm_drop expected;
    } cases[] = {{SESSION + 1, 0, PM_DROP_SESSION},
                 {SESSION, -1, PM_DROP_IMPLAUSIBLE},
                 {SESSION, NODES, PM_DROP_IMPLAUSIBLE},
                 {SESSION, 1, PM_DROP_IMPLAUSIBLE}}; // has another number of peers
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        s.sums[0].session = cases[i].session;
        s.sums[0].process = cases[i].process;
        const size_t size = pm_vitals_encode(&s.sums[0], data, sizeof data);
        assert_int_equal(pm_health_take(&s.health, data, size, 1), cases[i].expected);
    }
    stage_close(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_the_blocker_is_found_along_the_way),
        cmocka_unit_test(test_nobody_blocks),
        cmocka_unit_test(test_losses),
        cmocka_unit_test(test_silence_and_return),
        cmocka_unit_test(test_foreign_vitals_are_dropped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
