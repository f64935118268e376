// Linear laws of irreversible physics are constant factors of learned operators. For all weights
// operators are symmetric and degenerate, and entropy grows.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "graph/program.h"
#include "model/dissipation.h"
#include "model/potential.h"
#include "sim/monolithic.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define TRIALS 200
// Rounding of sums of a few products, some of which cancel.
#define ROUNDING 1e-11
#define MAX_N 8
#define MAX_HEATS 3
#define MAX_COLUMNS 3

// --- one operator against its definition ---

typedef struct operands {
    int n, rank, nheat;
    int heat[MAX_HEATS];
    double driving[MAX_N], normal[MAX_N], factor[MAX_COLUMNS * MAX_N];
    double split[MAX_COLUMNS * MAX_HEATS];
    double power, ratio_power;
    double strength[MAX_COLUMNS]; // logarithms
} operands;

static bool is_heat(const operands *o, int c, int *k) {
    for (*k = 0; *k < o->nheat; ++*k) {
        if (o->heat[*k] == c) {
            return true;
        }
    }
    return false;
}

static void draw_operands(operands *o, pm_rng *rng) {
    *o = (operands){.nheat = 1 + (int)pm_rng_below(rng, MAX_HEATS)};
    o->rank = 1 + (int)pm_rng_below(rng, MAX_COLUMNS);
    o->n = o->nheat + 1 + (int)pm_rng_below(rng, MAX_N - MAX_HEATS);
    for (int k = 0; k < o->nheat; ++k) {
        o->heat[k] = k == 0 ? (int)pm_rng_below(rng, 2) : o->n - o->nheat + k;
    }
    for (int c = 0; c < o->n; ++c) {
        int k;
        const bool heat = is_heat(o, c, &k);
        o->driving[c] = heat ? 1 : 0;
        o->normal[c] = heat ? 300 * exp(0.5 * pm_rng_normal(rng)) : pm_rng_normal(rng);
    }
    for (int i = 0; i < o->rank * o->n; ++i) {
        o->factor[i] = pm_rng_normal(rng);
    }
    for (int i = 0; i < o->rank * (o->nheat - 1); ++i) {
        o->split[i] = pm_rng_normal(rng);
    }
    for (int j = 0; j < o->rank; ++j) {
        o->strength[j] = pm_rng_normal(rng);
    }
}

// Computes the shares of process j and its vector v_j as dissipation.h defines them; returns
// theta_j.
static double column_of(const operands *o, int j, double *v) {
    double share[MAX_HEATS] = {1}, sum = 1, power = 0, mean = 0, theta = 0;
    for (int k = 1; k < o->nheat; ++k) {
        share[k] = exp(o->split[j * (o->nheat - 1) + k - 1]);
        sum += share[k];
    }
    for (int k = 0; k < o->nheat; ++k) {
        share[k] /= sum;
        theta += share[k] / o->normal[o->heat[k]];
        mean += o->nheat > 1 ? (1 - share[k]) * o->normal[o->heat[k]] / (o->nheat - 1) : 0;
    }
    const double *u = o->factor + j * o->n;
    for (int c = 0; c < o->n; ++c) {
        int k;
        power += is_heat(o, c, &k) ? (o->nheat > 1 ? sqrt(mean) * u[c] : 0) : u[c] * o->normal[c];
    }
    for (int c = 0; c < o->n; ++c) {
        int k;
        const bool heat = is_heat(o, c, &k);
        const double carried = heat && o->nheat > 1 ? sqrt(mean) * u[c] : 0;
        v[c] = heat ? (carried - share[k] * power) / o->normal[c] : u[c];
    }
    return theta;
}

static void build_rate(const operands *o, double *rate) {
    pm_graph *g = NULL;
    pm_program *program = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node d = pm_input(g, true, 1, o->n), n = pm_input(g, true, 1, o->n);
    pm_dissipation dissipation = {
        .driving = d,
        .normal = n,
        .factor = pm_param(g, o->factor, o->rank, o->n),
        .nheat = o->nheat,
        .power = o->power == 0 ? PM_NO_NODE : pm_constant(g, o->power, 1, o->rank),
        .ratio_power =
            o->ratio_power == 0 ? PM_NO_NODE : pm_constant(g, o->ratio_power, 1, o->rank),
        .reference = pm_constant(g, 300, 1, 1),
        .warmth = PM_NO_NODE,
        .strength = pm_param(g, o->strength, 1, o->rank),
        .split = o->nheat > 1 ? pm_param(g, o->split, o->rank, o->nheat - 1) : PM_NO_NODE};
    memcpy(dissipation.heat, o->heat, sizeof o->heat);
    const pm_node out = pm_dissipation_build(g, &dissipation);
    assert_int_equal(pm_program_open(&program, g, 1, &out, 1), PM_OK);
    memcpy(pm_program_value(program, d), o->driving, (size_t)o->n * sizeof(double));
    memcpy(pm_program_value(program, n), o->normal, (size_t)o->n * sizeof(double));
    pm_program_run(program, 1);
    memcpy(rate, pm_program_value(program, out), (size_t)o->n * sizeof(double));
    pm_program_close(program);
    pm_graph_close(g);
}

