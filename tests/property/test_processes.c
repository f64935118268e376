// Learned irreversible processes are separated (fit/dissipative_modes.h): the rotation makes
// factors simple, and rates stay the same; the strengths of processes are fitted when the initial
// weights have been chosen.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fit/dissipative_modes.h"
#include "fit/normalization.h"
#include "fit/start.h"
#include "graph/program.h"
#include "loss/objective.h"
#include "tests/support/training.h"
#include "tests/support/unit.h"

#define ROWS 7
#define RANK 3
#define NTRAJECTORY 5
#define NTIME 20
#define NZ 6
#define DT 0.1

static void random_rotation(pm_rng *rng, int rows, int rank, double *factor) {
    for (int j = 0; j < rank; ++j) {
        for (int k = j + 1; k < rank; ++k) {
            const double angle = 6 * pm_rng_uniform(rng), c = cos(angle), s = sin(angle);
            for (int i = 0; i < rows; ++i) {
                double *row = factor + (ptrdiff_t)i * rank;
                const double x = row[j], y = row[k];
                row[j] = c * x - s * y;
                row[k] = s * x + c * y;
            }
        }
    }
}

// Each row of the original factor has one entry. Rows differ in size by a factor of 1e4.
static void rotations_make_factors_simple(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 20; ++seed) {
        pm_rng rng;
        pm_rng_init(&rng, seed, 0);
        double factor[ROWS * RANK] = {0}, guide[ROWS * RANK], product[ROWS][ROWS] = {{0}};
        for (int i = 0; i < ROWS; ++i) {
            factor[i * RANK + i % RANK] = pow(10, 4 * pm_rng_uniform(&rng) - 2);
        }
        random_rotation(&rng, ROWS, RANK, factor);
        for (int i = 0; i < ROWS * ROWS * RANK; ++i) {
            product[i / RANK / ROWS][i / RANK % ROWS] += factor[i / RANK / ROWS * RANK + i % RANK] *
                                                         factor[i / RANK % ROWS * RANK + i % RANK];
        }
        memcpy(guide, factor, sizeof guide);
        pm_dissipative_modes_rotate(ROWS, RANK, guide, factor);
        assert_memory_equal(guide, factor, sizeof guide);
        for (int i = 0; i < ROWS * ROWS * RANK; ++i) {
            product[i / RANK / ROWS][i / RANK % ROWS] -= factor[i / RANK / ROWS * RANK + i % RANK] *
                                                         factor[i / RANK % ROWS * RANK + i % RANK];
        }
        for (int i = 0; i < ROWS; ++i) {
            double sum = 0, largest = 0;
            for (int j = 0; j < RANK; ++j) {
                sum += fabs(factor[i * RANK + j]);
                largest = fmax(largest, fabs(factor[i * RANK + j]));
            }
            assert_true(sum - largest < 1e-9 * largest);
            for (int k = 0; k < ROWS; ++k) {
                assert_true(fabs(product[i][k]) < 1e-12 * 1e4);
            }
        }
    }
}

// Opens a training of two bodies and a port between them, with constant factors. Each body has two
// dissipative variables and an entropy.
static pm_training *open_training_with(const char *groups) {
    static const char scene_text[] =
        "scene: two\ntime: {dt: 0.1, steps: 19, integrator: rk4}\nsubsystems:\n"
        "  a: {weights: a.h5, state: {p: {unit: kg m/s, columns: [p1]}, e: {unit: m, columns: "
        "[e1]}, s: {unit: J/K, columns: [s1]}}}\n"
        "  b: {weights: b.h5, state: {p: {unit: kg m/s, columns: [p2]}, e: {unit: m, columns: "
        "[e2]}, s: {unit: J/K, columns: [s2]}}}\nports:\n"
        "  j: {law: bracket, between: [a, b], weights: j.h5, expose: {a: [p, s], b: [p, s]}}\n";
    char training_text[1024];
    snprintf(
        training_text, sizeof training_text,
        "scene: scene.yaml\nmodels:\n  part:\n"
        "    energy: {features: [p, e, s], skip: quadratic}\n    entropy: {given: s}\n"
        "    irreversible: {learned: {acts_on: [p, e, s], rank: 2, strength: {features: [p, e, s], "
        "hidden: [3]}}}\n"
        "  port:\n    law: bracket\n"
        "    irreversible: {learned: {%s}}\n"
        "subsystems: {a: part, b: part}\nports: {j: port}\nstart: {tries: 2, iterations: 3}\n",
        groups);
    return load_training(scene_text, training_text);
}

static pm_training *open_training(void) {
    return open_training_with("acts_on: [a.p, a.s, b.p, b.s], rank: 3");
}

