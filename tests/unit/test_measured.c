// Learning from measurements, from files to predictions: a damped pendulum whose angle alone is
// measured, with noise, outliers, missing samples and uneven times. The learned constants are those
// of the pendulum within their standard deviations, and unseen trajectories lie in the bands.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "fit/fit.h"
#include "inference/estimate.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

#define TRACKS 16
#define TRAINING 6
#define SAMPLES 160
#define NOISE 0.01 // rad
#define STIFFNESS 9.0
#define ZERO 0.1
#define FRICTION 0.2
#define DT 0.05
#define SEED 7

static const char scene_text[] = "scene: pendulum\n"
                                 "time: {dt: 0.05, steps: 100, integrator: rk4}\n"
                                 "subsystems:\n"
                                 "  arm:\n"
                                 "    weights: arm.h5\n"
                                 "    state:\n"
                                 "      q: {unit: rad, columns: [angle]}\n"
                                 "      p: {unit: kg m^2/s, hidden: {deviation: 10.0}}\n"
                                 "      s: {unit: J/K, hidden: {deviation: 0.1}}\n";

static const char training_text[] = "scene: scene.yaml\n"
                                    "noise: estimated\n"
                                    "data: {validation: none, trajectories: \"0:6\"}\n"
                                    "models:\n"
                                    "  arm:\n"
                                    "    constants:\n"
                                    "      stiffness: {learned: 4.0, positive: true}\n"
                                    "      zero: {learned: 0.0}\n"
                                    "      friction: {learned: 0.05, positive: true}\n"
                                    "    energy: [\"p^2/2 - stiffness*cos(q - zero)\", \"300*s\"]\n"
                                    "    entropy: {given: s}\n"
                                    "    reversible: {given: [[q, p, 1.0]]}\n"
                                    "    irreversible: {given: [[p, s, \"friction*dE.s\"]]}\n"
                                    "subsystems: {arm: arm}\n";

// One step of Runge-Kutta for q'' = -k sin(q - zero) - friction q'.
static void step(double h, double friction, double z[2]) {
    double k[4][2], x[2] = {z[0], z[1]};
    for (int i = 0; i < 4; ++i) {
        k[i][0] = x[1];
        k[i][1] = -STIFFNESS * sin(x[0] - ZERO) - friction * x[1];
        const double length = i == 2 ? h : h / 2;
        for (int c = 0; c < 2; ++c) {
            x[c] = z[c] + length * k[i][c];
        }
    }
    for (int c = 0; c < 2; ++c) {
        z[c] += h / 6 * (k[0][c] + 2 * k[1][c] + 2 * k[2][c] + k[3][c]);
    }
}

// Measures the angle at uneven times; every seventh sample is missing, every fiftieth an outlier.
// Friction differs between trajectories by the relative deviation `spread`.
static void write_data(const char *path, double spread, uint64_t seed) {
    static const char *const column[] = {"angle", "other"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, TRACKS, SAMPLES, 2, DT, column), PM_OK);
    d->measured = true;
    d->times = pm_arena_array(&d->arena, TRACKS * SAMPLES, sizeof *d->times);
    assert_non_null(d->times);
    for (int i = 0; i < TRACKS; ++i) {
        pm_rng rng;
        pm_rng_init(&rng, seed, (uint64_t)i);
        double z[2] = {2 * pm_rng_normal(&rng) / 2, pm_rng_normal(&rng)}, t = 1;
        const double friction = FRICTION * (spread > 0 ? exp(spread * pm_rng_normal(&rng)) : 1);
        for (int k = 0; k < SAMPLES; ++k) {
            double *row = pm_dataset_state(d, i, k);
            row[0] = k % 7 == 3 ? NAN : z[0] + NOISE * pm_rng_normal(&rng);
            row[0] += k % 50 == 20 ? 0.5 : 0;
            d->times[i * SAMPLES + k] = t;
            const double wait = DT * (1 + pm_rng_uniform(&rng));
            for (int j = 0; j < 50; ++j) {
                step(wait / 50, friction, z);
            }
            t += wait;
        }
    }
    assert_int_equal(pm_dataset_save(d, path), PM_OK);
    pm_dataset_free(d);
}

