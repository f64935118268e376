// Training does not depend on the units of columns and of time. From every start of every form, two
// iterations change every block of weights (hidden layers change from the second iteration on).
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fit/normalization.h"
#include "fit/start.h"
#include "loss/objective.h"
#include "tests/support/runge_kutta.h"
#include "tests/support/training.h"
#include "tests/support/unit.h"

#define NTRAJECTORY 6
#define NTIME 30
#define NZ 6
#define DT 0.1
#define ITERATIONS 5
#define MAX_ITERATIONS 200
// Rounding, which the normal equations of some iterations amplify.
#define SAME_CURVE 1e-5

static const char *const columns[NZ] = {"x1", "p1", "s1", "x2", "p2", "s2"};

// Two oscillators with friction, of which the first drives the second, and conduction.
static void rates(const double *z, double *rate) {
    const double T1 = 300 * exp(z[2] / 0.4), T2 = 300 * exp(z[5] / 0.25);
    const double force = 1.5 * z[3] + z[3] * z[3] * z[3], heat = 0.05 * (T2 - T1);
    rate[0] = z[1];
    rate[1] = -2 * z[0] + force - 0.1 * z[1];
    rate[2] = (0.1 * z[1] * z[1] + heat) / T1;
    rate[3] = z[4] / 0.7 - z[1];
    rate[4] = -force - 0.2 * z[4] / 0.7;
    rate[5] = (0.2 * z[4] * z[4] / 0.49 - heat) / T2;
}

static pm_dataset *make_data(const double *unit, double time) {
    pm_dataset *data = NULL;
    assert_int_equal(pm_dataset_new(&data, NTRAJECTORY, NTIME, NZ, DT * time, columns), PM_OK);
    pm_rng rng;
    pm_rng_init(&rng, 3, 1);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        double z[NZ];
        for (int c = 0; c < NZ; ++c) {
            z[c] = (c % 3 == 2 ? 0.01 : 0.7) * pm_rng_normal(&rng);
        }
        for (int j = 0; j < NTIME; ++j) {
            for (int c = 0; c < NZ; ++c) {
                pm_dataset_state(data, i, j)[c] = unit[c] * z[c];
            }
            for (int k = 0; k < 10; ++k) {
                runge_kutta_step(NZ, rates, DT / 10, z);
            }
        }
    }
    return data;
}

#define STAGES \
    "stages: [{optimiser: gauss_newton, iterations: %d, batch: 60, residual: derivative}]\n"

// Opens a training of the two oscillators with these models.
static pm_training *two_oscillators(double time, const char *part, const char *port,
                                    const char *law) {
    char scene[4096], text[4096];
    snprintf(
        scene, sizeof scene,
        "scene: two\ntime: {dt: %.17g, steps: 20, integrator: rk4}\nsubsystems:\n"
        "  a: {weights: a.h5, state: {x: {unit: m, columns: [x1]}, p: {unit: kg m/s, columns: "
        "[p1]}, s: {unit: J/K, columns: [s1]}}}\n"
        "  b: {weights: b.h5, state: {x: {unit: m, columns: [x2]}, p: {unit: kg m/s, columns: "
        "[p2]}, s: {unit: J/K, columns: [s2]}}}\nports:\n"
        "  j: {law: %s, between: [a, b], weights: j.h5, expose: {a: [x, p, s], b: [x, p, s]}}\n",
        DT * time, law);
    snprintf(text, sizeof text,
             "scene: scene.yaml\nmodels:\n  part:\n%s  port:\n    law: %s\n%s"
             "subsystems: {a: part, b: part}\nports: {j: port}\n" STAGES,
             part, law, port, ITERATIONS);
    return load_training(scene, text);
}

typedef struct curve {
    int count;
    double loss[MAX_ITERATIONS];
} curve;

static pm_status record(void *context, const pm_optimisation *o, double loss) {
    curve *c = context;
    (void)o;
    c->loss[c->count++] = loss;
    return PM_OK;
}