// Makes samples of smooth curves that solve no system's equations.
static void make_samples(const pm_training *t, pm_residual residual, pm_samples *samples) {
    static const char *const columns[NZ] = {"p1", "e1", "s1", "p2", "e2", "s2"};
    pm_dataset *data = NULL;
    assert_int_equal(pm_dataset_new(&data, NTRAJECTORY, NTIME, NZ, DT, columns), PM_OK);
    for (int i = 0; i < NTRAJECTORY * NTIME * NZ; ++i) {
        const int trajectory = i / NZ / NTIME, time = i / NZ % NTIME, c = i % NZ;
        pm_dataset_state(data, trajectory, time)[c] =
            (c % 3 == 2 ? 0.02 : 1) * sin(trajectory + 0.7 * c + (1 + 0.1 * c) * DT * time);
    }
    assert_int_equal(pm_samples_make(samples, t->scene, data, 0, NTRAJECTORY, residual, 1, 1),
                     PM_OK);
    pm_dataset_free(data);
}

// Copies the factors of all three components, 4 + 4 + 12 entries.
static void copy_factors(const pm_training *t, double *factor) {
    for (int i = 0; i < 3; ++i) {
        const pm_param_entry *entry =
            pm_params_find(pm_system_params(t->system, i), "irreversible.matrix.constant");
        assert_int_equal(entry->rows * entry->cols, i < 2 ? 4 : 12);
        memcpy(factor, entry->value, (size_t)(entry->rows * entry->cols) * sizeof *factor);
        factor += entry->rows * entry->cols;
    }
}

static double largest_difference(const double *x, const double *y, int count) {
    double largest = 0;
    for (int i = 0; i < count; ++i) {
        largest = fmax(largest, fabs(x[i] - y[i]));
    }
    return largest;
}

static void rates_stay_the_same(void **state) {
    (void)state;
    pm_training *t = open_training();
    pm_samples samples;
    double theta[200], before[20], after[20];
    make_samples(t, PM_RESIDUAL_STEP, &samples);
    pm_start_draw(t, 0, theta);
    assert_int_equal(pm_normalization_of_system(t->system, &samples, false), PM_OK);
    pm_samples_free(&samples);
    make_samples(t, PM_RESIDUAL_DERIVATIVE, &samples);
    pm_objective *objective = NULL;
    assert_int_equal(pm_objective_open(&objective, t->system, &samples, &t->stage[0].loss), PM_OK);
    const double loss = pm_objective_evaluate(objective, 0, NULL, NULL);
    copy_factors(t, before);
    assert_int_equal(pm_dissipative_modes_separate(t->system), PM_OK);
    copy_factors(t, after);
    const double same = pm_objective_evaluate(objective, 0, NULL, NULL);
    if (!(fabs(same - loss) < 1e-12 * loss)) {
        fail_msg("the loss was %.17g and is %.17g", loss, same);
    }
    assert_true(largest_difference(before, after, 4) > 1e-3);
    assert_true(largest_difference(before + 8, after + 8, 12) > 1e-3);
    // Processes of different strengths stay as they are.
    pm_params_find(pm_system_params(t->system, 2), "irreversible.power")->value[0] = 0.1;
    random_rotation(
        &(pm_rng){0}, 4, 3,
        pm_params_find(pm_system_params(t->system, 2), "irreversible.matrix.constant")->value);
    copy_factors(t, before);
    assert_int_equal(pm_dissipative_modes_separate(t->system), PM_OK);
    copy_factors(t, after);
    assert_memory_equal(before + 8, after + 8, 12 * sizeof *before);
    pm_objective_close(objective);
    pm_samples_free(&samples);
    pm_training_free(t);
}

// Copies the weights of all three components, and returns their number.
static int gather(const pm_training *t, double *theta) {
    double *next = theta;
    for (int i = 0; i < 3; ++i) {
        pm_params_gather(pm_system_params(t->system, i), next);
        next += pm_params_trained(pm_system_params(t->system, i));
    }
    return (int)(next - theta);
}

static void strengths_follow_the_choice_of_initial_weights(void **state) {
    (void)state;
    static const volatile sig_atomic_t stop = 0;
    pm_training *t = open_training();
    pm_samples samples;
    double declared[200], theta[200], loss = INFINITY;
    (void)gather(t, declared);
    make_samples(t, PM_RESIDUAL_STEP, &samples);
    pm_start_draw(t, 0, theta);
    assert_int_equal(pm_normalization_of_system(t->system, &samples, false), PM_OK);
    pm_samples_free(&samples);
    make_samples(t, PM_RESIDUAL_DERIVATIVE, &samples);
    assert_int_equal(pm_start_search(t, &samples, t->seed, declared, theta, &loss, &stop), PM_OK);
    assert_true(loss < 1);
    // The strengths, which wait for the choice, have been fitted.
    const pm_param_entry *strength =
        pm_params_find(pm_system_params(t->system, 0), "irreversible.strength.output.weight");
    assert_true(fabs(strength->value[0]) > 0);
    // The weights that the search returns are those of the system.
    double now[200];
    const int count = gather(t, now);
    assert_true(count < 200);
    assert_true(largest_difference(theta, now, count) < 1e-9);
    pm_samples_free(&samples);
    pm_training_free(t);
}

