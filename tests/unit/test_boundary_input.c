// Boundary inputs: interpolation between the states of a dataset, constants, and the places that
// errors name.
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/digest.h"
#include "scene/boundary_input.h"
#include "tests/support/unit.h"

#define NTIME 30
#define STRIDE 3
// Of the values' size: divided differences of the eighth state amplify rounding.
#define ROUNDING 1e-13

static const char text[] =
    "scene: loaded\n"
    "time: {dt: 0.1, steps: 5, integrator: rk4}\n"
    "subsystems: {a: {weights: a.h5, state: {q: {unit: m, size: 1}, s: {unit: J, size: 1}}}}\n"
    "boundary_inputs:\n"
    "  wind:\n"
    "    p: {unit: kg, value: 2, dE: force}\n"
    "    s: {unit: J, dE: bath, dS: 1}\n"
    "  wall: {q: {unit: m, dE: [force, -0.5]}}\n";

// The values of wind (p, s) and wall (q, q): state, dE, dS of each.
enum { WIND_P, WIND_S, WIND_DP, WIND_DS, WIND_ETA_P, WIND_ETA_S, WALL_DQ = 8, NVALUE = 12 };

static const char *const columns[] = {"bath", "force"};

typedef struct fixture {
    pm_scene *scene;
    pm_dataset *data;
    pm_arena arena;
    pm_boundary_input boundary_input;
} fixture;

static void open(fixture *f, int ntime) {
    *f = (fixture){0};
    if (pm_scene_parse(&f->scene, text, "t.yaml") != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_int_equal(f->scene->physics.nprescribed, NVALUE);
    assert_int_equal(pm_dataset_new(&f->data, 2, ntime, 2, 0.1 * STRIDE, columns), PM_OK);
}

static void close(fixture *f) {
    pm_arena_free(&f->arena);
    pm_dataset_free(f->data);
    pm_scene_free(f->scene);
}

static void follow(fixture *f) {
    if (pm_boundary_input_bind(&f->boundary_input, f->scene, f->data, STRIDE, &f->arena) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    pm_boundary_input_follow(&f->boundary_input, f->data, 1);
}

static void near(const char *what, long step, double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance)) {
        fail_msg("%s at step %ld: %.17g, expected %.17g within %g", what, step, value, expected,
                 tolerance);
    }
}

// x in states of the dataset.
static double polynomial(double x, int degree) {
    double sum = 0;
    for (int k = 0; k <= degree; ++k) {
        sum += (k % 3 - 0.8) * pow((x - 7) / 5, k);
    }
    return sum;
}

// Largest difference from f over all steps and some fractions; checks the numbers on the way.
static double largest_error(const fixture *f, double (*exact)(double x, int parameter),
                            int parameter) {
    double worst = 0, value[NVALUE];
    for (long step = 0; step < f->boundary_input.end; ++step) {
        for (int k = 0; k <= 4; ++k) {
            const double x = ((double)step + k / 4.0) / STRIDE;
            pm_boundary_input_at(&f->boundary_input, step, k / 4.0, value);
            worst = fmax(worst, fabs(value[WIND_DP] - exact(x, parameter)));
            near("bath", step, value[WIND_DS], 1 + x, ROUNDING * 30);
            near("the same column", step, value[WALL_DQ], value[WIND_DP], 0);
            near("a number", step, value[WALL_DQ + 1], -0.5, 0);
            near("value", step, value[WIND_P], 2, 0);
            near("dS", step, value[WIND_ETA_S], 1, 0);
            near("nothing said", step, value[WIND_ETA_P], 0, 0);
        }
    }
    return worst;
}

static void fill(fixture *f, double (*exact)(double x, int parameter), int parameter) {
    for (int j = 0; j < f->data->ntime; ++j) {
        double *row = pm_dataset_state(f->data, 1, j);
        row[0] = 1 + j;
        row[1] = exact(j, parameter);
    }
}

static void polynomials_are_exact(void **state) {
    (void)state;
    for (int ntime = 2; ntime <= NTIME; ++ntime) {
        const int degree =
            ntime < PM_BOUNDARY_INPUT_ORDER ? ntime - 1 : PM_BOUNDARY_INPUT_ORDER - 1;
        fixture f;
        open(&f, ntime);
        fill(&f, polynomial, degree);
        follow(&f);
        assert_int_equal(f.boundary_input.end, STRIDE * (ntime - 1));
        near("polynomial", ntime, largest_error(&f, polynomial, degree), 0,
             ROUNDING * fabs(polynomial(NTIME, degree)));
        close(&f);
    }
}

