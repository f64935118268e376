// The input of training: windows cut from trajectories, and the constants that are fixed before it.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "data/samples.h"
#include "fit/defaults.h"
#include "fit/fit.h"
#include "fit/fold_tangent.h"
#include "fit/normalization.h"
#include "graph/program.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define NTRAJECTORY 3
#define NTIME 9
#define DT 0.1

static const char scene[] =
    "scene: one\n"
    "time: {dt: 0.1, steps: 1, integrator: euler}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: {q: {unit: m, columns: [x, y]}, s: {unit: J, columns: [s]}}}\n";
static const char part[] =
    "energy: {features: [\"|q|^2\", s], hidden: [2]}\n"
    "entropy: {given: s}\n"
    "reversible: {learned: {acts_on: [q, s], along: [q], features: [\"|q|\"], hidden: [2]}}\n";
static const char *const columns[] = {"s", "y", "x"};

// Polynomials of degree 4 in time, for which differences of fourth order are exact.
static double value_at(int trajectory, int column, double t) {
    const double a = 1 + trajectory, b = 0.5 * column - 1;
    return a + b * t + a * t * t - b * t * t * t + 0.3 * a * b * t * t * t * t;
}

static double slope_at(int trajectory, int column, double t) {
    const double a = 1 + trajectory, b = 0.5 * column - 1;
    return b + 2 * a * t - 3 * b * t * t + 1.2 * a * b * t * t * t;
}

typedef struct bench {
    random_system w;
    pm_dataset *data;
} bench;

static void bench_open(bench *b) {
    random_system_of_text(&b->w, 1, scene, part, NULL);
    assert_int_equal(pm_dataset_new(&b->data, NTRAJECTORY, NTIME, 3, DT, columns), PM_OK);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        for (int j = 0; j < NTIME; ++j) {
            for (int k = 0; k < 3; ++k) {
                pm_dataset_state(b->data, i, j)[k] = value_at(i, k, j * DT);
            }
        }
    }
}

static void bench_close(bench *b) {
    pm_dataset_free(b->data);
    random_system_close(&b->w);
}

