// The training range: which states it contains, that rotated states stay in it, and what a run
// reports when a state leaves it.
#include <math.h>
#include <string.h>

#include "model/training_range.h"
#include "sim/monolithic.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define STEPS 20
#define WORLDS 20

static void widened_states_are_inside_whichever_way_they_are_turned(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, random_system_scene, random_system_part,
                              random_system_port);
        pm_part *part = w.system->part[0];
        const int nz = part->layout.nz; // q[2] p[2] s
        assert_null(pm_training_range_departure(pm_training_range_of(part), w.z).group);
        assert_int_equal(pm_training_range_declare(part), PM_OK);
        pm_training_range_widen(part, w.z);
        pm_training_range_widen(part, w.z + nz);
        const double turned[] = {-w.z[1], w.z[0], w.z[3], -w.z[2], w.z[4]};
        assert_null(pm_training_range_departure(pm_training_range_of(part), w.z).group);
        assert_null(pm_training_range_departure(pm_training_range_of(part), turned).group);
        double far[] = {w.z[0], w.z[1], w.z[2], w.z[3], fmax(w.z[4], w.z[nz + 4])};
        const double width = fabs(w.z[4] - w.z[nz + 4]);
        far[4] += 2 * width;
        const pm_departure d = pm_training_range_departure(pm_training_range_of(part), far);
        assert_string_equal(d.group->name, "s");
        random_system_check(&w, "widths", d.widths, 2, 1e-12);
        random_system_check(&w, "high", d.high, far[4] - 2 * width, 1e-12);
        random_system_close(&w);
    }
}

// A vector of constant length, such as a direction, drifts by the error of the integrator.
static void a_direction_may_drift(void **state) {
    (void)state;
    random_system w;
    random_system_of_text(&w, 1, random_system_scene, random_system_part, random_system_port);
    pm_part *part = w.system->part[0];
    assert_int_equal(pm_training_range_declare(part), PM_OK);
    double z[] = {0.6, 0.8, 1, 1, 0};
    pm_training_range_widen(part, z);
    z[0] *= 1 + 1e-6;
    assert_null(pm_training_range_departure(pm_training_range_of(part), z).group);
    z[0] *= 1.1;
    const pm_departure d = pm_training_range_departure(pm_training_range_of(part), z);
    assert_string_equal(d.group->name, "q");
    assert_true(d.widths > 10 && d.widths < 100);
    random_system_close(&w);
}

// A run counts by the same rule: vectors whose lengths leave the range by rounding alone are
// inside.
static void a_run_lets_directions_drift(void **state) {
    (void)state;
    random_system w;
    random_system_of_text(&w, 1, random_system_scene, random_system_part, random_system_port);
    for (int i = 0; i < 2; ++i) {
        double z[5];
        assert_int_equal(pm_training_range_declare(w.system->part[i]), PM_OK);
        for (int s = -1; s <= 1; s += 2) { // any entropy near the start is known
            memcpy(z, w.z + 5 * (ptrdiff_t)i, sizeof z);
            z[4] += s;
            pm_training_range_widen(w.system->part[i], z);
        }
    }
    w.scene->physics.dt = 1e-8;
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w.system), PM_OK);
    pm_monolithic_set_state(assembly, w.z);
    for (int step = 0; step < STEPS; ++step) {
        assert_int_equal(pm_monolithic_step(assembly), PM_OK);
    }
    const pm_sample *sample = pm_monolithic_sample(assembly);
    assert_true(memcmp(sample->z, w.z, sizeof(double[10])) != 0);
    assert_int_equal(sample->outside[0], 0);
    assert_int_equal(sample->outside[1], 0);
    pm_monolithic_close(assembly);
    random_system_close(&w);
}

// Both parts know the start alone, so that every step leads outside of it.
static void a_run_counts_departures_and_ends_where_the_scene_says(void **state) {
    (void)state;
    random_system w;
    random_system_of_text(&w, 1, random_system_scene, random_system_part, random_system_port);
    for (int i = 0; i < 2; ++i) {
        assert_int_equal(pm_training_range_declare(w.system->part[i]), PM_OK);
        pm_training_range_widen(w.system->part[i], w.z + w.scene->physics.subsystem[i].first);
    }
    w.scene->physics.dt = 1e-4;
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w.system), PM_OK);
    pm_monolithic_set_state(assembly, w.z);
    for (int i = 0; i < STEPS; ++i) {
        assert_int_equal(pm_monolithic_step(assembly), PM_OK);
    }
    const pm_sample *sample = pm_monolithic_sample(assembly);
    assert_int_equal(sample->outside[0], STEPS);
    assert_int_equal(sample->outside[1], STEPS);
    w.scene->run.largest_departure = 3;
    assert_int_equal(pm_monolithic_step(assembly), PM_ENUMERIC);
    assert_non_null(strstr(pm_error(), "subsystem a: step 21: "));
    assert_non_null(strstr(pm_error(), "its weights were trained on"));
    pm_monolithic_close(assembly);
    random_system_close(&w);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(widened_states_are_inside_whichever_way_they_are_turned),
        cmocka_unit_test(a_direction_may_drift),
        cmocka_unit_test(a_run_lets_directions_drift),
        cmocka_unit_test(a_run_counts_departures_and_ends_where_the_scene_says),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
