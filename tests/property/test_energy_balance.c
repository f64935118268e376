// The energy balance beside rates (loss/loss_graph.c): it is the power of the data, a model's
// own rates fulfil it, and it shows the voltages of capacitors whose currents depend on differences
// of voltages.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fit/normalization.h"
#include "fit/start.h"
#include "graph/program.h"
#include "loss/objective.h"
#include "tests/support/runge_kutta.h"
#include "tests/support/training.h"
#include "tests/support/unit.h"

#define NZ 3
#define NTRAJECTORY 8
#define NTIME 60
#define DT 0.1

static const char *const columns[NZ] = {"q1", "q2", "s"};

static const char scene_text[] =
    "scene: bank\ntime: {dt: 0.1, steps: 59, integrator: rk4}\nsubsystems:\n"
    "  bank: {weights: bank.h5, state: {q: {unit: C, columns: [q1, q2]}, s: {unit: J/K, columns: "
    "[s]}}}\n";

// Two nonlinear capacitors with a resistor between them, a leak that is a hundred times as slow,
// and one temperature.
static void rates(const double *z, double *rate) {
    const double V1 = z[0] / 2 + 0.05 * pow(z[0], 3), V2 = z[1] + 0.1 * pow(z[1], 3);
    const double current = (V1 - V2) / 0.2, leak = V1 / 20, T = 300 * exp(z[2] / 5);
    rate[0] = -current - leak;
    rate[1] = current;
    rate[2] = (current * (V1 - V2) + leak * V1) / T;
}

static pm_dataset *make_data(void) {
    pm_dataset *data = NULL;
    assert_int_equal(pm_dataset_new(&data, NTRAJECTORY, NTIME, NZ, DT, columns), PM_OK);
    pm_rng rng;
    pm_rng_init(&rng, 3, 1);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        double z[NZ] = {6 * pm_rng_uniform(&rng) - 3, 4 * pm_rng_uniform(&rng) - 2,
                        0.5 * pm_rng_uniform(&rng) - 0.2};
        for (int j = 0; j < NTIME; ++j) {
            memcpy(pm_dataset_state(data, i, j), z, sizeof z);
            for (int k = 0; k < 20; ++k) {
                runge_kutta_step(NZ, rates, DT / 20, z);
            }
        }
    }
    return data;
}

// A training of one model with samples of rates, or of steps.
typedef struct bench {
    pm_training *training;
    pm_samples samples;
    pm_objective *objective;
    int size;
    double *theta; // [size] the first weights
} bench;

static void make_samples(bench *b, const pm_dataset *data, pm_residual residual) {
    assert_int_equal(
        pm_samples_make(&b->samples, b->training->scene, data, 0, NTRAJECTORY, residual, 1, 1),
        PM_OK);
}

static void bench_open(bench *b, const char *model, const char *loss, uint64_t seed) {
    char text[2048];
    snprintf(text, sizeof text,
             "scene: scene.yaml\nmodels:\n  bank:\n%ssubsystems: {bank: bank}\n"
             "start: {tries: 1}\nloss: %s\n"
             "stages: [{optimiser: gauss_newton, iterations: 1}]\n",
             model, loss);
    pm_dataset *data = make_data();
    double *work = calloc(10000, sizeof *work);
    assert_non_null(work);
    b->training = load_training(scene_text, text);
    b->training->seed = seed;
    make_samples(b, data, PM_RESIDUAL_STEP);
    pm_start_draw(b->training, 0, work);
    assert_int_equal(pm_normalization_of_system(b->training->system, &b->samples, false), PM_OK);
    pm_samples_free(&b->samples);
    make_samples(b, data, b->training->stage[0].loss.residual);
    assert_int_equal(pm_objective_open(&b->objective, b->training->system, &b->samples,
                                       &b->training->stage[0].loss),
                     PM_OK);
    b->size = pm_objective_size(b->objective);
    b->theta = work;
    pm_dataset_free(data);
}