// Angular frequency parameter / 100 per state.
static double sine(double x, int parameter) {
    return sin(0.01 * parameter * x + 0.3);
}

// The error of boundary_input.h in the middle, and of eighth order everywhere.
static void sines_are_off_by_the_eighth_power(void **state) {
    (void)state;
    double error[2];
    for (int i = 0; i < 2; ++i) {
        fixture f;
        open(&f, NTIME);
        fill(&f, sine, 40 << i);
        follow(&f);
        error[i] = largest_error(&f, sine, 40 << i);
        double value[NVALUE], middle = 0;
        for (long step = 8 * STRIDE; step < f.boundary_input.end - 8 * STRIDE; ++step) {
            pm_boundary_input_at(&f.boundary_input, step, 0.5, value);
            middle =
                fmax(middle, fabs(value[WIND_DP] - sine(((double)step + 0.5) / STRIDE, 40 << i)));
        }
        near("bound", i, middle / (1.1e-3 * pow(0.4 * (1 << i), 8)), 0.9, 0.15);
        close(&f);
    }
    near("order", 0, log2(error[1] / error[0]), 8, 0.5);
}

static void numbers_need_no_dataset(void **state) {
    (void)state;
    pm_scene *scene = NULL;
    pm_arena arena = {0};
    pm_boundary_input boundary_input;
    double value[6];
    const char *still = "scene: still\ntime: {dt: 1, steps: 1, integrator: rk4}\n"
                        "subsystems: {a: {weights: a.h5, state: {q: {unit: m, size: 1}}}}\n"
                        "boundary_inputs: {wind: {p: {unit: kg, dE: [0.1, -2e3]}}}\n";
    assert_int_equal(pm_scene_parse(&scene, still, "t.yaml"), PM_OK);
    assert_int_equal(pm_boundary_input_bind(&boundary_input, scene, NULL, 0, &arena), PM_OK);
    assert_true(boundary_input.end == LONG_MAX);
    pm_boundary_input_at(&boundary_input, 123456789, 0.7, value);
    assert_true(value[2] == 0.1 && value[3] == -2e3 && value[0] == 0 && value[4] == 0);
    pm_arena_free(&arena);
    pm_scene_free(scene);
}

// A dataset without a column of this name gives the time since its first state; one with such a
// column gives the column.
static void the_time_needs_no_column(void **state) {
    (void)state;
    static const char *const named[] = {"time"};
    const char *clock = "scene: clock\ntime: {dt: 0.1, steps: 1, integrator: rk4}\n"
                        "subsystems: {a: {weights: a.h5, state: {q: {unit: m, size: 1}}}}\n"
                        "boundary_inputs: {wind: {t: {unit: s, dE: 0, value: time}}}\n";
    for (int i = 0; i < 2; ++i) {
        fixture f = {0};
        assert_int_equal(pm_scene_parse(&f.scene, clock, "t.yaml"), PM_OK);
        assert_int_equal(
            pm_dataset_new(&f.data, 2, NTIME, 1, 0.1 * STRIDE, i == 0 ? columns : named), PM_OK);
        for (int j = 0; j < NTIME; ++j) {
            f.data->t[j] += 5;
            *pm_dataset_state(f.data, 1, j) = 7;
        }
        follow(&f);
        assert_int_equal(f.boundary_input.end, STRIDE * (NTIME - 1));
        for (long step = 0; step < f.boundary_input.end; ++step) {
            double value[3];
            pm_boundary_input_at(&f.boundary_input, step, 0.5, value);
            near("time", step, value[0], i == 0 ? 0.1 * ((double)step + 0.5) : 7, ROUNDING * 100);
        }
        close(&f);
    }
}

static void fails(fixture *f, const pm_dataset *data, pm_status code, const char *words) {
    const pm_status status =
        pm_boundary_input_bind(&f->boundary_input, f->scene, data, 1, &f->arena);
    if (status != code || strstr(pm_error(), words) == NULL) {
        fail_msg("status %d, expected %d; error \"%s\", expected \"%s\"", status, code, pm_error(),
                 words);
    }
}

static void what_cannot_be_followed(void **state) {
    (void)state;
    fixture f;
    open(&f, 1);
    fails(&f, NULL, PM_ECONFIG,
          "t.yaml:6:33: boundary input wind follows the column \"force\", but there");
    fails(&f, f.data, PM_EDATA, "cannot follow a trajectory of one state");
    f.data->ncolumn = 1;
    fails(&f, f.data, PM_EDATA,
          "t.yaml:6:33: boundary input wind: column \"force\" is not in the dataset");
    close(&f);
}

