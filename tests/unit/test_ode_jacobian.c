// Sparse Jacobians by differences are compared with dense ones, on a chain of pendula.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "tests/support/unit.h"
#include "truth/chain.h"
#include "truth/ode.h"

enum { LINKS = 12, LONG = 5 * LINKS };

static const pm_chain_link three[] = {
    {1, 0.03, 2, 0.09, 5}, {2, 0.2, 1, 0.07, 4}, {0.5, 0.1, 1.5, 0.05, 6}};

static int nrate; // evaluations of chain_rate

static void chain_rate(const void *data, const double *z, double *zdot) {
    pm_chain_rate(data, z, zdot);
    ++nrate;
}

// Makes a chain of links of three kinds with strong conduction, and a random state.
static pm_chain long_chain(pm_chain_link *link, double *z) {
    const pm_chain chain = {
        .n = LINKS, .conductivity = 300, .reference_temperature = 300, .link = link};
    pm_rng rng;
    pm_rng_init(&rng, 14, 0);
    for (int k = 0; k < LINKS; ++k) {
        link[k] = three[k % 3];
        for (int i = 0; i < 2; ++i) {
            z[pm_chain_q(k) + i] = 2 * (k + 1) + 0.5 * pm_rng_normal(&rng);
            z[pm_chain_p(&chain, k) + i] = 0.5 * pm_rng_normal(&rng);
        }
        z[pm_chain_s(&chain, k)] = 0.1 * pm_rng_normal(&rng);
    }
    return chain;
}

// Every component is moved alone: rates outside the pattern must keep their bits, and the
// differences of the others are the sparse Jacobian.
static void pattern_is_complete(void **state) {
    (void)state;
    pm_chain_link link[LINKS];
    double z[LONG], zdot[LONG], weight[LONG], moved[LONG], rate[LONG], value[11 * LONG];
    const pm_chain chain = long_chain(link, z);
    pm_arena arena = {0};
    const pm_ode ode = {LONG, chain_rate, &chain, pm_chain_pattern(&chain, &arena)};
    assert_non_null(ode.pattern);
    pm_ode_jacobian *jacobian = pm_ode_jacobian_new(&ode);
    assert_non_null(jacobian);
    pm_chain_rate(&chain, z, zdot);
    for (int j = 0; j < LONG; ++j) {
        weight[j] = 1e6;
    }
    const pm_ode_difference difference = {1e-3, z, zdot, weight, moved, rate};
    nrate = 0;
    assert_true(pm_ode_jacobian_fill(jacobian, &difference, value));
    assert_in_range(nrate, 5, 25); // one for each colour, however long the chain is
    for (int j = 0; j < LONG; ++j) {
        const int *start = ode.pattern->start + j, *row = ode.pattern->row;
        const double h = 1e-6;
        int k = start[0];
        memcpy(moved, z, sizeof moved);
        moved[j] += h;
        pm_chain_rate(&chain, moved, rate);
        for (int i = 0; i < LONG; ++i) {
            const double slope = (rate[i] - zdot[i]) / h;
            const bool listed = k < start[1] && row[k] == i;
            assert_near("entry of the Jacobian", slope, listed ? value[k] : 0,
                        listed ? 1e-4 * fmax(1, fabs(slope)) : 0);
            k += listed;
        }
        assert_int_equal(k, start[1]);
    }
    pm_ode_jacobian_free(jacobian);
    pm_arena_free(&arena);
}

// A stiff chain has the same solution with a sparse Jacobian as with a dense one.
static void sparse_is_as_dense(void **state) {
    (void)state;
    enum { NTIME = 11 };
    const pm_ode_method bdf = {PM_ODE_BDF, 1e-13, 1e-14};
    static double z[2][NTIME][LONG];
    pm_chain_link link[LINKS];
    const pm_chain chain = long_chain(link, z[0][0]);
    memcpy(z[1][0], z[0][0], sizeof z[0][0]);
    pm_arena arena = {0};
    pm_ode ode = {LONG, chain_rate, &chain, NULL};
    assert_int_equal(pm_ode_solve(&ode, bdf, NTIME, 0.1, z[0][0]), PM_OK);
    ode.pattern = pm_chain_pattern(&chain, &arena);
    assert_int_equal(pm_ode_solve(&ode, bdf, NTIME, 0.1, z[1][0]), PM_OK);
    pm_arena_free(&arena);
    for (int i = 1; i < NTIME; ++i) {
        for (int j = 0; j < LONG; ++j) {
            assert_near("sparse", z[1][i][j], z[0][i][j], 1e-9);
        }
    }
    assert_true(fabs(z[0][NTIME - 1][0] - z[0][0][0]) > 1e-3);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pattern_is_complete),
        cmocka_unit_test(sparse_is_as_dense),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