static void bench_close(bench *b) {
    pm_objective_close(b->objective);
    pm_samples_free(&b->samples);
    pm_training_free(b->training);
    free(b->theta);
}

// --- the value ---

static const char known[] = "    energy: \"0.6*q[0]^2 + 0.25*q[1]^4 + 310*s + 20*s^2\"\n"
                            "    entropy: {given: s}\n"
                            "    irreversible: {learned: {acts_on: [q, s], rank: 2}}\n";

static void gradient_of_known(const double *z, double *dE) {
    dE[0] = 1.2 * z[0];
    dE[1] = pow(z[1], 3);
    dE[2] = 310 + 40 * z[2];
}

// Computes the balance of a window from its definition, with LEAST = 0.01.
static double balance_of(const pm_samples *s, const double *window) {
    double dE[NZ], power = 0, square = 0;
    gradient_of_known(window, dE);
    for (int c = 0; c < NZ; ++c) {
        const double weight = window[pm_samples_weights(s) + c];
        const double part = dE[c] * (window[NZ + c] - window[c]), typical = dE[c] * s->scale[c];
        power += part;
        square += part * part + typical * typical * (1 / (weight * weight) - 1 + 1e-4);
    }
    return power / sqrt(square);
}

// Runs the residuals of all samples. `row` [samples][NZ + 1] receives them.
static void run_residuals(const bench *b, double *row) {
    pm_graph *g = NULL;
    pm_program *program = NULL;
    pm_loss_nodes nodes;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    assert_int_equal(pm_loss_graph_build(g, b->training->system, &b->samples,
                                         &b->training->stage[0].loss, &nodes),
                     PM_OK);
    assert_int_equal(pm_graph_shape(g, nodes.residual).cols, NZ + 1);
    assert_int_equal(pm_program_open(&program, g, 1, &nodes.residual, b->samples.count), PM_OK);
    const size_t width = (size_t)pm_samples_width(&b->samples);
    memcpy(pm_program_value(program, nodes.input), b->samples.z,
           (size_t)b->samples.count * width * sizeof *row);
    pm_program_run(program, b->samples.count);
    memcpy(row, pm_program_value(program, nodes.residual),
           (size_t)b->samples.count * (NZ + 1) * sizeof *row);
    pm_program_close(program);
    pm_graph_close(g);
}

static void balance_is_the_power_of_the_data(void **state) {
    (void)state;
    static double row[NTRAJECTORY * NTIME][NZ + 1];
    bench b;
    double largest = 0;
    bench_open(&b, known, "{residual: derivative, balance: 4}", 1);
    run_residuals(&b, row[0]);
    for (int i = 0; i < b.samples.count; ++i) {
        const double *window = b.samples.z + (ptrdiff_t)i * pm_samples_width(&b.samples);
        const double expected = 2 * balance_of(&b.samples, window);
        largest = fmax(largest, fabs(expected));
        if (!(fabs(row[i][NZ] - expected) < 1e-6)) {
            fail_msg("sample %d: balance %.12g, expected %.12g", i, row[i][NZ], expected);
        }
    }
    assert_true(largest > 0.1); // this energy is not that of the data
    bench_close(&b);
}

// A model conserves energy with any weights: the balance is zero where its rates are those of the
// data.
static void rates_of_the_model_are_balanced(void **state) {
    (void)state;
    static double row[NTRAJECTORY * NTIME][NZ + 1];
    bench b;
    bench_open(&b, known, "{residual: derivative, balance: 1}", 2);
    run_residuals(&b, row[0]);
    for (int i = 0; i < b.samples.count; ++i) {
        double *window = b.samples.z + (ptrdiff_t)i * pm_samples_width(&b.samples);
        for (int c = 0; c < NZ; ++c) {
            const double weight = window[pm_samples_weights(&b.samples) + c];
            window[NZ + c] += row[i][c] * b.samples.scale[c] / weight;
        }
    }
    run_residuals(&b, row[0]);
    for (int i = 0; i < b.samples.count; ++i) {
        if (!(fabs(row[i][NZ]) < 1e-9)) {
            fail_msg("sample %d: balance %g of the model's own rates", i, row[i][NZ]);
        }
    }
    bench_close(&b);
}