static void the_digest_tells_loads_apart(void **state) {
    (void)state;
    fixture f;
    open(&f, NTIME);
    fill(&f, sine, 40);
    follow(&f);
    const uint64_t digest = pm_boundary_input_digest(&f.boundary_input, PM_DIGEST_INIT);
    pm_dataset_state(f.data, 1, NTIME - 1)[1] += 1e-9;
    pm_boundary_input_follow(&f.boundary_input, f.data, 1);
    assert_true(pm_boundary_input_digest(&f.boundary_input, PM_DIGEST_INIT) != digest);
    close(&f);
}

// --- what is held ---

static const char holding[] = "scene: holding\n"
                              "time: {dt: 0.1, steps: 5, integrator: rk4}\n"
                              "subsystems: {a: {weights: a.h5, state: {q: {unit: m, size: 1}}}}\n"
                              "boundary_inputs: {hand: {f: {unit: N, dE: [u, 3], hold: %s}}}\n";
enum { HAND_DE = 2 };

static void open_held(fixture *f, const char *hold, int ntime, double dt) {
    static const char *const named[] = {"u", "other"};
    char scene[512];
    *f = (fixture){0};
    snprintf(scene, sizeof scene, holding, hold);
    assert_int_equal(pm_scene_parse(&f->scene, scene, "t.yaml"), PM_OK);
    assert_int_equal(pm_dataset_new(&f->data, 1, ntime, 2, dt, named), PM_OK);
    f->data->measured = true;
}

static void follow_first(fixture *f) {
    const int stride = pm_boundary_input_stride(f->scene, f->data);
    assert_int_equal(
        pm_boundary_input_bind(&f->boundary_input, f->scene, f->data, stride, &f->arena), PM_OK);
    pm_boundary_input_follow(&f->boundary_input, f->data, 0);
}

static void check_at(const fixture *f, long step, double fraction, double expected) {
    double value[6];
    pm_boundary_input_at(&f->boundary_input, step, fraction, value);
    near("held", step, value[HAND_DE], expected, 1e-12);
    near("a number", step, value[HAND_DE + 1], 3, 0);
}

// Samples every three steps, one of them missing: the value before it stays, or a line crosses it.
static void samples_are_held_or_joined(void **state) {
    (void)state;
    static const double sample[] = {2, 5, NAN, -1, 7};
    static const double joined[] = {2, 5, 2, -1};
    for (int line = 0; line < 2; ++line) {
        fixture f;
        open_held(&f, line ? "linear" : "previous", 5, 0.1 * STRIDE);
        for (int j = 0; j < 5; ++j) {
            pm_dataset_state(f.data, 0, j)[0] = sample[j];
        }
        follow_first(&f);
        assert_int_equal(f.boundary_input.stride, STRIDE);
        assert_int_equal(f.boundary_input.end, 4 * STRIDE);
        for (int j = 0; j < 4; ++j) {
            const double held = j == 2 ? 5 : sample[j];
            const double slope = (j == 3 ? 8 : j == 0 ? 3 : -3) / (double)STRIDE;
            for (int k = 0; k < STRIDE; ++k) {
                check_at(&f, j * STRIDE + k, 0, line ? joined[j] + k * slope : held);
                check_at(&f, j * STRIDE + k, 1, line ? joined[j] + (k + 1) * slope : held);
            }
        }
        close(&f);
    }
}

// A column acts two samples later, or half a sample earlier: each step then has the mean of two
// samples.
static void samples_may_act_later(void **state) {
    (void)state;
    static const double sample[] = {2, 5, 3, -1, 7};
    static const double later[] = {2, 2, 2, 5}, earlier[] = {3.5, 4, 1, 3};
    for (int k = 0; k < 2; ++k) {
        fixture f;
        open_held(&f, k == 0 ? "previous, delay: 0.2" : "previous, delay: -0.05", 5, 0.1);
        for (int j = 0; j < 5; ++j) {
            pm_dataset_state(f.data, 0, j)[0] = sample[j];
        }
        follow_first(&f);
        for (int j = 0; j < 4; ++j) {
            check_at(&f, j, 0.5, k == 0 ? later[j] : earlier[j]);
        }
        close(&f);
    }
    fixture f;
    open_held(&f, "smooth, delay: 0.2", 5, 0.1);
    for (int j = 0; j < 5; ++j) {
        pm_dataset_state(f.data, 0, j)[0] = 1 - j + j * j;
    }
    follow_first(&f);
    check_at(&f, 1, 0.5, 1); // before the first sample
    check_at(&f, 3, 0.5, 1 - 1.5 + 1.5 * 1.5);
    close(&f);
}

