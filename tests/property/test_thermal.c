// Thermal energies (model/thermal.h): temperatures and heat capacities are positive for all
// weights, the common factor of temperatures offsets them, and discrete derivatives are exact.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "graph/program.h"
#include "model/potential.h"
#include "model/thermal.h"
#include "tests/support/unit.h"

#define TRIALS 200

// For all weights dE/ds > 0 for every entropy, and E is convex in s. The temperature of a separate
// entropy does not depend on the others.
static void temperatures_and_heat_capacities_are_positive(void **state) {
    (void)state;
    static const char *const features[] = {"x", "s", "r"};
    static const int hidden[] = {5};
    pm_rng rng;
    pm_rng_init(&rng, 21, 1);
    for (int trial = 0; trial < TRIALS; ++trial) {
        pm_symbols symbols = {0};
        pm_params params = {0};
        pm_graph *g = NULL;
        pm_program *program = NULL;
        const pm_network_spec spec = {.nfeature = 3,
                                      .feature = features,
                                      .nhidden = 1,
                                      .hidden = hidden,
                                      .skip = (pm_skip)(trial % 3),
                                      .nthermal = 2,
                                      .exponentials = 1 + trial % 3,
                                      .separate = trial % 2 == 1,
                                      .rising = trial % 4 < 2,
                                      .temperature = 300,
                                      .scaled = true};
        assert_int_equal(pm_graph_open(&g), PM_OK);
        const pm_node z = pm_input(g, true, 1, 3);
        for (int i = 0; i < 3; ++i) {
            pm_symbols_add_one(&symbols, features[i], 1, pm_slice(g, z, i, 1));
        }
        assert_int_equal(pm_thermal_declare(&spec, &symbols, &params, "e"), PM_OK);
        for (int i = 0; i < params.count; ++i) {
            for (int k = 0; k < params.entry[i].rows * params.entry[i].cols; ++k) {
                params.entry[i].value[k] += params.entry[i].trained ? pm_rng_normal(&rng) : 0;
            }
        }
        pm_node out[3], slope;
        const pm_node values = pm_features_build(g, 3, features, &symbols);
        pm_gradient(g, pm_thermal_build_from(g, &spec, values, &params, "e"), PM_NO_NODE, 1, &z,
                    &slope);
        out[0] = slope;
        pm_gradient(g, pm_slice(g, slope, 1, 1), PM_NO_NODE, 1, &z, &out[1]);
        pm_gradient(g, pm_slice(g, slope, 2, 1), PM_NO_NODE, 1, &z, &out[2]);
        assert_int_equal(pm_program_open(&program, g, 3, out, 1), PM_OK);
        for (int i = 0; i < 3; ++i) {
            pm_program_value(program, z)[i] = 2 * pm_rng_normal(&rng);
        }
        pm_program_run(program, 1);
        const double *T = pm_program_value(program, out[0]) + 1;
        const double a = pm_program_value(program, out[1])[1],
                     b = pm_program_value(program, out[1])[2],
                     c = pm_program_value(program, out[2])[2];
        assert_true(T[0] > 0 && T[1] > 0);
        assert_true(a > 0 && c > 0 && a * c - b * b >= -1e-12 * a * c);
        assert_true(!spec.separate || (b <= 0 && b >= 0));
        pm_program_close(program);
        pm_graph_close(g);
        pm_params_free(&params);
    }
}