// Draws weights from the seed and trains for some iterations; *theta [2][size] are the weights
// before and after.
static curve train(pm_training *t, const pm_dataset *data, int iterations, double **theta) {
    curve c = {0};
    pm_samples samples;
    pm_objective *objective = NULL;
    assert_int_equal(
        pm_samples_make(&samples, t->scene, data, 0, NTRAJECTORY, PM_RESIDUAL_STEP, 1, 1), PM_OK);
    double *work = calloc(100000, sizeof *work);
    assert_non_null(work);
    pm_start_draw(t, 0, work);
    assert_int_equal(pm_normalization_of_system(t->system, &samples, false), PM_OK);
    pm_samples_free(&samples);
    assert_int_equal(
        pm_samples_make(&samples, t->scene, data, 0, NTRAJECTORY, PM_RESIDUAL_DERIVATIVE, 1, 1),
        PM_OK);
    assert_int_equal(pm_objective_open(&objective, t->system, &samples, &t->stage[0].loss), PM_OK);
    const size_t n = (size_t)pm_objective_size(objective);
    *theta = calloc(2 * n, sizeof **theta);
    double *moment = calloc(2 * n, sizeof *moment);
    assert_true(*theta != NULL && moment != NULL && n > 1);
    memcpy(*theta, work, n * sizeof **theta);
    memcpy(*theta + n, work, n * sizeof **theta);
    pm_optimisation o = {.objective = objective,
                         .schedule = t->stage[0].schedule,
                         .seed = 7,
                         .theta = *theta + n,
                         .moment = moment,
                         .report = record,
                         .context = &c};
    o.schedule.iterations = iterations;
    assert_int_equal(t->stage[0].optimiser->run(&o), PM_OK);
    free(moment);
    free(work);
    pm_objective_close(objective);
    pm_samples_free(&samples);
    return c;
}

static const char hard_part[] = "    energy: {features: [x, p, s], hidden: [4], skip: quadratic}\n"
                                "    entropy: {given: s}\n"
                                "    reversible: {learned: {acts_on: [x, p, s]}}\n"
                                "    irreversible: {learned: {acts_on: [x, p, s], rank: 2}}\n";
static const char hard_port[] =
    "    reversible: {learned: {acts_on: [a.x, a.p, b.x, b.p]}}\n"
    "    irreversible: {learned: {acts_on: [a.p, a.s, b.p, b.s], rank: 2}}\n";
static const char free_part[] = "    form: free\n    rate: {features: [x, p, s], hidden: [4]}\n";
static const char free_port[] = "    form: free\n    rate: {features: [own.x, own.p, other.x, "
                                "other.p, own.s, other.s], hidden: "
                                "[4], skip: linear}\n";

static void assert_same_curve(const curve *c, const curve *first, int units) {
    for (int k = 0; k < ITERATIONS; ++k) {
        if (!(fabs(c->loss[k] - first->loss[k]) <= SAME_CURVE * first->loss[k])) {
            fail_msg("units %d, iteration %d: loss %.10g, expected %.10g", units, k, c->loss[k],
                     first->loss[k]);
        }
    }
}

// Trains on data in units number i, and compares the curve with that in units number 0. Frees the
// training and the data.
static void compare_curve(pm_training *t, pm_dataset *data, int i, curve *first) {
    double *theta;
    const curve c = train(t, data, ITERATIONS, &theta);
    *first = i == 0 ? c : *first;
    assert_same_curve(&c, first, i);
    free(theta);
    pm_dataset_free(data);
    pm_training_free(t);
}

static void check_curves(const char *part, const char *port, const char *law) {
    static const double unit[4][NZ] = {{1, 1, 1, 1, 1, 1},
                                       {1000, 1, 1, 0.001, 1, 1},
                                       {1, 0.01, 1000, 1, 5, 1000},
                                       {1, 1, 1, 1, 1, 1}};
    static const double time[4] = {1, 1, 1, 1000};
    curve first = {0};
    for (int i = 0; i < 4; ++i) {
        pm_training *t = two_oscillators(time[i], part, port, law);
        pm_dataset *data = make_data(unit[i], time[i]);
        compare_curve(t, data, i, &first);
    }
}