// --- where there is one ---

static int count_residuals(const char *model, const char *loss) {
    bench b;
    bench_open(&b, model, loss, 1);
    const int count = pm_objective_residual_count(b.objective);
    bench_close(&b);
    return count;
}

static void rates_of_hard_models_have_a_balance(void **state) {
    (void)state;
    const char *soft = "    form: soft\n    energy: {features: [q, s], skip: quadratic}\n"
                       "    entropy: {given: s}\n"
                       "    irreversible: {learned: {acts_on: [q, s]}}\n";
    assert_int_equal(count_residuals(soft, "{residual: derivative}"), NZ);
    assert_int_equal(count_residuals(known, "{residual: derivative}"), NZ + 1);
    assert_int_equal(count_residuals(known, "{residual: derivative, balance: 0}"), NZ);
    assert_int_equal(count_residuals(known, "{residual: step}"), NZ);
}

// Nothing is divided by zero if the gradient of the energy is zero.
static void zero_energies_are_allowed(void **state) {
    (void)state;
    bench b;
    bench_open(&b,
               "    constants: {k: {learned: 0.0}}\n    energy: \"k*|q|^2\"\n"
               "    reversible: {learned: {acts_on: [q]}}\n",
               "{residual: derivative}", 1);
    double *gradient = calloc((size_t)b.size, sizeof *gradient);
    assert_non_null(gradient);
    const double loss = pm_objective_evaluate(b.objective, 0, NULL, gradient);
    assert_true(isfinite(loss) && loss > 0);
    for (int i = 0; i < b.size; ++i) {
        assert_true(isfinite(gradient[i]));
    }
    free(gradient);
    bench_close(&b);
}

// --- what it is for ---

// The loss of the data's own model, where all voltages are higher by `excess` V and the leak has
// this conductance.
static double loss_of(double excess, double conductance, const char *loss) {
    char model[1024];
    snprintf(model, sizeof model,
             "    energy: \"%.17g*(q[0] + q[1]) + q[0]^2/4 + 0.0125*q[0]^4 + q[1]^2/2 + "
             "0.025*q[1]^4 + 1500*exp(s/5)\"\n"
             "    entropy: {given: s}\n"
             "    irreversible: {given: [[\"q[0]\", \"q[1]\", 5.0], [\"q[0]\", s, "
             "\"%.17g*dE.s\"]], learned: {acts_on: [q, s]}}\n",
             excess, conductance);
    bench b;
    bench_open(&b, model, loss, 1);
    pm_param_entry *factor =
        pm_params_find(pm_system_params(b.training->system, 0), "irreversible.matrix.constant");
    memset(factor->value, 0, (size_t)(factor->rows * factor->cols) * sizeof *factor->value);
    const double value = pm_objective_evaluate(b.objective, 0, NULL, NULL);
    bench_close(&b);
    return value;
}

// Voltages that are too high by far hardly change the currents if the leak is closed.
static void balance_shows_voltages(void **state) {
    (void)state;
    const char *with = "{residual: derivative, balance: 1}",
               *without = "{residual: derivative, balance: 0}";
    const double exact = loss_of(0, 0.05, with), closed = loss_of(10, 0, without),
                 seen = loss_of(10, 0, with);
    if (!(exact < 1e-7 && closed < 1e-3 && seen > 100 * closed)) {
        fail_msg("losses %g of the true model, %g and %g of the wrong one", exact, closed, seen);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(balance_is_the_power_of_the_data),
        cmocka_unit_test(rates_of_the_model_are_balanced),
        cmocka_unit_test(rates_of_hard_models_have_a_balance),
        cmocka_unit_test(zero_energies_are_allowed),
        cmocka_unit_test(balance_shows_voltages),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
