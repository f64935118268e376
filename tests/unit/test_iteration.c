// The end of an iteration: all subsystems of a graph end it in the same round.
#include "base/rng.h"
#include "sim/iteration.h"
#include "tests/support/unit.h"

#define MOST 12   // subsystems
#define ROUNDS 80 // at most

// A path through all subsystems, with some more edges at random.
typedef struct graph {
    int n;
    bool joined[MOST][MOST];
} graph;

static graph random_graph(pm_rng *rng) {
    graph g = {.n = 1 + (int)pm_rng_below(rng, MOST)};
    for (int i = 0; i < g.n; ++i) {
        for (int k = 0; k < i; ++k) {
            g.joined[i][k] = g.joined[k][i] = k == i - 1 || pm_rng_below(rng, 12) == 0;
        }
    }
    return g;
}

// Iterates until all have ended; subsystem i converges in round converges[i]. Returns the number of
// rounds, and checks that all end in the last one.
static int iterate(const graph *g, const int *converges, int diameter) {
    pm_iteration it[MOST];
    int rounds = 0, ended = 0;
    for (int i = 0; i < g->n; ++i) {
        pm_iteration_start(&it[i]);
    }
    while (ended == 0) {
        uint64_t known[MOST];
        for (int i = 0; i < g->n; ++i) {
            known[i] = it[i].known;
        }
        for (int i = 0; i < g->n; ++i) {
            for (int k = 0; k < g->n; ++k) {
                if (g->joined[i][k]) {
                    pm_iteration_hear(&it[i], known[k]);
                }
            }
            const double change = rounds >= converges[i] ? 0 : 1;
            ended += pm_iteration_end_round(&it[i], change, 0, diameter, ROUNDS - 1 - rounds);
        }
        rounds += 1;
    }
    assert_int_equal(ended, g->n);
    return rounds;
}

// D rounds after the last has converged all know it; one more round is the last.
static void test_all_end_together(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 3, 0);
    for (int i = 0; i < 2000; ++i) {
        const graph g = random_graph(&rng);
        int converges[MOST], last = 0;
        for (int k = 0; k < g.n; ++k) {
            converges[k] = (int)pm_rng_below(&rng, 20);
            last = converges[k] > last ? converges[k] : last;
        }
        const int diameter = g.n - 1; // a path is that long
        assert_int_equal(iterate(&g, converges, diameter), last + 1 + diameter + 1);
    }
}

// What has converged may move again: all still end together, and not before all have converged in
// the same round.
static void test_convergence_may_be_lost(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 5, 0);
    for (int i = 0; i < 2000; ++i) {
        const graph g = random_graph(&rng);
        const uint64_t seed = pm_rng_bits(&rng);
        pm_iteration it[MOST];
        bool all[ROUNDS];
        int ended = 0, rounds = 0;
        for (int k = 0; k < g.n; ++k) {
            pm_iteration_start(&it[k]);
        }
        for (; ended == 0; ++rounds) {
            uint64_t known[MOST];
            all[rounds] = true;
            for (int k = 0; k < g.n; ++k) {
                known[k] = it[k].known;
            }
            for (int k = 0; k < g.n; ++k) {
                pm_rng own;
                pm_rng_init(&own, seed + (uint64_t)k, (uint64_t)rounds);
                const bool converged = pm_rng_below(&own, 8) != 0;
                for (int m = 0; m < g.n; ++m) {
                    if (g.joined[k][m]) {
                        pm_iteration_hear(&it[k], known[m]);
                    }
                }
                all[rounds] = all[rounds] && converged;
                ended += pm_iteration_end_round(&it[k], converged ? 0 : 1, 0, g.n - 1,
                                                ROUNDS - 1 - rounds);
            }
        }
        assert_int_equal(ended, g.n);
        const int seen = rounds - 2 - (g.n - 1);
        assert_true(rounds == ROUNDS || (seen >= 0 && all[seen]));
    }
}

// If one does not converge, all end after the largest number of rounds.
static void test_rounds_are_bounded(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 4, 0);
    for (int i = 0; i < 100; ++i) {
        const graph g = random_graph(&rng);
        int converges[MOST] = {0};
        converges[pm_rng_below(&rng, (uint64_t)g.n)] = ROUNDS;
        assert_int_equal(iterate(&g, converges, g.n - 1), ROUNDS);
    }
}

