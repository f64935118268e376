// Temperatures that conservation of energy shows in a dataset, and proposals that begin with them.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "propose/temperature.h"
#include "tests/support/proposal.h"

#define STATES 60
#define FINE 50

// A mass of 1 kg on a spring of 1 N/m, whose friction of 0.2 N s/m warms a body of the temperature
// cold exp(s/C) with C = 3 J/cold. `%s` are the units of x, p and s.
#define SCENE                                                    \
    "scene: mass\n"                                              \
    "time: {dt: 0.1, steps: 59, integrator: rk4, substeps: 1}\n" \
    "subsystems:\n"                                              \
    "  mass:\n"                                                  \
    "    weights: mass.h5\n"                                     \
    "    state:\n"                                               \
    "      x: {unit: %s, columns: [x]}\n"                        \
    "      p: {unit: %s, columns: [p]}\n"                        \
    "      s: {unit: %s, columns: [s]}\n"

static void rate_of(const double z[3], double cold, double rate[3]) {
    const double friction = 0.2;
    rate[0] = z[1];
    rate[1] = -z[0] - friction * z[1];
    rate[2] = friction * z[1] * z[1] / (cold * exp(z[2] * cold / 3));
}

static void step(double z[3], double cold, double h) {
    double k[3], middle[3];
    rate_of(z, cold, k);
    for (int c = 0; c < 3; ++c) {
        middle[c] = z[c] + h / 2 * k[c];
    }
    rate_of(middle, cold, k);
    for (int c = 0; c < 3; ++c) {
        z[c] += h * k[c];
    }
}

// Trajectories of bodies that begin at `cold` K, in units that are `unit` [3] SI units.
static pm_dataset *make_data(double cold, const double unit[3]) {
    static const char *const column[] = {"x", "p", "s"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 10, STATES, 3, 0.1, column), PM_OK);
    for (int i = 0; i < 10; ++i) {
        double z[] = {1 + 0.1 * i, 0.3 * (i % 3), 0.1 / cold * i};
        for (int j = 0; j < STATES; ++j) {
            for (int c = 0; c < 3; ++c) {
                pm_dataset_state(d, i, j)[c] = z[c] / unit[c];
            }
            for (int k = 0; k < FINE; ++k) {
                step(z, cold, 0.1 / FINE);
            }
        }
    }
    return d;
}

// Returns the temperature that the data show.
static double show(const char *text, const pm_dataset *d, int entropy) {
    pm_scene *scene = NULL;
    pm_look look;
    pm_part_view part[2];
    double temperature[8];
    assert_int_equal(pm_scene_parse(&scene, text, "mass.yaml"), PM_OK);
    assert_int_equal(pm_look_make(&look, scene, d), PM_OK);
    pm_view_parts(&look, part);
    pm_look_temperatures(&look, part, temperature);
    for (int c = 0; c < scene->physics.nz; ++c) {
        assert_true(temperature[c] >= 0 && (c == entropy || temperature[c] <= 0));
    }
    pm_look_free(&look);
    pm_scene_free(scene);
    return temperature[entropy];
}

static void write_scene(char text[1024], const char *x, const char *p, const char *s) {
    snprintf(text, 1024, SCENE, x, p, s);
}

static const double si[3] = {1, 1, 1};

static void the_power_of_motion_shows_the_temperature(void **state) {
    (void)state;
    char text[1024];
    write_scene(text, "m", "kg m/s", "J/K");
    for (int decade = -2; decade < 5; ++decade) {
        const double cold = pow(10, decade);
        pm_dataset *d = make_data(cold, si);
        const double found = show(text, d, 2);
        if (!(found > 1.1 * cold && found < 1.5 * cold)) {
            fail_msg("%g K, expected 1.1 to 1.5 times %g", found, cold);
        }
        pm_dataset_free(d);
    }
}