// Times that are no multiples of dt: a jump acts for its part of the step, so that the impulse is
// right, and the jump itself is where the sample is.
static void a_step_has_the_mean_of_uneven_samples(void **state) {
    (void)state;
    static const double time[] = {10, 10.13, 10.25, 10.4};
    static const double sample[] = {1, 5, 5, 2};
    fixture f;
    open_held(&f, "previous", 4, 0.1);
    f.data->times = pm_arena_array(&f.data->arena, 4, sizeof *f.data->times);
    for (int j = 0; j < 4; ++j) {
        f.data->times[j] = time[j];
        pm_dataset_state(f.data, 0, j)[0] = sample[j];
    }
    follow_first(&f);
    assert_int_equal(f.boundary_input.end, 4);
    check_at(&f, 0, 0.5, 1);
    check_at(&f, 1, 0, 0.3 * 1 + 0.7 * 5);
    check_at(&f, 1, 1, 0.3 * 1 + 0.7 * 5);
    check_at(&f, 3, 0, 5);
    near("jump", 0, pm_boundary_input_jump(&f.boundary_input, 0, 0.4), 0.13, 1e-12);
    near("no jump", 0, pm_boundary_input_jump(&f.boundary_input, 0.13, 0.4), 0.4, 1e-12);
    near("at a jump", 0, pm_boundary_input_of(&f.boundary_input, HAND_DE, 10.13), 5, 0);
    near("the last", 0, pm_boundary_input_of(&f.boundary_input, HAND_DE, 10.4), 2, 0);
    close(&f);
}

// A cubic at uneven times, and a straight line through samples that are denser than steps.
static void uneven_samples_are_interpolated(void **state) {
    (void)state;
    for (int dense = 0; dense < 2; ++dense) {
        fixture f;
        open_held(&f, "smooth", 60, 0.1);
        f.data->times = pm_arena_array(&f.data->arena, 60, sizeof *f.data->times);
        for (int j = 0; j < 60; ++j) {
            const double t = dense ? 0.004 * j + 0.001 * (j % 3) : 0.08 * j + 0.01 * (j % 3);
            f.data->times[j] = t;
            pm_dataset_state(f.data, 0, j)[0] = dense ? 1 - t : 1 - t + 2 * t * t - 0.3 * t * t * t;
        }
        follow_first(&f);
        for (long step = 0; step < f.boundary_input.end; ++step) {
            const double t = 0.1 * ((double)step + 0.25);
            check_at(&f, step, 0.25, dense ? 1 - t : 1 - t + 2 * t * t - 0.3 * t * t * t);
        }
        close(&f);
    }
}

// A trajectory ends before the others, and a column may have no sample at all.
static void trajectories_may_be_short(void **state) {
    (void)state;
    fixture f;
    open_held(&f, "previous", 6, 0.1);
    for (int j = 0; j < 6; ++j) {
        pm_dataset_state(f.data, 0, j)[0] = j < 4 ? (double)j : (double)NAN;
        pm_dataset_state(f.data, 0, j)[1] = j < 4 ? (double)j : (double)NAN;
    }
    follow_first(&f);
    assert_int_equal(f.boundary_input.end, 3);
    assert_true(pm_boundary_input_covers(&f.boundary_input, 2));
    assert_false(pm_boundary_input_covers(&f.boundary_input, 3));
    assert_string_equal(pm_boundary_input_ending(&f.boundary_input, 3)->name, "hand");
    for (int j = 0; j < 6; ++j) {
        pm_dataset_state(f.data, 0, j)[0] = NAN;
    }
    fails(&f, f.data, PM_EDATA, "column \"u\", which has no sample in trajectory 0");
    close(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(polynomials_are_exact),
        cmocka_unit_test(sines_are_off_by_the_eighth_power),
        cmocka_unit_test(numbers_need_no_dataset),
        cmocka_unit_test(the_time_needs_no_column),
        cmocka_unit_test(what_cannot_be_followed),
        cmocka_unit_test(the_digest_tells_loads_apart),
        cmocka_unit_test(samples_are_held_or_joined),
        cmocka_unit_test(samples_may_act_later),
        cmocka_unit_test(a_step_has_the_mean_of_uneven_samples),
        cmocka_unit_test(uneven_samples_are_interpolated),
        cmocka_unit_test(trajectories_may_be_short),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