static void curves_do_not_depend_on_units(void **state) {
    (void)state;
    check_curves(hard_part, hard_port, "bracket");
    check_curves(free_part, free_port, "exchange");
}

// Opens a training of one oscillator, for which the other one is a boundary input. The units of the
// other one's velocity and position are those of the columns, and differ from those of the
// subsystem.
static pm_training *one_driven(const char *part) {
    static const char scene[] =
        "scene: one\ntime: {dt: 0.1, steps: 20, integrator: rk4}\nsubsystems:\n"
        "  a: {weights: a.h5, state: {x: {unit: m, columns: [x1]}, p: {unit: kg m/s, columns: "
        "[p1]}, s: {unit: J/K, columns: [s1]}}}\n"
        "boundary_inputs: {other: {p: {unit: kg m/s, dE: [p2], dS: [0]}, f: {unit: m, dE: [x2]}}}\n"
        "ports:\n"
        "  j: {law: bracket, between: [other, a], weights: j.h5, expose: {a: [x, p, s], other: [p, "
        "f]}}\n";
    char text[4096];
    snprintf(text, sizeof text,
             "scene: scene.yaml\nmodels:\n  part:\n%s  port:\n    law: bracket\n"
             "    reversible: {learned: {acts_on: [a.f, a.p], against: [b.x, b.p]}}\n"
             "    irreversible: {learned: {acts_on: [a.p, b.p, b.s], rank: 2}}\n"
             "subsystems: {a: part}\nports: {j: port}\n" STAGES,
             part, ITERATIONS);
    return load_training(scene, text);
}

static void curves_do_not_depend_on_units_of_inputs(void **state) {
    (void)state;
    static const double unit[3][NZ] = {
        {1, 1, 1, 1, 1, 1}, {1, 1, 1, 1, 1e6, 1}, {1, 1, 1, 1000, 1e-6, 1}};
    curve first = {0};
    for (int i = 0; i < 3; ++i) {
        pm_training *t = one_driven(hard_part);
        pm_dataset *data = make_data(unit[i], 1);
        compare_curve(t, data, i, &first);
    }
}

// Returns true for a bias that only adds a constant to the energy, and thus has no effect.
static bool is_constant_of_energy(const pm_param_entry *entry) {
    const char *end = strstr(entry->name, ".output.bias");
    const bool potential =
        strstr(entry->name, "energy.") != NULL || strstr(entry->name, "entropy.");
    return potential && end != NULL && entry->cols == 1;
}

static void check_alive(const char *part, const char *port, const char *law) {
    static const double unit[NZ] = {1, 1, 1, 1, 1, 1};
    double *theta;
    pm_training *t = two_oscillators(1, part, port, law);
    pm_dataset *data = make_data(unit, 1);
    train(t, data, 2, &theta);
    size_t n = 0, at = 0;
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        n += pm_params_trained(pm_system_params(t->system, i));
    }
    for (int i = 0; i < pm_system_components(t->system); ++i) {
        const pm_params *params = pm_system_params(t->system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            const size_t size = entry->trained ? (size_t)entry->rows * (size_t)entry->cols : 0;
            bool moved = size == 0 || is_constant_of_energy(entry);
            for (size_t j = 0; j < size; ++j) {
                moved = moved || theta[at + j] != theta[n + at + j];
            }
            if (!moved) {
                fail_msg("component %d: %s has not moved; models:\n%s%s", i, entry->name, part,
                         port);
            }
            at += size;
        }
    }
    free(theta);
    pm_dataset_free(data);
    pm_training_free(t);
}