// Changes at the limit of rounding need not fall any more; larger ones must.
static void test_rounding_counts(void **state) {
    (void)state;
    pm_iteration it;
    pm_iteration_start(&it);
    assert_false(pm_iteration_end_round(&it, 0.9 * PM_ITERATION_ROUNDING, 0, 0, ROUNDS));
    assert_false(it.last);
    assert_false(pm_iteration_end_round(&it, 0.9 * PM_ITERATION_ROUNDING, 0, 0, ROUNDS));
    assert_true(it.last);
    assert_true(pm_iteration_end_round(&it, 0, 0, 0, ROUNDS));
    pm_iteration_start(&it);
    for (int i = 0; i < 10; ++i) {
        assert_false(pm_iteration_end_round(&it, 2 * PM_ITERATION_ROUNDING, 0, 0, ROUNDS));
        assert_false(it.last);
    }
    // Energy that is left open counts where a converged iterate leaves none.
    for (int keeps = 0; keeps < 2; ++keeps) {
        pm_iteration_start(&it);
        it.start = 1;
        it.keeps_energy = keeps == 1;
        assert_false(pm_iteration_end_round(&it, 0, 3, 0, ROUNDS));
        assert_int_equal(it.last, keeps == 0);
    }
}

// The last rounds accept a small change, unless it leaves energy open beside which no subsystem's
// own counts; then all give up in the same round. Where the distances are too long, the one that
// changes is stuck.
static void test_all_give_up_together(void **state) {
    (void)state;
    static const struct {
        double change, open;
        int diameter; // beyond the number of subsystems
        bool solved;
        double growth; // of the change from one round to the next
    } c[] = {{0.9 * PM_ITERATION_ACCEPTED, 0.4, 0, true, 1},
             {0.9 * PM_ITERATION_ACCEPTED, 1.1, 0, false, 1},
             {1.1 * PM_ITERATION_ACCEPTED, 0, 0, false, 1},
             {1.1 * PM_ITERATION_ACCEPTED, 0, 25, false, 1},
             {0.5 * PM_ITERATION_ACCEPTED, 0, 0, true, 0.99},
             {0.5 * PM_ITERATION_ACCEPTED, 0, 0, false, 1.01}};
    pm_rng rng;
    pm_rng_init(&rng, 6, 0);
    for (int i = 0; i < 400; ++i) {
        const graph g = random_graph(&rng);
        const int slow = (int)pm_rng_below(&rng, (uint64_t)g.n), n = g.n;
        const int heavy = (int)pm_rng_below(&rng, (uint64_t)g.n);
        const size_t row = (size_t)i % (sizeof c / sizeof *c);
        pm_iteration it[MOST];
        int ended = 0, rounds = 0;
        for (int k = 0; k < n; ++k) {
            pm_iteration_start(&it[k]);
            it[k].start = k == heavy ? -0.6 : 0;
        }
        for (; ended == 0; ++rounds) {
            const double change = c[row].change * pow(c[row].growth, rounds - ROUNDS);
            uint64_t known[MOST];
            for (int k = 0; k < n; ++k) {
                known[k] = it[k].known;
            }
            for (int k = 0; k < n; ++k) {
                for (int m = 0; m < n; ++m) {
                    if (g.joined[k][m]) {
                        pm_iteration_hear(&it[k], known[m]);
                    }
                }
                ended += pm_iteration_end_round(&it[k], k == slow ? change : 0, c[row].open,
                                                n - 1 + c[row].diameter, ROUNDS - 1 - rounds);
                assert_true(!it[k].gave_up || (rounds >= ROUNDS - 2 && !c[row].solved));
            }
        }
        assert_int_equal(rounds, ROUNDS);
        for (int k = 0; k < n; ++k) {
            const bool far = c[row].diameter > 0;
            assert_int_equal(it[k].gave_up, !c[row].solved && !far);
            assert_int_equal(it[k].stuck, !c[row].solved && far && k == slow);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_all_end_together),     cmocka_unit_test(test_convergence_may_be_lost),
        cmocka_unit_test(test_rounds_are_bounded),   cmocka_unit_test(test_rounding_counts),
        cmocka_unit_test(test_all_give_up_together),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