// The rate is M dS with M = sum exp(strength) v v^T/theta, which is symmetric and positive
// semi-definite, and all v are orthogonal to dE.
static void operators_are_sums_of_squares_without_energy(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 20, 1);
    for (int trial = 0; trial < TRIALS; ++trial) {
        operands o;
        double rate[MAX_N], expected[MAX_N] = {0}, size = 0, energy = 0, gross = 0, entropy = 0;
        draw_operands(&o, &rng);
        build_rate(&o, rate);
        for (int j = 0; j < o.rank; ++j) {
            double v[MAX_N], drive = 0, product = 0, sum = 0;
            const double theta = column_of(&o, j, v);
            for (int c = 0; c < o.n; ++c) {
                drive += v[c] * o.driving[c];
                product += v[c] * o.normal[c];
                sum += fabs(v[c] * o.normal[c]);
            }
            assert_true(theta > 0 && fabs(product) <= ROUNDING * sum);
            for (int c = 0; c < o.n; ++c) {
                expected[c] += exp(o.strength[j]) * v[c] * drive / theta;
            }
        }
        for (int c = 0; c < o.n; ++c) {
            size += fabs(expected[c] * o.normal[c]);
            energy += rate[c] * o.normal[c];
            gross += fabs(rate[c] * o.normal[c]);
            entropy += rate[c] * o.driving[c];
        }
        for (int c = 0; c < o.n; ++c) {
            assert_true(fabs((rate[c] - expected[c]) * o.normal[c]) <= ROUNDING * (size + 1e-30));
        }
        assert_true(fabs(energy) <= ROUNDING * gross);
        assert_true(entropy >= -1e-15 * gross);
    }
}

// A factor of one constant process, and the rates that it must give.
static void check_law(const operands *o, const double *expected) {
    double rate[MAX_N];
    build_rate(o, rate);
    for (int c = 0; c < o->n; ++c) {
        assert_true(fabs(rate[c] - expected[c]) <= ROUNDING * (fabs(expected[c]) + 1e-6));
    }
}

// Friction of a momentum, relaxation of an inner variable or Joule heat: x' = -k f, s' = k f^2/T.
static void constant_friction_is_a_constant(void **state) {
    (void)state;
    const double T = 340, f = 0.7, k = 0.3;
    const operands o = {.n = 2,
                        .rank = 1,
                        .nheat = 1,
                        .heat = {1},
                        .driving = {0, 1},
                        .normal = {f, T},
                        .factor = {sqrt(k), 0}};
    check_law(&o, (double[]){-k * f, k * f * f / T});
}

// Friction by the difference of two flows at different temperatures: x_a' = -k (f_a - f_b), and
// both entropies take up equal parts of the heat.
static void friction_by_differences_is_a_constant(void **state) {
    (void)state;
    const double Ta = 310, Tb = 420, fa = 0.7, fb = -0.4, k = 0.3, r = sqrt(k);
    const double power = k * (fa - fb) * (fa - fb);
    const operands o = {.n = 4,
                        .rank = 1,
                        .nheat = 2,
                        .heat = {1, 3},
                        .driving = {0, 1, 0, 1},
                        .normal = {fa, Ta, fb, Tb},
                        .factor = {r, 0, -r, 0}};
    check_law(&o, (double[]){-k * (fa - fb), power / (2 * Ta), k * (fa - fb), power / (2 * Tb)});
}

// Conduction: the heat k (T_b - T_a) flows into a for any difference of temperatures. This is exact
// if the shares are equal.
static void conduction_is_a_constant(void **state) {
    (void)state;
    const double Ta = 310, Tb = 420, k = 0.3, r = sqrt(k);
    const operands o = {.n = 2,
                        .rank = 1,
                        .nheat = 2,
                        .heat = {0, 1},
                        .driving = {1, 1},
                        .normal = {Ta, Tb},
                        .factor = {r, -r}};
    check_law(&o, (double[]){k * (Tb - Ta) / Ta, k * (Ta - Tb) / Tb});
}

// Heat driven by a difference of 1/T has the exponents -2 of the mean temperature and 2 of the
// ratio of the means, exactly. Radiation has the exponents 3 and 2, to fourth order of the
// difference.
static void powers_of_temperature_are_constants(void **state) {
    (void)state;
    const double k = 0.3, r = sqrt(k);
    for (int i = 0; i < 2; ++i) {
        double error[2];
        for (int near = 0; near < 2; ++near) {
            const double difference = near ? 50 : 100, Ta = 400 - difference, Tb = 400 + difference;
            const operands o = {.n = 2,
                                .rank = 1,
                                .nheat = 2,
                                .heat = {0, 1},
                                .driving = {1, 1},
                                .normal = {Ta, Tb},
                                .factor = {r, -r},
                                .power = i == 0 ? -2 : 3,
                                .ratio_power = 2};
            const double heat = i == 0 ? k * 300 * 300 * (1 / Ta - 1 / Tb)
                                       : k * (pow(Tb, 4) - pow(Ta, 4)) / (4 * pow(300, 3));
            double rate[MAX_N];
            build_rate(&o, rate);
            error[near] = fabs(rate[0] * Ta - heat) / fabs(heat);
        }
        if (i == 0) {
            assert_true(error[0] < 1e-14 && error[1] < 1e-14);
        } else {
            assert_true(error[0] < 0.01 && error[1] < 0.08 * error[0]);
        }
    }
}