// Learned constants of formulas converge to those of the data, up to the error of rates that are
// computed by differences.
static void constants_are_found(void **state) {
    (void)state;
    static const char part[] =
        "    constants: {m: {learned: 1.3, positive: true}, k: {learned: 1.0, positive: true}, b: "
        "{learned: 0.3}, c: {learned: 0.6, positive: true}, g: {learned: 0.05, positive: true}}\n"
        "    energy: [\"p^2/(2*m)\", \"k*x^2/2 + b*x^4/4\", \"c*300*(exp(s/c) - 1)\"]\n"
        "    entropy: {given: s}\n"
        "    reversible: {given: [[x, p, 1.0]]}\n"
        "    irreversible: {given: [[p, s, \"g*dE.s\"]]}\n";
    static const char port[] = "    constants: {K: {learned: 0.2, positive: true}}\n"
                               "    reversible: {given: [[a.p, b.x, 1.0]]}\n"
                               "    irreversible: {given: [[a.s, b.s, \"K*b.dE.s/a.dE.s\"]]}\n";
    static const char *const name[] = {"m", "k", "b", "c", "g"};
    static const double unit[NZ] = {1, 1, 1, 1, 1, 1};
    static const double expected[3][5] = {{1, 2, 0, 0.4, 0.1}, {0.7, 1.5, 1, 0.25, 0.2}, {0.05}};
    double *theta;
    pm_training *t = two_oscillators(1, part, port, "bracket");
    pm_dataset *data = make_data(unit, 1);
    assert_int_equal(t->tries, 1); // there is nothing to draw
    train(t, data, 20, &theta);
    for (int i = 0; i < 3; ++i) {
        const pm_params *params = pm_system_params(t->system, i);
        for (int k = 0; k < (i < 2 ? 5 : 1); ++k) {
            char full[32];
            snprintf(full, sizeof full, "constant.%s", i < 2 ? name[k] : "K");
            const double stored = *pm_params_find(params, full)->value;
            const double value = strcmp(full, "constant.b") == 0 ? stored : exp(stored);
            if (fabs(value - expected[i][k]) > 0.02) {
                fail_msg("component %d: %s is %g, expected %g", i, full, value, expected[i][k]);
            }
        }
    }
    free(theta);
    pm_dataset_free(data);
    pm_training_free(t);
}

// A learned coefficient of a lossless pair waits while initial weights are compared, since it could
// replace the size of the energy. Other learned constants do not wait.
static void coefficients_of_lossless_pairs_wait(void **state) {
    (void)state;
    static const char port[] =
        "    constants: {c: {learned: -1.0}, K: {learned: 0.2, positive: true}}\n"
        "    reversible: {given: [[a.p, b.x, \"2.0*c\"]]}\n"
        "    irreversible: {given: [[a.s, b.s, \"K*b.dE.s/a.dE.s\"]]}\n";
    pm_training *t = two_oscillators(1, hard_part, port, "bracket");
    const pm_params *params = &t->system->port[0]->params;
    assert_true(pm_params_find(params, "constant.c")->late);
    assert_false(pm_params_find(params, "constant.K")->late);
    pm_training_free(t);
}