static void units_do_not_matter(void **state) {
    (void)state;
    char text[1024], other[1024];
    static const double unit[3] = {1e-3, 1e3, 1e-6};
    pm_dataset *a = make_data(3, si), *b = make_data(3, unit);
    write_scene(text, "m", "kg m/s", "J/K");
    write_scene(other, "mm", "kN s", "uJ/K");
    assert_true(fabs(show(text, a, 2) / show(other, b, 2) - 1) < 1e-6);
    pm_dataset_free(a);
    pm_dataset_free(b);
}

static void a_proposal_begins_with_it_far_from_that_of_a_room(void **state) {
    (void)state;
    char scene[1024], text[PM_PROPOSAL_TEXT];
    write_scene(scene, "m", "N s", "kJ/K");
    static const double unit[3] = {1, 1, 1e3};
    pm_dataset *cold = make_data(3, unit), *room = make_data(300, unit);
    double slope = 0;
    propose_text(scene, cold, text);
    const char *found = strstr(text, ", temperature: ");
    assert_non_null(found);
    assert_int_equal(sscanf(found, ", temperature: %lf", &slope), 1);
    assert_true(slope > 3300 && slope < 4500); // J per kJ/K
    propose_text(scene, room, text);
    assert_non_null(strstr(text, "K by conservation of energy"));
    assert_null(strstr(text, "temperature: "));
    pm_dataset_free(cold);
    pm_dataset_free(room);
}

// Two bodies that exchange heat show ratios of temperatures alone.
static void without_motion_there_is_no_temperature(void **state) {
    (void)state;
    static const char text[] = "scene: bodies\n"
                               "time: {dt: 0.1, steps: 59, integrator: rk4, substeps: 1}\n"
                               "subsystems:\n"
                               "  bodies:\n"
                               "    weights: bodies.h5\n"
                               "    state:\n"
                               "      s: {unit: J/K, columns: [s]}\n"
                               "      r: {unit: J/K, columns: [r]}\n";
    static const char *const column[] = {"s", "r"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 10, STATES, 2, 0.1, column), PM_OK);
    for (int i = 0; i < 10; ++i) {
        double a = 3 + 0.1 * i, b = 4; // K
        for (int j = 0; j < STATES; ++j) {
            const double z[] = {log(a), 2 * log(b)};
            memcpy(pm_dataset_state(d, i, j), z, sizeof z);
            const double heat = 0.1 * (b - a);
            a += heat;
            b -= heat / 2;
        }
    }
    assert_true(show(text, d, 0) <= 0);
    pm_dataset_free(d);
}

// x' = p/m and p' = p^2 m'/(2 m^2) - x - d x' with the mass m = 1 + x^2/4, and the same
// body.
static void a_mass_may_depend_on_the_position(void **state) {
    (void)state;
    static const char *const column[] = {"x", "p", "s"};
    const double cold = 3, friction = 0.2, h = 0.1 / FINE;
    char text[1024];
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 30, STATES, 3, 0.1, column), PM_OK);
    for (int i = 0; i < 30; ++i) {
        double z[] = {0.8 + i * 7 % 30 / 30.0, 0.3 * (i % 3), i * 11 % 30 / 30.0 / cold};
        for (int j = 0; j < STATES; ++j) {
            memcpy(pm_dataset_state(d, i, j), z, sizeof z);
            for (int k = 0; k < 10 * FINE; ++k) {
                const double m = 1 + z[0] * z[0] / 4, v = z[1] / m;
                z[1] += h / 10 * (v * v * z[0] / 4 - z[0] - friction * v);
                z[0] += h / 10 * v;
                z[2] += h / 10 * friction * v * v / (cold * exp(z[2] * cold / 3));
            }
        }
    }
    write_scene(text, "m", "kg m/s", "J/K");
    const double found = show(text, d, 2);
    if (!(found > 1.1 * cold && found < 1.5 * cold)) {
        fail_msg("%g K, expected 1.1 to 1.5 times %g", found, cold);
    }
    pm_dataset_free(d);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_power_of_motion_shows_the_temperature),
        cmocka_unit_test(units_do_not_matter),
        cmocka_unit_test(a_proposal_begins_with_it_far_from_that_of_a_room),
        cmocka_unit_test(a_mass_may_depend_on_the_position),
        cmocka_unit_test(without_motion_there_is_no_temperature),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