// --- whole systems ---

static const char two[] =
    "scene: two\n"
    "time: {dt: 0.01, steps: 20, integrator: rk4, substeps: 2}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: {m: {unit: kg m^2/s, size: 3}, s: {unit: J/K, size: 1}}}\n"
    "  b: {weights: b.h5, state: {m: {unit: kg m^2/s, size: 3}, s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  joint: {law: bracket, between: [a, b], weights: joint.h5, expose: {a: [m, s], b: [m, s]}}\n";

static void roll(random_system *w, double *z) {
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w->system), PM_OK);
    const double start[8] = {0.4, -0.3, 0.5, 0.01, -0.2, 0.6, 0.1, -0.02};
    pm_monolithic_set_state(assembly, start);
    for (int i = 0; i < 20; ++i) {
        assert_int_equal(pm_monolithic_step(assembly), PM_OK);
    }
    memcpy(z, pm_monolithic_sample(assembly)->z, 8 * sizeof *z);
    pm_monolithic_close(assembly);
}

// A rigid body moves equally with a cross product and with pairs of components, and friction by a
// difference acts equally as a given pair and as a learned factor with the same constant. The
// friction agrees with formulas.
static void couplings_agree_with_each_other(void **state) {
    (void)state;
    static const char energy[] =
        "energy: \"m[0]^2/2 + m[1]^2/3.2 + m[2]^2/4.6 + 150*(exp(s/0.5) - 1)\"\n"
        "entropy: {given: s}\n";
    char cross[512], components[512];
    snprintf(cross, sizeof cross, "%sreversible: {given: [[m, m, cross]]}\n", energy);
    snprintf(
        components, sizeof components,
        "%sreversible: {given: [[\"m[0]\", \"m[1]\", \"-m[2]\"], [\"m[0]\", \"m[2]\", \"m[1]\"], "
        "[\"m[1]\", \"m[2]\", \"-m[0]\"]]}\n",
        energy);
    static const char *const port[] = {
        "law: bracket\nirreversible: {given: [[a.m, b.m, 0.25], [a.s, b.s, "
        "\"0.04*b.dE.s/a.dE.s\"]]}\n",
        "law: bracket\nirreversible: {given: [[\"a.m[0]\", \"b.m[0]\", 0.25], [\"a.m[1]\", "
        "\"b.m[1]\", "
        "0.25], [\"a.m[2]\", \"b.m[2]\", 0.25], [a.s, b.s, \"0.04*b.dE.s/a.dE.s\"]], heats: [a.s, "
        "b.s]}\n",
        "law: bracket\nirreversible: {learned: {acts_on: [a.m, a.s, b.m, b.s], rank: 4, heats: "
        "[a.s, "
        "b.s]}}\n"};
    double z[3][8];
    for (int i = 0; i < 3; ++i) {
        random_system w;
        random_system_of_text(&w, 5, two, i == 1 ? components : cross, port[i]);
        pm_param_entry *scale = pm_params_find(&w.system->port[0]->params, "irreversible.scale");
        for (int c = 0; c < 8 && scale != NULL; ++c) {
            scale->value[c] = 1;
        }
        pm_param_entry *G =
            pm_params_find(&w.system->port[0]->params, "irreversible.matrix.constant");
        pm_param_entry *split = pm_params_find(&w.system->port[0]->params, "irreversible.split");
        pm_param_entry *power = pm_params_find(&w.system->port[0]->params, "irreversible.power");
        pm_param_entry *warmth = pm_params_find(&w.system->port[0]->params, PM_WARMTH);
        if (warmth != NULL) {
            *warmth->value = 0;
        }
        pm_param_entry *ratio =
            pm_params_find(&w.system->port[0]->params, "irreversible.ratio_power");
        for (int c = 0; c < 8 && i == 2; ++c) {
            for (int j = 0; j < 4; ++j) {
                const bool own = c % 4 == j;
                const double size = j < 3 ? 0.5 : 0.2;
                G->value[c * 4 + j] = own ? (c < 4 ? size : -size) : 0;
                split->value[j] = power->value[j] = ratio->value[j] = 0;
            }
        }
        roll(&w, z[i]);
        random_system_close(&w);
    }
    for (int c = 0; c < 8; ++c) {
        assert_true(fabs(z[1][c] - z[0][c]) < 1e-13);
        assert_true(fabs(z[2][c] - z[0][c]) < 1e-12);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(operators_are_sums_of_squares_without_energy),
        cmocka_unit_test(constant_friction_is_a_constant),
        cmocka_unit_test(friction_by_differences_is_a_constant),
        cmocka_unit_test(conduction_is_a_constant),
        cmocka_unit_test(powers_of_temperature_are_constants),
        cmocka_unit_test(couplings_agree_with_each_other),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
