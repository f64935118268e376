// The shipped double pendulum over five times its training horizon: energy and angular momentum are
// conserved up to the integrator's error, and entropy never falls, to rounding. The known one in
// steps of several lengths: integrators that keep the energy by construction do so, or the ledger
// counts the steps on which their iteration did not converge.
#include <math.h>
#include <string.h>

#include "sim/ledger.h"
#include "sim/monolithic.h"
#include "tests/support/unit.h"

#define STEPS 1000
// Relative; what rk4 leaves at the scene's substeps from starts that pass no centre within 0.2 m.
#define SMALL_DRIFT 1e-6

// States of the scene: the springs' vectors, momenta, entropies.
static const double start[][10] = {
    {4.5, 4.4, -0.5, 1.4, 0.0, -2.6, 0.1, 1.4, -0.2, 0.0},
    {4.1, 3.9, -0.4, 1.3, 0.05, -2.2, 0.7, 1.5, -0.2, -0.05},
    {4.9, 4.9, -0.7, 1.5, -0.05, -3.2, -0.3, 1.3, -0.15, 0.05},
};

// q1 x p1 + q2 x p2 with absolute positions.
static double angular_momentum(const double *z) {
    const double *a = z, *b = z + 5;
    const double q2[2] = {a[0] + b[0], a[1] + b[1]};
    return a[0] * a[3] - a[1] * a[2] + q2[0] * b[3] - q2[1] * b[2];
}

static void check_rollout(const pm_system *system, pm_monolithic *assembly, const double *z) {
    pm_ledger ledger;
    pm_ledger_init(&ledger, system);
    pm_monolithic_set_state(assembly, z);
    const double first = angular_momentum(z);
    double drift = 0;
    for (int i = 0; i <= STEPS; ++i) {
        assert_int_equal(i == 0 ? PM_OK : pm_monolithic_step(assembly), PM_OK);
        pm_sample sample = *pm_monolithic_sample(assembly);
        assert_int_equal(pm_ledger_add_sample(&ledger, &sample), PM_OK);
        drift = fmax(drift, fabs(angular_momentum(sample.z) - first));
    }
    print_message("energy %g J drifts by %.1e, angular momentum %g m kg m/s by %.1e\n",
                  ledger.first_energy, ledger.energy_drift, first, drift);
    assert_true(ledger.energy_drift < SMALL_DRIFT * fabs(ledger.first_energy));
    assert_true(drift < SMALL_DRIFT * fabs(first));
    assert_true(ledger.worst_entropy_fall == 0 && ledger.entropy > ledger.first_entropy);
}

static void long_rollouts_keep_the_invariants(void **state) {
    (void)state;
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_scene_load(&scene, "configs/double_pendulum.yaml"), PM_OK);
    assert_int_equal(pm_system_load(&system, scene, NULL), PM_OK);
    assert_int_equal(pm_monolithic_open(&assembly, system), PM_OK);
    for (size_t i = 0; i < sizeof start / sizeof *start; ++i) {
        check_rollout(system, assembly, start[i]);
    }
    pm_monolithic_close(assembly);
    pm_system_free(system);
    pm_scene_free(scene);
}

// Returns the ledger after 40 steps of the known pendulum.
static pm_ledger ledger_of(pm_scene *scene, pm_system *system, const char *integrator, double dt) {
    pm_monolithic *assembly = NULL;
    pm_ledger ledger;
    scene->physics.integrator = pm_integrator_find(integrator);
    scene->physics.dt = dt;
    scene->physics.substeps = 1;
    assert_int_equal(pm_monolithic_open(&assembly, system), PM_OK);
    pm_ledger_init(&ledger, system);
    pm_monolithic_set_state(assembly, start[0]);
    for (int i = 0; i <= 40; ++i) {
        assert_int_equal(i == 0 ? PM_OK : pm_monolithic_step(assembly), PM_OK);
        pm_sample sample = *pm_monolithic_sample(assembly);
        assert_int_equal(pm_ledger_add_sample(&ledger, &sample), PM_OK);
    }
    pm_monolithic_close(assembly);
    return ledger;
}

static void a_step_that_does_not_converge_is_divided(void **state) {
    (void)state;
    static const struct {
        const char *integrator;
        double dt;
    } c[] = {{"discrete_gradient", 0.01}, {"discrete_gradient", 0.3}, {"discrete_gradient", 0.6},
             {"discrete_gradient", 1.5},  {"rk4_balanced", 0.02},     {"rk4", 0.3}};
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    assert_int_equal(pm_scene_load(&scene, "configs/analytic_double_pendulum.yaml"), PM_OK);
    assert_int_equal(pm_system_load(&system, scene, NULL), PM_OK);
    for (size_t i = 0; i < sizeof c / sizeof *c; ++i) {
        const pm_ledger ledger = ledger_of(scene, system, c[i].integrator, c[i].dt);
        print_message("%s, %g s: energy of a step %.1e, %ld of 40 steps in violation\n",
                      c[i].integrator, c[i].dt, ledger.worst_step, ledger.violations);
        assert_int_equal(ledger.unbalanced + ledger.violations, 0);
        assert_true((ledger.worst_step > scene->run.energy_tolerance) ==
                    (strcmp(c[i].integrator, "rk4") == 0));
    }
    pm_system_free(system);
    pm_scene_free(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(long_rollouts_keep_the_invariants),
        cmocka_unit_test(a_step_that_does_not_converge_is_divided),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