// Computes the rates of both ends of the port, p and s of each, in a state with these co-energies.
static void rates_of(const pm_training *t, double value[6][2], double rate[4]) {
    const pm_port_model *port = t->system->port[0];
    pm_graph *g = NULL;
    pm_program *program = NULL;
    pm_port_nodes end[2];
    pm_node output[2], degeneracy = PM_NO_NODE;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    for (int i = 0; i < 2; ++i) {
        end[i] =
            (pm_port_nodes){pm_param(g, value[3 * i], 1, 2), pm_param(g, value[3 * i + 1], 1, 2),
                            pm_param(g, value[3 * i + 2], 1, 2), PM_NO_NODE};
    }
    for (int i = 0; i < 2; ++i) {
        output[i] = port->law->rate(g, port, (pm_end)i, end, &degeneracy);
    }
    assert_int_equal(pm_program_open(&program, g, 2, output, 1), PM_OK);
    pm_program_run(program, 1);
    for (int i = 0; i < 4; ++i) {
        rate[i] = pm_program_value(program, output[i / 2])[i % 2];
    }
    pm_program_close(program);
    pm_graph_close(g);
}

// What leaves a.p enters b.p, energy stays the same, and entropy grows, for random weights. The
// strength depends on the difference of the velocities, or on what drives each process.
static void what_one_group_loses_another_gains(void **state) {
    (void)state;
    static const char *const features[] = {"\"ln|a.dE.p-b.dE.p|\"", "force, \"ln(force)\", a.s"};
    for (int which = 0; which < 2; ++which) {
        char groups[200];
        snprintf(groups, sizeof groups,
                 "acts_on: [a.p, a.s, b.s], against: [b.p], rank: 2, strength: {features: [%s], "
                 "hidden: [3]}",
                 features[which]);
        pm_training *t = open_training_with(groups);
        pm_rng rng;
        pm_rng_init(&rng, 1, 0);
        for (int k = 0; k < 20; ++k) {
            double value[6][2], rate[4], twice[4]; // of each end: p and s, dE, dS
            pm_params_randomise(&t->system->port[0]->params, &rng);
            for (int i = 0; i < 6; ++i) {
                value[i][0] = i % 3 == 2 ? 0 : pm_rng_normal(&rng);
                value[i][1] = i % 3 == 0 ? 0.1 : i % 3 == 1 ? 300 + 20 * pm_rng_normal(&rng) : 1;
            }
            rates_of(t, value, rate);
            const double power[] = {value[1][0] * rate[0], value[1][1] * rate[1],
                                    value[4][0] * rate[2], value[4][1] * rate[3]};
            assert_true(fabs(rate[0]) > 0);
            assert_true(fabs(rate[0] + rate[2]) <= 1e-12 * fabs(rate[0]));
            assert_true(fabs(power[0] + power[1] + power[2] + power[3]) <=
                        1e-9 * (fabs(power[1]) + fabs(power[3])));
            assert_true(rate[1] + rate[3] > 0);
            // Where the strength is not constant, friction is not linear.
            value[1][0] *= 2;
            value[4][0] *= 2;
            rates_of(t, value, twice);
            assert_true(fabs(twice[0] - 2 * rate[0]) > 1e-4 * fabs(rate[0]));
        }
        pm_training_free(t);
    }
}

// The statistics of forces are taken when the initial weights have been chosen.
static void forces_are_normalised(void **state) {
    (void)state;
    static const volatile sig_atomic_t stop = 0;
    pm_training *t = open_training_with("acts_on: [a.p, a.s, b.p, b.s], rank: 3, strength: "
                                        "{features: [\"ln(force)\"], hidden: [3]}");
    pm_samples samples;
    double declared[200], theta[200], loss = INFINITY;
    (void)gather(t, declared);
    make_samples(t, PM_RESIDUAL_STEP, &samples);
    pm_start_draw(t, 0, theta);
    assert_int_equal(pm_normalization_of_system(t->system, &samples, false), PM_OK);
    pm_samples_free(&samples);
    const pm_params *params = pm_system_params(t->system, 2);
    const pm_param_entry *mean = pm_params_find(params, "irreversible.strength.mean");
    assert_int_equal(mean->cols, 3);
    double before[3];
    memcpy(before, mean->value, sizeof before);
    make_samples(t, PM_RESIDUAL_DERIVATIVE, &samples);
    assert_int_equal(pm_start_search(t, &samples, t->seed, declared, theta, &loss, &stop), PM_OK);
    for (int k = 0; k < 3; ++k) {
        assert_true(isfinite(mean->value[k]) && fabs(mean->value[k] - before[k]) > 1e-6);
        assert_true(pm_params_find(params, "irreversible.strength.deviation")->value[k] > 0);
    }
    pm_samples_free(&samples);
    pm_training_free(t);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rotations_make_factors_simple),
        cmocka_unit_test(rates_stay_the_same),
        cmocka_unit_test(what_one_group_loses_another_gains),
        cmocka_unit_test(forces_are_normalised),
        cmocka_unit_test(strengths_follow_the_choice_of_initial_weights),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
