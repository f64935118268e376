// Substeps that follow the error: two pendula that pass close to the pivot of the upper one.
#include <math.h>
#include <string.h>

#include "sim/monolithic.h"
#include "sim/step_controller.h"
#include "tests/support/unit.h"

#define NZ 10
#define STEPS 30
// At 1 m/s straight towards the pivot.
static const double start[NZ] = {1.5, 0.003, -1, 0, 0, 1, 0, -2, 0, 0};

typedef struct outcome {
    double z[NZ];
    double drift;     // J, of the energy
    long substeps;    // in all
    long least, most; // per step
} outcome;

static outcome roll_out(const char *integrator, int substeps, double tolerance) {
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_monolithic *assembly = NULL;
    outcome o = {.least = PM_MOST_SUBSTEPS};
    require(pm_scene_load(&scene, "configs/analytic_double_pendulum.yaml"));
    require(pm_system_load(&system, scene, NULL));
    scene->physics.integrator = pm_integrator_find(integrator);
    scene->physics.substeps = substeps;
    scene->physics.tolerance = tolerance;
    const int nstage = pm_integrator_find(integrator)->nstage;
    require(pm_monolithic_open(&assembly, system));
    pm_monolithic_set_state(assembly, start);
    const pm_sample *sample = pm_monolithic_sample(assembly);
    const double first = sample->energy[0] + sample->energy[1];
    for (int i = 0; i < STEPS; ++i) {
        // An exposure, a bulk term and a port's in every round.
        const long before = sample->evaluated[0] + sample->skipped[0];
        require(pm_monolithic_step(assembly));
        sample = pm_monolithic_sample(assembly);
        const long now = (sample->evaluated[0] + sample->skipped[0] - before) / (3 * nstage);
        o.substeps += now;
        o.least = now < o.least ? now : o.least;
        o.most = now > o.most ? now : o.most;
        o.drift = fmax(o.drift, fabs(sample->energy[0] + sample->energy[1] - first));
    }
    memcpy(o.z, sample->z, sizeof o.z);
    pm_monolithic_close(assembly);
    pm_system_free(system);
    pm_scene_free(scene);
    return o;
}

static double distance(const double *a, const double *b) {
    double sum = 0;
    for (int i = 0; i < NZ; ++i) {
        sum += (a[i] - b[i]) * (a[i] - b[i]);
    }
    return sqrt(sum);
}

// With fewer substeps in all than a fixed number, and many of them where a spring is short.
static void substeps_go_where_the_error_is(void **state) {
    (void)state;
    const outcome exact = roll_out("rk6", 4096, 0);
    const outcome fixed = roll_out("rk4", 16, 0), paced = roll_out("rk4", 1, 1e-5);
    const double error_fixed = distance(fixed.z, exact.z), error = distance(paced.z, exact.z);
    print_message("fixed: %ld substeps, error %.3g, drift %.3g J\n", fixed.substeps, error_fixed,
                  fixed.drift);
    print_message("paced: %ld substeps, %ld to %ld, error %.3g, drift %.3g J\n", paced.substeps,
                  paced.least, paced.most, error, paced.drift);
    assert_true(fixed.least == 16 && fixed.most == 16);
    assert_true(paced.substeps < fixed.substeps);
    assert_true(paced.most > 20 * paced.least);
    assert_true(error < 0.4 * error_fixed && paced.drift < 0.2 * fixed.drift);
}

static void the_tolerance_is_kept(void **state) {
    (void)state;
    static const char *const integrator[] = {"heun", "rk4", "rk4_balanced"};
    for (int i = 0; i < 3; ++i) {
        const outcome coarse = roll_out(integrator[i], 1, 1e-3),
                      fine = roll_out(integrator[i], 1, 1e-6);
        const outcome again = roll_out(integrator[i], 1, 1e-6);
        const double order = pm_integrator_find(integrator[i])->embedded + 1;
        const double ratio = (double)fine.substeps / (double)coarse.substeps;
        print_message("%s: %ld and %ld substeps\n", integrator[i], coarse.substeps, fine.substeps);
        if (!(fabs(log(ratio) / log(1000) - 1 / order) < 0.3 / order)) {
            fail_msg("%s: a thousandth of the tolerance takes %g times the substeps", integrator[i],
                     ratio);
        }
        assert_memory_equal(fine.z, again.z, sizeof fine.z);
    }
}

// Limits of a single choice, and what a growing error adds to it.
static void the_next_step_follows_the_error(void **state) {
    (void)state;
    pm_scene scene = {.physics = {.integrator = pm_integrator_find("rk4"),
                                  .substeps = 1,
                                  .tolerance = 1e-3,
                                  .nsubsystem = 2}};
    double error[2] = {0, 0.5e-3};
    pm_sample sample = {.step = 1, .error = error};
    pm_step_controller pace;
    require(pm_step_controller_init(&pace, &scene));
    assert_int_equal(pace.substeps, 8); // nothing is known of the first step
    pm_step_controller_note(&pace, &sample);
    assert_int_equal(pace.substeps, 8); // half the tolerance is aimed at
    error[0] = 8 * 0.5e-3;
    pm_step_controller_note(&pace, &sample);
    assert_int_equal(pace.substeps, 32); // twice for the error, twice for its rise
    error[0] = error[1] = 0;
    pm_step_controller_note(&pace, &sample);
    assert_int_equal(pace.substeps, 16);
    error[0] = 1e9;
    pm_step_controller_note(&pace, &sample);
    assert_int_equal(pace.substeps, 128);
    for (int i = 0; i < 10; ++i) {
        pm_step_controller_note(&pace, &sample);
    }
    assert_int_equal(pace.substeps, PM_MOST_SUBSTEPS);
    scene.physics.substeps = 5;
    error[0] = 0;
    for (int i = 0; i < 20; ++i) {
        pm_step_controller_note(&pace, &sample);
    }
    assert_int_equal(pace.substeps, 5); // the fewest
    scene.physics.substeps = PM_MOST_SUBSTEPS;
    require(pm_step_controller_init(&pace, &scene));
    ++scene.physics.substeps;
    assert_int_equal(pm_step_controller_init(&pace, &scene), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "substeps: 4097"));
    scene.physics.integrator = pm_integrator_find("rk6");
    scene.physics.integrator_at = "x.yaml:1:2";
    assert_int_equal(pm_step_controller_init(&pace, &scene), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "x.yaml:1:2: integrator rk6 does not estimate its error"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(substeps_go_where_the_error_is),
        cmocka_unit_test(the_tolerance_is_kept),
        cmocka_unit_test(the_next_step_follows_the_error),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