// Runs the fit in the folder.
static void run_fit(scratch *folder, double spread, uint64_t seed, pm_fit *fit,
                    pm_fit_arguments *arguments) {
    static const volatile sig_atomic_t stop = 0;
    const char *scene = scratch_path(folder, "scene.yaml");
    arguments->config = scratch_path(folder, "train.yaml");
    arguments->data = scratch_path(folder, "data.h5");
    arguments->output = folder->folder;
    scratch_write(scene, scene_text, strlen(scene_text));
    scratch_write(arguments->config, training_text, strlen(training_text));
    write_data(arguments->data, spread, seed);
    if (pm_fit_open(fit, arguments, &stop) != PM_OK || pm_fit_run(fit) != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

static double constant(const pm_fit *fit, const char *name) {
    return *pm_params_find(&fit->training->system->part[0]->params, name)->value;
}

static void check_constant(const char *what, double value, double expected, double deviation) {
    if (!(fabs(value - expected) <= 4 * deviation && deviation > 0 && deviation < 0.05)) {
        fail_msg("%s = %g, expected %g, standard deviation %g", what, value, expected, deviation);
    }
}

static void constants_are_found(void **state) {
    pm_fit fit;
    pm_fit_arguments arguments = {0};
    pm_uncertainty u;
    bool found = false;
    run_fit(*state, 0, SEED, &fit, &arguments);
    assert_int_equal(pm_uncertainty_load(&u, arguments.output, fit.training->system,
                                         &fit.measured.observation, &found),
                     PM_OK);
    assert_true(found);
    assert_int_equal(u.nweight, 3);
    const char *const name[] = {"constant.stiffness", "constant.zero", "constant.friction"};
    const double expected[] = {log(STIFFNESS), ZERO, log(FRICTION)};
    for (int i = 0; i < 3; ++i) {
        check_constant(name[i], constant(&fit, name[i]), expected[i], sqrt(u.covariance[i * 4]));
    }
    if (!(fabs(u.noise[0] / NOISE - 1) < 0.15)) {
        fail_msg("noise %g, expected %g", u.noise[0], NOISE);
    }
    // The momentum follows from the angle, the entropy from nothing.
    assert_true(u.unknown[1] < 0.01 && u.unknown[2] > 0.99);

    const int which[] = {TRAINING, TRAINING + 1};
    const pm_estimate_how how = {.seconds = 3, .uncertainty = &u};
    pm_estimate e;
    const pm_observation *o = &fit.measured.observation;
    if (pm_estimate_make(&e, fit.training->system, o, fit.measured.data, 2, which, &how) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    const double inside = pm_estimate_coverage(&e, o, fit.measured.data, which, 3, 0, 1.645);
    if (!(inside > 0.8 && inside < 0.97)) {
        fail_msg("%g of unseen measurements inside bands of 90 %%", inside);
    }
    pm_estimate_free(&e);
    pm_uncertainty_free(&u);
    pm_fit_close(&fit);
}

// Returns the fraction of all measurements of unseen trajectories that lie in bands of 90 %.
static double unseen_inside(pm_fit *fit, const pm_uncertainty *u) {
    int which[TRACKS - TRAINING];
    for (int i = 0; i < TRACKS - TRAINING; ++i) {
        which[i] = TRAINING + i;
    }
    const pm_estimate_how how = {.seconds = 3, .uncertainty = u};
    const pm_observation *o = &fit->measured.observation;
    pm_estimate e;
    if (pm_estimate_make(&e, fit->training->system, o, fit->measured.data, TRACKS - TRAINING, which,
                         &how) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    const double inside = pm_estimate_coverage(&e, o, fit->measured.data, which, 3, 0, 1.645);
    pm_estimate_free(&e);
    return inside;
}

// Friction differs between trajectories, which the model does not know. Only trajectories that the
// fit leaves out tell how wrong its predictions are.
static void bands_hold_trajectories_that_differ(void **state) {
    pm_fit fit;
    pm_fit_arguments arguments = {0};
    pm_uncertainty u;
    bool found = false;
    run_fit(*state, 0.4, SEED, &fit, &arguments);
    assert_int_equal(pm_uncertainty_load(&u, arguments.output, fit.training->system,
                                         &fit.measured.observation, &found),
                     PM_OK);
    // Residuals of the fit contain a part of what is wrong, and would hide the rest.
    u.noise[0] = u.independent[0];
    const double inside = unseen_inside(&fit, &u), scale = u.scale;
    u.scale = 1; // what the covariance of the weights alone predicts
    const double alone = unseen_inside(&fit, &u);
    if (!(inside > 0.8 && inside < 0.97 && alone < 0.8)) {
        fail_msg("%g of unseen measurements inside bands of 90 %%, with a scale of 1 instead of %g "
                 "%g",
                 inside, scale, alone);
    }
    pm_uncertainty_free(&u);
    pm_fit_close(&fit);
}

// Badly estimated starts lead to errors of predictions. The bands do not become wider by these
// errors if the model is right.
static void errors_of_starts_are_none_of_the_model(void **state) {
    for (uint64_t seed = 11; seed < 17; ++seed) {
        pm_fit fit;
        pm_fit_arguments arguments = {0};
        pm_uncertainty u;
        bool found = false;
        run_fit(*state, 0, seed, &fit, &arguments);
        assert_int_equal(pm_uncertainty_load(&u, arguments.output, fit.training->system,
                                             &fit.measured.observation, &found),
                         PM_OK);
        if (!(u.scale >= 1 && u.scale < 4)) {
            fail_msg("seed %d: the variance that the weights cause counts %g times, expected about "
                     "once",
                     (int)seed, u.scale);
        }
        pm_uncertainty_free(&u);
        pm_fit_close(&fit);
    }
}

// The typical error is a median, in which predictions that are not finite have the largest errors.
static void typical_errors_are_medians(void **state) {
    (void)state;
    static const double measured[8] = {9, 1, 2, 3, 4, 5, 6, 7};
    static const double error[8] = {0, NAN, 0.3, NAN, 0.1, 0.4, NAN, 0.2};
    static const char *const name[] = {"y"};
    const int which = 0;
    int column = 0;
    double y[8];
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 1, 8, 1, 1, name), PM_OK);
    for (int k = 0; k < 8; ++k) {
        *pm_dataset_state(d, 0, k) = measured[k];
        y[k] = measured[k] + error[k];
    }
    const pm_estimate e = {.count = 1, .ntime = 8, .ny = 1, .until = 100, .y = y};
    const pm_observation o = {.count = 1, .column = &column};
    // The median of all measurements is 4.5, and their mean distance from it 17/8. Beyond the first
    // sample the median error is 0.4. In a normal distribution the deviation is 1.48 times the
    // median and 1.25 times the mean distance.
    const double typical = pm_estimate_typical_error(&e, &o, d, &which, 0.5, 0);
    const double expected = 1.4826022185056018 * 0.4 / (1.2533141373155001 * 17 / 8);
    if (!(fabs(typical - expected) < 1e-12)) {
        fail_msg("a typical error of %g, expected %g", typical, expected);
    }
    pm_dataset_free(d);
}

static void missing_columns_are_told(void **state) {
    scratch *folder = *state;
    static const volatile sig_atomic_t stop = 0;
    static const char text[] = "scene: pendulum\n"
                               "time: {dt: 0.05, steps: 100, integrator: rk4}\n"
                               "subsystems:\n"
                               "  arm:\n"
                               "    weights: arm.h5\n"
                               "    state:\n"
                               "      q: {unit: rad, columns: [angle]}\n"
                               "      p: {unit: kg m^2/s, columns: [momentum]}\n"
                               "      s: {unit: J/K, hidden: true}\n";
    pm_fit fit;
    const char *scene = scratch_path(folder, "scene.yaml");
    const pm_fit_arguments arguments = {.config = scratch_path(folder, "train.yaml"),
                                        .data = scratch_path(folder, "data.h5"),
                                        .output = folder->folder};
    scratch_write(scene, text, strlen(text));
    scratch_write(arguments.config, training_text, strlen(training_text));
    write_data(arguments.data, 0, SEED);
    assert_int_equal(pm_fit_open(&fit, &arguments, &stop), PM_EDATA);
    assert_non_null(strstr(pm_error(), "column \"momentum\" is not in the measurements"));
    assert_non_null(strstr(pm_error(), "hidden: true"));
    pm_fit_close(&fit);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(constants_are_found, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(bands_hold_trajectories_that_differ, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(errors_of_starts_are_none_of_the_model, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test(typical_errors_are_medians),
        cmocka_unit_test_setup_teardown(missing_columns_are_told, scratch_setup, scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
