// Sums and tallies have the same bits however their numbers are ordered and divided, and a tally
// finds the worst residuals that a plain loop finds.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "base/rng.h"
#include "sim/tally.h"
#include "tests/support/unit.h"

#define SEED 1822u
#define COUNT 1000
#define PARTS 7
#define CASES 50

// Numbers of both signs over many powers of two.
static void draw(pm_rng *rng, double spread, double *x) {
    for (int i = 0; i < COUNT; ++i) {
        x[i] = pm_rng_normal(rng) * pow(2, spread * (pm_rng_uniform(rng) - 0.5));
    }
}

static void sums_have_the_same_bits_in_any_order(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, SEED, 0);
    for (int c = 0; c < CASES; ++c) {
        double x[COUNT], scale = pow(2, 40 * (pm_rng_uniform(&rng) - 0.5));
        long double exact = 0, gross = 0;
        draw(&rng, c, x);
        pm_reproducible_sum whole = {0}, merged = {0}, part[PARTS] = {{0}};
        for (int i = 0; i < COUNT; ++i) {
            x[i] *= scale;
            exact += (long double)x[i];
            gross = fmaxl(gross, fabsl((long double)x[i]));
            pm_reproducible_sum_add(&part[pm_rng_bits(&rng) % PARTS], 1, &x[i], false);
        }
        pm_reproducible_sum_add(&whole, COUNT, x, false);
        for (int i = PARTS - 1; i >= 0; --i) {
            pm_reproducible_sum_merge(&merged, &part[i]);
        }
        const double a = pm_reproducible_sum_value(&whole), b = pm_reproducible_sum_value(&merged);
        if (memcmp(&a, &b, sizeof a) != 0) {
            fail_msg("seed %u, case %d: %.17g in one sum, %.17g in %d", SEED, c, a, b, PARTS);
        }
        const double error = (double)(fabsl((long double)a - exact) / gross);
        if (!(error < COUNT * 0x1p-52)) {
            fail_msg("seed %u, case %d: error %.3g of the largest number", SEED, c, error);
        }
    }
}

static void a_sum_shows_what_is_not_finite(void **state) {
    (void)state;
    const double x[] = {1, NAN, 3}, y[] = {INFINITY, 0};
    pm_reproducible_sum sum = {0}, other = {0};
    assert_true(pm_reproducible_sum_value(&sum) == 0);
    pm_reproducible_sum_add(&sum, 3, x, true);
    assert_true(!isfinite(pm_reproducible_sum_value(&sum)));
    pm_reproducible_sum_add(&other, 2, y, false);
    assert_true(!isfinite(pm_reproducible_sum_value(&other)));
}

// --- tallies ---

// Fluxes of ports whose gross fluxes differ by many powers of two.
typedef struct fluxes {
    double number[2][4][COUNT];
} fluxes;

static pm_lane_flux lanes(fluxes *f, int end, int first) {
    return (pm_lane_flux){f->number[end][0] + first, f->number[end][1] + first,
                          f->number[end][2] + first, f->number[end][3] + first};
}

static void draw_fluxes(pm_rng *rng, double spread, fluxes *f) {
    for (int i = 0; i < COUNT; ++i) {
        const double size = pow(2, -spread * pm_rng_uniform(rng));
        // Some residuals are equal, and some are zero.
        const double residual[] = {0, 1e-16, 1e-16 * pm_rng_normal(rng)};
        for (int law = 0; law < 2; ++law) {
            const double flux = size * pm_rng_normal(rng);
            const double error = size * residual[pm_rng_bits(rng) % 3];
            f->number[0][law][i] = flux;
            f->number[1][law][i] = error - flux;
            f->number[0][2 + law][i] = f->number[1][2 + law][i] = 3 * size;
        }
    }
}

// The worst residual of a law by a plain loop. A flux is compared with the largest one by the
// powers of 2^8 between them.
static pm_tally_worst plain(const fluxes *f, pm_tally_law law) {
    double largest = 0;
    pm_tally_worst worst = {0, 0};
    for (int i = 0; i < COUNT; ++i) {
        largest = fmax(largest, f->number[0][2 + law][i]);
    }
    for (int i = 0; i < COUNT; ++i) {
        const double gross = f->number[0][2 + law][i];
        const double sum = f->number[0][law][i] + f->number[1][law][i];
        const double residual = (law == PM_TALLY_ENERGY ? fabs(sum) : -sum) / gross;
        const double classes = floor((ilogb(largest) + 1) / 8.0) - floor((ilogb(gross) + 1) / 8.0);
        if (classes < PM_TALLY_CLASSES && residual > worst.residual) {
            worst = (pm_tally_worst){residual, i};
        }
    }
    return worst;
}

static void tallies_have_the_same_bits_in_any_division(void **state) {
    (void)state;
    static fluxes f;
    pm_rng rng;
    pm_rng_init(&rng, SEED, 1);
    for (int c = 0; c < CASES; ++c) {
        pm_tally whole = {0}, merged = {0}, part[PARTS];
        memset(part, 0, sizeof part);
        int id[COUNT];
        draw_fluxes(&rng, 3 * c, &f);
        const pm_lane_flux a = lanes(&f, 0, 0), b = lanes(&f, 1, 0);
        pm_tally_add_fluxes(&whole, PM_TALLY_HARD, COUNT, 0, NULL, &a, &b);
        for (int i = 0, count; i < COUNT; i += count) {
            count = 1 + (int)(pm_rng_bits(&rng) % 100);
            count = count < COUNT - i ? count : COUNT - i;
            for (int k = 0; k < count; ++k) {
                id[k] = i + k;
            }
            const pm_lane_flux one = lanes(&f, 0, i), two = lanes(&f, 1, i);
            pm_tally_add_fluxes(&part[pm_rng_bits(&rng) % PARTS], PM_TALLY_HARD, count, 0, id, &one,
                                &two);
        }
        for (int i = PARTS - 1; i >= 0; --i) {
            pm_tally_merge(&merged, &part[i]);
        }
        assert_memory_equal(whole.top, merged.top, sizeof whole.top);
        assert_memory_equal(whole.worst, merged.worst, sizeof whole.worst);
        for (pm_tally_law law = 0; law < PM_TALLY_LAWS; ++law) {
            const pm_tally_worst found = pm_tally_worst_of(&whole, law, PM_TALLY_HARD);
            const pm_tally_worst expected = plain(&f, law);
            if (found.residual != expected.residual || found.place != expected.place) {
                fail_msg("seed %u, case %d, law %d: worst %.17g at %g, expected %.17g at %g", SEED,
                         c, (int)law, found.residual, found.place, expected.residual,
                         expected.place);
            }
            assert_true(pm_tally_worst_of(&whole, law, PM_TALLY_SOFT).residual == 0);
        }
        const double x = pm_reproducible_sum_value(&whole.gross);
        const double y = pm_reproducible_sum_value(&merged.gross);
        assert_true(x == y && x > 0);
    }
}

int main(void) {
    pm_linalg_init();
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sums_have_the_same_bits_in_any_order),
        cmocka_unit_test(a_sum_shows_what_is_not_finite),
        cmocka_unit_test(tallies_have_the_same_bits_in_any_division),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