// Writes T = dE/ds and the force dE/dx of a thermal energy of x and s at `count` points.
static void look(const pm_network_spec *spec, const pm_params *params, int count,
                 const double (*z)[2], double (*slope)[2]) {
    pm_symbols symbols = {0};
    pm_graph *g = NULL;
    pm_program *program = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node at = pm_input(g, true, 1, 2);
    pm_symbols_add_one(&symbols, "x", 1, pm_slice(g, at, 0, 1));
    pm_symbols_add_one(&symbols, "s", 1, pm_slice(g, at, 1, 1));
    pm_node out;
    const pm_node values = pm_features_build(g, 2, spec->feature, &symbols);
    pm_gradient(g, pm_thermal_build_from(g, spec, values, params, "e"), PM_NO_NODE, 1, &at, &out);
    assert_int_equal(pm_program_open(&program, g, 1, &out, count), PM_OK);
    memcpy(pm_program_value(program, at), z, (size_t)count * sizeof *z);
    pm_program_run(program, count);
    memcpy(slope, pm_program_value(program, out), (size_t)count * sizeof *z);
    pm_program_close(program);
    pm_graph_close(g);
}

static void check_near(const char *what, double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance)) {
        fail_msg("%s: %.9g, expected %.9g within %g", what, value, expected, tolerance);
    }
}

// The capacity 1/(d ln T/ds) of one summand rises by the factor (1 + k exp(b s))/(1 + k) from s = 0
// on, where k is the square of the bend, and is constant but for 1e-4 without a bend.
static void heat_capacities_rise(void **state) {
    (void)state;
    static const char *const features[] = {"x", "s"};
    const pm_network_spec spec = {.nfeature = 2,
                                  .feature = features,
                                  .skip = PM_SKIP_LINEAR,
                                  .nthermal = 1,
                                  .exponentials = 1,
                                  .rising = true,
                                  .temperature = 300,
                                  .scaled = true};
    pm_symbols symbols = {0};
    pm_params params = {0};
    pm_symbols_add_one(&symbols, "x", 1, PM_NO_NODE);
    pm_symbols_add_one(&symbols, "s", 1, PM_NO_NODE);
    assert_int_equal(pm_thermal_declare(&spec, &symbols, &params, "e"), PM_OK);
    const double b = 0.4;
    *pm_params_find(&params, "e.exponent")->value = log(b);
    for (int bent = 0; bent < 2; ++bent) {
        const double h = 1e-3, k = bent ? 0.49 : 0;
        double z[6][2] = {{0}}, slope[6][2], capacity[2];
        *pm_params_find(&params, "e.bend")->value = sqrt(k);
        for (int i = 0; i < 6; ++i) {
            z[i][1] = (i < 3 ? 0 : 2) + (i % 3 - 1) * h;
        }
        look(&spec, &params, 6, (const double(*)[2])z, slope);
        for (int i = 0; i < 2; ++i) {
            capacity[i] = 2 * h / log(slope[3 * i + 2][1] / slope[3 * i][1]);
        }
        check_near("the temperature", slope[1][1], 300, 1e-9);
        check_near("the capacity", capacity[0] * b, 1 + k, 1e-3);
        check_near("how it rises", capacity[1] / capacity[0], (1 + k * exp(2 * b)) / (1 + k), 1e-3);
    }
    pm_params_free(&params);
}

// The common factor of all temperatures offsets them: their differences, and the forces, change by
// a small part of the relative change of the temperatures.
static void warmth_is_an_offset_of_temperatures(void **state) {
    (void)state;
    enum { POINTS = 20 };
    static const double warmer = 0.01, small = 0.1;
    static const char *const features[] = {"x", "s"};
    const pm_network_spec spec = {.nfeature = 2,
                                  .feature = features,
                                  .skip = PM_SKIP_QUADRATIC,
                                  .nthermal = 1,
                                  .exponentials = 1,
                                  .temperature = 300,
                                  .scaled = true,
                                  .spread = 0.5};
    pm_symbols symbols = {0};
    pm_params params = {0};
    pm_rng rng;
    pm_rng_init(&rng, 23, 1);
    double z[POINTS][2], before[POINTS][2], after[POINTS][2];
    pm_symbols_add_one(&symbols, "x", 1, PM_NO_NODE);
    pm_symbols_add_one(&symbols, "s", 1, PM_NO_NODE);
    assert_int_equal(pm_thermal_declare(&spec, &symbols, &params, "e"), PM_OK);
    pm_params_randomise(&params, &rng);
    for (int i = 0; i < POINTS; ++i) {
        z[i][0] = 0.5 * pm_rng_normal(&rng);
        z[i][1] = 0.5 * pm_rng_normal(&rng);
    }
    look(&spec, &params, POINTS, (const double(*)[2])z, before);
    *pm_params_find(&params, PM_WARMTH)->value = warmer;
    look(&spec, &params, POINTS, (const double(*)[2])z, after);
    for (int i = 0; i < POINTS; ++i) {
        const double offset = after[i][1] - before[i][1];
        check_near("the temperature", offset, 300 * warmer, 300 * warmer * small);
        for (int c = 0; c < 2; ++c) {
            const double difference = before[i][c] - before[0][c];
            const double change = after[i][c] - after[0][c] - difference;
            check_near("the change of a difference", change, 0,
                       small * warmer * (fabs(difference) + 1));
        }
    }
    pm_params_free(&params);
}