static void make(const bench *b, pm_samples *samples, pm_residual residual, int unroll) {
    if (pm_samples_make(samples, b->w.scene, b->data, 1, 3, residual, unroll,
                        PM_BOUNDARY_INPUT_ORDER) != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

// Takes trajectories 1 and 2, with columns in the order x, y, s of the scene.
static void windows_are_cut_in_order(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    bench_open(&b);
    make(&b, &samples, PM_RESIDUAL_STEP, 3);
    const int per_trajectory = NTIME - 3;
    assert_int_equal(samples.count, 2 * per_trajectory);
    for (int i = 0; i < samples.count; ++i) {
        for (int k = 0; k < 4 * 3; ++k) {
            const double t = (i % per_trajectory + k / 3) * DT;
            random_system_check(&b.w, "window", samples.z[i * 12 + k],
                                value_at(1 + i / per_trajectory, 2 - k % 3, t), 0);
        }
    }
    // The root mean square of the increments, pooled over x and y.
    double square[2] = {0, 0};
    for (int i = 0; i < samples.count; ++i) {
        for (int c = 0; c < 3; ++c) {
            const double d = samples.z[i * 12 + 3 + c] - samples.z[i * 12 + c];
            square[c / 2] += d * d / samples.count;
        }
    }
    random_system_check(&b.w, "scale of x", samples.scale[0], sqrt(square[0] / 2), 1e-15);
    random_system_check(&b.w, "scale of y", samples.scale[1], samples.scale[0], 0);
    random_system_check(&b.w, "scale of s", samples.scale[2], sqrt(square[1]), 1e-15);
    pm_samples_free(&samples);
    bench_close(&b);
}

// Checks the rates of all samples, of which every trajectory has `per_trajectory` behind its first
// `margin` states.
static void check_rates(const bench *b, const pm_samples *samples, int first, int margin,
                        int per_trajectory) {
    for (int i = 0; i < samples->count; ++i) {
        for (int c = 0; c < 3; ++c) {
            const double *z = samples->z + (ptrdiff_t)i * pm_samples_width(samples);
            const double t = (i % per_trajectory + margin) * DT;
            random_system_check(&b->w, "derivative", (z[3 + c] - z[c]) / DT,
                                slope_at(first + i / per_trajectory, 2 - c, t), 1e-11);
        }
    }
}

static void derivatives_of_polynomials_are_exact(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    bench_open(&b);
    make(&b, &samples, PM_RESIDUAL_DERIVATIVE, 7);
    assert_int_equal(samples.unroll, 1);
    assert_int_equal(samples.count, 2 * (NTIME - 1)); // the first states, too
    check_rates(&b, &samples, 1, 0, NTIME - 1);
    pm_samples_free(&samples);
    bench_close(&b);
}

// The polynomials are of degree 4, so that five states determine them.
static void short_trajectories_have_rates(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    bench_open(&b);
    b.data->ntime = 5;
    assert_int_equal(
        pm_samples_make(&samples, b.w.scene, b.data, 0, 1, PM_RESIDUAL_DERIVATIVE, 1, 1), PM_OK);
    assert_int_equal(samples.count, 3);
    check_rates(&b, &samples, 0, 1, 3);
    pm_samples_free(&samples);
    b.data->ntime = 3;
    assert_int_equal(
        pm_samples_make(&samples, b.w.scene, b.data, 0, 1, PM_RESIDUAL_DERIVATIVE, 1, 1), PM_OK);
    assert_int_equal(samples.count, 2);
    pm_samples_free(&samples);
    bench_close(&b);
}

// A jump in one variable of a trajectory makes its rates there uncertain, and no others. The
// central difference is more accurate than one-sided ones, and the weight of the same error is
// larger.
static void uncertain_rates_have_small_weights(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    bench_open(&b);
    pm_dataset_state(b.data, 1, 0)[1] += 1;
    make(&b, &samples, PM_RESIDUAL_DERIVATIVE, 1);
    assert_true(samples.weighted);
    for (int i = 0; i < samples.count; ++i) {
        const double *weight =
            samples.z + (ptrdiff_t)i * pm_samples_width(&samples) + pm_samples_weights(&samples);
        for (int c = 0; c < 3; ++c) {
            const bool jumps = i < NTIME - 1 && c == 1;
            const double most = i == NTIME / 2 ? 0.05 : 0.005;
            random_system_check(&b.w, "weight", weight[c], jumps ? 0 : 1, jumps ? most : 1e-9);
        }
    }
    pm_samples_free(&samples);
    make(&b, &samples, PM_RESIDUAL_STEP, 1);
    assert_false(samples.weighted);
    pm_samples_free(&samples);
    bench_close(&b);
}

// Rates of the dataset replace differences at every state but the last, where boundary inputs end.
static void rates_of_the_data_are_taken(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    bench_open(&b);
    assert_int_equal(pm_dataset_with_rates(b.data), PM_OK);
    for (int i = 0; i < NTRAJECTORY * NTIME * 3; ++i) {
        b.data->zdot[i] = i;
    }
    make(&b, &samples, PM_RESIDUAL_DERIVATIVE, 1);
    assert_int_equal(samples.count, 2 * (NTIME - 1));
    const double *z = samples.z + 6 * (ptrdiff_t)(NTIME - 1); // trajectory 2, time 0
    random_system_check(&b.w, "rate of s", (z[5] - z[2]) / DT, 2 * NTIME * 3, 1e-9);
    const double given[] = {0, 7, 0};
    const double before = samples.scale[0];
    pm_samples_rescale(&samples, given);
    random_system_check(&b.w, "given scale", samples.scale[1], 7, 0);
    random_system_check(&b.w, "kept scale", samples.scale[0], before, 0);
    pm_samples_free(&samples);
    bench_close(&b);
}

static void too_short_is_an_error(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    bench_open(&b);
    assert_int_equal(pm_samples_make(&samples, b.w.scene, b.data, 0, 3, PM_RESIDUAL_STEP, NTIME, 1),
                     PM_EDATA);
    assert_int_equal(pm_samples_make(&samples, b.w.scene, b.data, 2, 2, PM_RESIDUAL_STEP, 1, 1),
                     PM_EDATA);
    b.data->ntime = 1;
    assert_int_equal(
        pm_samples_make(&samples, b.w.scene, b.data, 0, 3, PM_RESIDUAL_DERIVATIVE, 1, 1), PM_EDATA);
    bench_close(&b);
}

// --- constants ---

static const double *constant(const bench *b, const char *name) {
    const pm_param_entry *entry = pm_params_find(&b->w.system->part[0]->params, name);
    assert_non_null(entry);
    assert_false(entry->trained);
    return entry->value;
}

static void constants_are_the_statistics_of_the_data(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    bench_open(&b);
    make(&b, &samples, PM_RESIDUAL_STEP, 1);
    assert_int_equal(pm_normalization_of_system(b.w.system, &samples, true), PM_OK);
    double mean = 0, square = 0, length = 0, q2 = 0, s2 = 0;
    for (int i = 0; i < samples.count; ++i) {
        const double *z = samples.z + (ptrdiff_t)i * 6;
        const double f = z[0] * z[0] + z[1] * z[1];
        mean += f / samples.count;
        square += f * f / samples.count;
        length += sqrt(f) / samples.count;
        q2 += f / (2 * samples.count);
        s2 += z[2] * z[2] / samples.count;
    }
    const double deviation = sqrt(square - mean * mean), tolerance = 1e-12 * mean;
    random_system_check(&b.w, "mean of |q|^2", constant(&b, "energy.0.mean")[0], mean, tolerance);
    random_system_check(&b.w, "deviation", constant(&b, "energy.0.deviation")[0], deviation,
                        tolerance);
    random_system_check(&b.w, "mean of |q|", constant(&b, "reversible.matrix.mean")[0], length,
                        tolerance);
    random_system_check(&b.w, "length of q", constant(&b, "reversible.along")[0], sqrt(2 * q2),
                        tolerance);
    const double *scale = constant(&b, "reversible.scale");
    random_system_check(&b.w, "scale x / scale y", scale[0] / scale[1], 1, 0);
    random_system_check(&b.w, "scale q / scale s", scale[0] / scale[2], sqrt(q2 / s2), 1e-12);
    pm_samples_free(&samples);
    bench_close(&b);
}

// --- boundary inputs ---

static const char loaded[] =
    "scene: one\n"
    "time: {dt: 0.1, steps: 1, integrator: euler}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: {q: {unit: m, columns: [x, y]}, s: {unit: J, columns: [s]}}}\n"
    "boundary_inputs: {bath: {s: {unit: J, dE: x, dS: 1}}}\n"
    "ports: {base: {law: bracket, between: [bath, a], expose: {bath: s, a: [s, q]}, weights: "
    "base.h5}}\n";
static const char bath[] =
    "law: bracket\n"
    "irreversible: {learned: {acts_on: [a.s, b.s, b.q], features: [a.dE.s], hidden: [2]}}\n";

static void loaded_open(bench *b) {
    bench_open(b);
    random_system_close(&b->w);
    random_system_of_text(&b->w, 1, loaded, part, bath);
}

// After its states a window holds the polynomials of the boundary inputs over its steps.
static void windows_carry_their_loads(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    loaded_open(&b);
    make(&b, &samples, PM_RESIDUAL_STEP, 3);
    assert_true(samples.nboundary_input == 3 && samples.count == 2 * (NTIME - 3));
    assert_int_equal(pm_samples_width(&samples), 4 * 3 + 3 * PM_BOUNDARY_INPUT_ORDER * 3);
    for (int i = 0; i < samples.count; ++i) {
        const int trajectory = 1 + i / (NTIME - 3), first = i % (NTIME - 3);
        for (int step = 0; step < 3; ++step) {
            const double *boundary_input = samples.z + (ptrdiff_t)i * pm_samples_width(&samples) +
                                           pm_samples_input(&samples, step);
            double middle = 0; // of dE
            for (int k = PM_BOUNDARY_INPUT_ORDER - 1; k >= 0; --k) {
                middle = 0.5 * middle + boundary_input[3 * k + 1];
            }
            random_system_check(&b.w, "temperature", middle,
                                value_at(trajectory, 2, (first + step + 0.5) * DT), 1e-12);
            assert_true(boundary_input[2] == 1 && boundary_input[5] == 0);
        }
    }
    pm_samples_free(&samples);
    // With input order 1 it holds only their values at the beginning of each step.
    assert_int_equal(pm_samples_make(&samples, b.w.scene, b.data, 1, 3, PM_RESIDUAL_STEP, 3, 1),
                     PM_OK);
    assert_int_equal(pm_samples_width(&samples), 4 * 3 + 3 * 3);
    assert_int_equal(pm_samples_left_out(&samples), 3 * 3 * (PM_BOUNDARY_INPUT_ORDER - 1));
    for (int step = 0; step < 3; ++step) {
        const double *boundary_input = samples.z + pm_samples_input(&samples, step);
        random_system_check(&b.w, "at its beginning", boundary_input[1], value_at(1, 2, step * DT),
                            1e-12);
        assert_true(boundary_input[2] == 1);
    }
    pm_samples_free(&samples);
    make(&b, &samples, PM_RESIDUAL_DERIVATIVE, 1);
    const double *boundary_input = samples.z + pm_samples_input(&samples, 0);
    random_system_check(&b.w, "at the derivative's state", boundary_input[1],
                        value_at(1, 2, 2 * DT), 1e-12);
    pm_samples_free(&samples);
    bench_close(&b);
}

// A boundary input without a state gets the scale of the group of the same name in the subsystem.
static void boundary_inputs_scale_like_the_subsystem(void **state) {
    (void)state;
    bench b;
    pm_samples samples;
    loaded_open(&b);
    make(&b, &samples, PM_RESIDUAL_STEP, 1);
    assert_int_equal(pm_normalization_of_system(b.w.system, &samples, true), PM_OK);
    double q2 = 0, s2 = 0, temperature = 0;
    for (int i = 0; i < samples.count; ++i) {
        const double *z = samples.z + (ptrdiff_t)i * pm_samples_width(&samples);
        q2 += (z[0] * z[0] + z[1] * z[1]) / 2;
        s2 += z[2] * z[2];
        temperature += z[0] / samples.count; // the bath follows column x
    }
    const pm_params *params = &b.w.system->port[0]->params;
    const double *scale = pm_params_find(params, "irreversible.scale")->value;
    random_system_check(&b.w, "scale a.s / scale b.s", scale[0] / scale[1], 1, 0);
    random_system_check(&b.w, "scale b.q / scale b.s", scale[2] / scale[1], sqrt(q2 / s2), 1e-12);
    random_system_check(&b.w, "mean of the bath's temperature",
                        pm_params_find(params, "irreversible.matrix.mean")->value[0], temperature,
                        1e-12);
    pm_samples_free(&samples);
    bench_close(&b);
}

// Computes energy and entropy of the part at q = (x, -x), s = x.
static void potentials_at(const pm_part *p, double x, double value[2]) {
    pm_graph *g = NULL;
    pm_program *program = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z = pm_input(g, true, 1, 3);
    const pm_node out[2] = {pm_part_energy(g, p, z), pm_part_entropy(g, p, z)};
    assert_int_equal(pm_program_open(&program, g, 2, out, 1), PM_OK);
    memcpy(pm_program_value(program, z), (const double[]){x, -x, x}, 3 * sizeof x);
    pm_program_run(program, 1);
    for (int i = 0; i < 2; ++i) {
        value[i] = *pm_program_value(program, out[i]);
    }
    pm_program_close(program);
    pm_graph_close(g);
}

// A network with its tangent folded in is the same function and is no longer marked zero_at_origin.
static void settled_networks_are_the_same(void **state) {
    (void)state;
    static const char resting[] =
        "energy:\n"
        "  - {features: [s], hidden: [2], skip: linear}\n"
        "  - {features: [q, s], hidden: [3], skip: linear, zero_at_origin: true}\n"
        "  - {features: [q], hidden: [2, 2], skip: quadratic, zero_at_origin: true}\n"
        "entropy: {features: [s, q], hidden: [2], skip: linear, zero_at_origin: true}\n";
    random_system w;
    pm_arena arena = {0};
    random_system_of_text(&w, 3, scene, resting, NULL);
    pm_part *p = w.system->part[0];
    for (int i = 0; i < p->params.count; ++i) {
        pm_param_entry *e = &p->params.entry[i];
        for (int k = 0; k < e->rows * e->cols; ++k) {
            e->value[k] += 0.3 + 0.1 * ((i + k) % 5); // means, deviations and biases too
        }
    }
    double before[4][2], after[2];
    for (int i = 0; i < 4; ++i) {
        potentials_at(p, 0.7 * i - 1, before[i]);
    }
    assert_int_equal(pm_fold_tangent(p, &arena), PM_OK);
    for (int i = 0; i < 4; ++i) {
        potentials_at(p, 0.7 * i - 1, after);
        random_system_check(&w, "energy", after[0], before[i][0], 1e-12);
        random_system_check(&w, "entropy", after[1], before[i][1], 1e-12);
    }
    for (int i = 0; i < 3; ++i) {
        assert_false(p->spec.energy.term[i].zero_at_origin);
    }
    assert_false(p->spec.entropy.term[0].zero_at_origin);
    pm_arena_free(&arena);
    random_system_close(&w);
}

// Each thing that is compared can only lower the verdict, and says why.
static void every_comparison_can_spoil_the_verdict(void **state) {
    (void)state;
    static const struct {
        double value, good, fair;
        pm_grade grade;
    } rows[] = {
        {0.01, 0.05, 0.3, PM_GRADE_GOOD},     {NAN, 0.05, 0.3, PM_GRADE_GOOD}, // not compared
        {0.44, 0.3, INFINITY, PM_GRADE_FAIR}, {0.1, 0.05, 0.3, PM_GRADE_FAIR},
        {0.4, 0.05, 0.3, PM_GRADE_POOR},      {0.1, 0.05, 0.3, PM_GRADE_POOR}}; // stays poor
    pm_verdict v = {.count = 0};
    int reasons = 0;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; ++i) {
        pm_verdict_compare(&v, rows[i].value, rows[i].good, rows[i].fair, "reason %d", (int)i);
        reasons += !(rows[i].value < rows[i].good) && !isnan(rows[i].value);
        assert_int_equal(v.grade, rows[i].grade);
        assert_int_equal(v.count, reasons);
    }
    assert_string_equal(v.reason[2], "reason 4");
}

// Each component of an entropy is a body with a temperature of its own, so that the energy is a sum
// over components (`separate`). An entropy of one component needs no such sum.
static void components_of_an_entropy_are_bodies_of_their_own(void **state) {
    (void)state;
    static const char *const feature[] = {"s"};
    for (int size = 1; size <= 5; size += 4) {
        pm_group group;
        pm_layout layout = {.group = &group};
        pm_layout_add(&layout, "s", "J/K", size);
        const pm_network_spec term = {.nfeature = 1, .feature = feature};
        pm_part_spec spec = {.energy = {.nterm = 1, .term = &term},
                             .entropy = {.ngiven = 1, .given = feature}};
        pm_arena arena = {0};
        assert_int_equal(pm_default_part(&spec, &layout, &arena), PM_OK);
        assert_int_equal(spec.energy.term[0].nthermal, 1);
        assert_int_equal(spec.energy.term[0].separate, size > 1);
        pm_arena_free(&arena);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(components_of_an_entropy_are_bodies_of_their_own),
        cmocka_unit_test(windows_are_cut_in_order),
        cmocka_unit_test(derivatives_of_polynomials_are_exact),
        cmocka_unit_test(short_trajectories_have_rates),
        cmocka_unit_test(uncertain_rates_have_small_weights),
        cmocka_unit_test(rates_of_the_data_are_taken),
        cmocka_unit_test(too_short_is_an_error),
        cmocka_unit_test(constants_are_the_statistics_of_the_data),
        cmocka_unit_test(windows_carry_their_loads),
        cmocka_unit_test(boundary_inputs_scale_like_the_subsystem),
        cmocka_unit_test(settled_networks_are_the_same),
        cmocka_unit_test(every_comparison_can_spoil_the_verdict),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