// The temperature of reference that two bodies share is one weight, and it is found although
// conduction depends on the ratio of the temperatures only.
static void shared_constants_are_one_weight(void **state) {
    (void)state;
    static const char part[] =
        "    constants: {m: {learned: 1.3, positive: true}, k: {learned: 1.0, positive: true}, b: "
        "{learned: 0.3}, T: {learned: 250.0, positive: true, shared: true}, c: {learned: 0.3, "
        "positive: true}, g: {learned: 0.15, positive: true}}\n"
        "    energy: [\"p^2/(2*m)\", \"k*x^2/2 + b*x^4/4\", \"c*T*(exp(s/c) - "
        "1)\"]\n"
        "    entropy: {given: s}\n"
        "    reversible: {given: [[x, p, 1.0]]}\n"
        "    irreversible: {given: [[p, s, \"g*dE.s\"]]}\n";
    static const char port[] = "    constants: {K: {learned: 0.1, positive: true}}\n"
                               "    reversible: {given: [[a.p, b.x, 1.0]]}\n"
                               "    irreversible: {given: [[a.s, b.s, \"K*b.dE.s/a.dE.s\"]]}\n";
    static const double unit[NZ] = {1, 1, 1, 1, 1, 1};
    double *theta;
    pm_training *t = two_oscillators(1, part, port, "bracket");
    pm_dataset *data = make_data(unit, 1);
    const pm_param_entry *T[2];
    for (int i = 0; i < 2; ++i) {
        T[i] = pm_params_find(pm_system_params(t->system, i), "constant.T");
        assert_non_null(T[i]);
    }
    assert_true(T[0]->trained && !T[1]->trained && T[1]->borrowed);
    train(t, data, 20, &theta);
    for (int i = 0; i < 2; ++i) {
        T[i] = pm_params_find(pm_system_params(t->system, i), "constant.T");
    }
    const double first = exp(*T[0]->value), second = exp(*T[1]->value);
    if (first != second || fabs(first - 300) > 3) {
        fail_msg("the shared constant is %.9g and %.9g, expected 300", first, second);
    }
    free(theta);
    pm_dataset_free(data);
    pm_training_free(t);
}

static void no_start_is_dead(void **state) {
    (void)state;
    static const char *const skips[] = {"none", "linear", "quadratic", "quartic"};
    for (int i = 0; i < 4; ++i) {
        char part[1024];
        snprintf(
            part, sizeof part,
            "    energy: {features: [x, p, s], hidden: [4], skip: %s}\n    entropy: {given: s}\n"
            "    reversible: {learned: {acts_on: [x, p, s], features: [x, p], hidden: [3], skip: "
            "%s}}\n    irreversible: {learned: {acts_on: [x, p, s], features: [x], hidden: [3], "
            "skip: %s}}\n",
            skips[i], skips[i], skips[i]);
        check_alive(part, hard_port, "bracket");
        snprintf(part, sizeof part,
                 "    form: soft\n    energy: {features: [x, p, s], hidden: [4], skip: %s}\n"
                 "    entropy: {features: [x, p, s], hidden: [4], skip: %s}\n"
                 "    reversible: {learned: {acts_on: [x, p, s], features: [x, p], hidden: [3]}}\n"
                 "    irreversible: {learned: {acts_on: [x, p, s], features: [x], hidden: [3]}}\n",
                 skips[i], skips[i]);
        check_alive(part, hard_port, "bracket");
    }
    check_alive(hard_part, hard_port, "bracket");
    check_alive(free_part, free_port, "exchange");
}

// A run of Gauss-Newton that ends before its last iteration has gained less than 2 % in ten
// iterations. The loss of a slow fit falls by a few percent for long, and then faster.
static void runs_end_when_they_gain_little(void **state) {
    (void)state;
    static const double unit[NZ] = {1, 1, 1, 1, 1, 1};
    for (uint64_t seed = 1; seed <= 3; seed += 2) {
        double *theta;
        pm_training *t = two_oscillators(1, free_part, free_port, "exchange");
        pm_dataset *data = make_data(unit, 1);
        t->seed = seed;
        const curve c = train(t, data, MAX_ITERATIONS, &theta);
        const double gain = 1 - c.loss[c.count - 1] / c.loss[c.count - 11];
        if (c.count < MAX_ITERATIONS && !(gain < 0.02)) {
            fail_msg("seed %d: the run ends after %d iterations, of which the last ten lowered the "
                     "loss by %.3g %%",
                     (int)seed, c.count, 100 * gain);
        }
        free(theta);
        pm_dataset_free(data);
        pm_training_free(t);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(curves_do_not_depend_on_units),
        cmocka_unit_test(curves_do_not_depend_on_units_of_inputs),
        cmocka_unit_test(constants_are_found),
        cmocka_unit_test(coefficients_of_lossless_pairs_wait),
        cmocka_unit_test(shared_constants_are_one_weight),
        cmocka_unit_test(no_start_is_dead),
        cmocka_unit_test(runs_end_when_they_gain_little),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