// The discrete derivative of a thermal energy satisfies D . (z_to - z_from) = E_to - E_from.
static void thermal_energies_have_discrete_derivatives(void **state) {
    (void)state;
    static const char *const features[] = {"x", "s"};
    static const int hidden[] = {4};
    const pm_network_spec spec = {.nfeature = 2,
                                  .feature = features,
                                  .nhidden = 1,
                                  .hidden = hidden,
                                  .skip = PM_SKIP_QUADRATIC,
                                  .nthermal = 1,
                                  .exponentials = 2,
                                  .rising = true,
                                  .temperature = 300,
                                  .scaled = true,
                                  .spread = 0.5};
    const pm_potential_spec energy = {.nterm = 1, .term = &spec};
    pm_symbols from = {0}, to = {0};
    pm_params params = {0};
    pm_rng rng;
    pm_rng_init(&rng, 22, 1);
    pm_graph *g = NULL;
    pm_program *program = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node a = pm_input(g, true, 1, 2), b = pm_input(g, true, 1, 2);
    for (int i = 0; i < 2; ++i) {
        pm_symbols_add_one(&from, features[i], 1, pm_slice(g, a, i, 1));
        pm_symbols_add_one(&to, features[i], 1, pm_slice(g, b, i, 1));
    }
    assert_int_equal(pm_potential_declare(&energy, &from, &params, "energy"), PM_OK);
    pm_params_randomise(&params, &rng);
    pm_node out[4] = {PM_NO_NODE, PM_NO_NODE,
                      pm_potential_build(g, &energy, &from, &params, "energy"),
                      pm_potential_build(g, &energy, &to, &params, "energy")};
    pm_potential_discrete(g, &energy, &from, &to, &params, "energy", out);
    assert_int_equal(pm_program_open(&program, g, 4, out, 1), PM_OK);
    for (int trial = 0; trial < TRIALS; ++trial) {
        double *za = pm_program_value(program, a), *zb = pm_program_value(program, b);
        for (int i = 0; i < 2; ++i) {
            za[i] = pm_rng_normal(&rng);
            zb[i] = za[i] + 0.3 * pm_rng_normal(&rng);
        }
        pm_program_run(program, 1);
        double carried = 0;
        for (int i = 0; i < 2; ++i) {
            carried += *pm_program_value(program, out[i]) * (zb[i] - za[i]);
        }
        const double Ea = *pm_program_value(program, out[2]),
                     Eb = *pm_program_value(program, out[3]);
        assert_true(fabs(carried - (Eb - Ea)) <= 1e-9 * (1 + fabs(Ea) + fabs(Eb)));
    }
    pm_program_close(program);
    pm_graph_close(g);
    pm_params_free(&params);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(temperatures_and_heat_capacities_are_positive),
        cmocka_unit_test(heat_capacities_rise),
        cmocka_unit_test(warmth_is_an_offset_of_temperatures),
        cmocka_unit_test(thermal_energies_have_discrete_derivatives),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
