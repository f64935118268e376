// Compares the simulator of two gas containers with exact solutions, the laws and finite
// differences, and the shipped reference with the shipped configuration.
#include <math.h>
#include <stdio.h>

#include "store/dataset.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"
#include "truth/truth.h"

enum { V1, V2, P, S1, S2, NZ };

static const pm_ode_method adams = {PM_ODE_ADAMS, 1e-14, 1e-15};

#define INITIAL "{position: [0.3, 2.6], momentum: [-1, 1], entropy: [1, 2]}"

static pm_status load_config(scratch *folder, double wall_mass, double conductivity,
                             const char *initial, pm_truth **truth) {
    char text[512];
    const int length =
        snprintf(text, sizeof text,
                 "simulator: gas_containers\nseed: 5\ntrajectories: 3\nstates: 60\ndt: 0.05\n"
                 "system: {wall_mass: %g, area: 0.7, half_length: 1.5, gas_constant: 0.8, c: 1.3, "
                 "conductivity: %g,\n  initial: %s}\n",
                 wall_mass, conductivity, initial);
    const char *path = scratch_path(folder, "truth.yaml");
    scratch_write(path, text, (size_t)length);
    return pm_truth_load(truth, path, NULL);
}

static pm_truth *open(scratch *folder, double wall_mass, double conductivity) {
    pm_truth *truth = NULL;
    if (load_config(folder, wall_mass, conductivity, INITIAL, &truth) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return truth;
}

static void solve(const pm_truth *truth, int ntime, double dt, double *z) {
    if (pm_ode_solve(&truth->model.ode, adams, ntime, dt, z) != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

// Energy and volume of both gases together.
static double energy(const pm_truth *truth, const double *z) {
    double value[2];
    truth->model.conserve(truth->model.ode.data, z, value);
    return value[0];
}

static double energy_slope(const pm_truth *truth, const double *z, int i) {
    const double h = 1e-5;
    double moved[NZ];
    memcpy(moved, z, sizeof moved);
    moved[i] = z[i] + h;
    const double above = energy(truth, moved);
    moved[i] = z[i] - h;
    return (above - energy(truth, moved)) / (2 * h);
}

// Entropy that gives a gas of volume v the energy E, in the units of `load_config`.
static double entropy_for(double E, double v) {
    return 0.8 * log(1.3 * v * pow(E, 1.5));
}

static void rate_follows_energy(void **state) {
    pm_truth *truth = open(*state, 2, 3);
    for (int i = 0; i < 20; ++i) {
        double z[NZ], zdot[NZ], slope[NZ];
        pm_rng rng;
        pm_rng_init(&rng, 11, (uint64_t)i);
        truth->model.draw(truth->model.ode.data, &rng, z);
        truth->model.ode.rate(truth->model.ode.data, z, zdot);
        for (int k = 0; k < NZ; ++k) {
            slope[k] = energy_slope(truth, z, k);
        }
        const double T1 = slope[S1], T2 = slope[S2];
        assert_near("v1dot", zdot[V1], 0.7 * slope[P], 1e-7);
        assert_near("v2dot", zdot[V2], -0.7 * slope[P], 1e-7);
        assert_near("pdot", zdot[P], 0.7 * (slope[V2] - slope[V1]), 1e-6);
        assert_near("s1dot", zdot[S1], 3 / T1 * (1 / T1 - 1 / T2), 1e-6);
        assert_near("s2dot", zdot[S2], 3 / T2 * (1 / T2 - 1 / T1), 1e-6);
    }
    pm_truth_free(truth);
}

// A slightly displaced wall oscillates with omega^2 = (20/9) E / (m L^2), because each gas pushes
// with the force 2 E / (3 L), and adiabatically E / L changes by -5/3 E / L per relative change of
// L.
static void small_oscillation(void **state) {
    pm_truth *truth = open(*state, 2, 0);
    const double E = 1.7, v = 0.7 * 1.5, start = 1e-5;
    const double period = 2 * acos(-1) / sqrt(20 * E / (9 * 2 * 1.5 * 1.5));
    const double s = entropy_for(E, v);
    double z[3][NZ] = {{v + start, v - start, 0, s, s}};
    solve(truth, 3, period / 2, z[0]);
    assert_near("after half a period", z[1][V1] - v, -start, 1e-9);
    assert_near("after a period", z[2][V1] - v, start, 1e-9);
    assert_near("momentum", z[2][P], 0, 1e-9);
    pm_truth_free(truth);
}

// With a wall too heavy to move and E1 + E2 = 2 E, the difference D = E1 - E2 obeys
// Ddot = -3 alpha R D / (E^2 - D^2/4), so E^2 ln(D/D0) - (D^2 - D0^2)/8 = -3 alpha R t.
static void conduction_alone(void **state) {
    pm_truth *truth = open(*state, 1e12, 3);
    const double E = 2, D0 = 1.5, t = 0.4;
    double z[2][NZ] = {{0.5, 1.6, 0, entropy_for(E + D0 / 2, 0.5), entropy_for(E - D0 / 2, 1.6)}};
    solve(truth, 2, t, z[0]);
    const double E1 = pow(exp(z[1][S1] / 0.8) / (1.3 * z[1][V1]), 2.0 / 3);
    const double E2 = pow(exp(z[1][S2] / 0.8) / (1.3 * z[1][V2]), 2.0 / 3);
    const double D = E1 - E2;
    assert_near("energy", E1 + E2, 2 * E, 1e-10);
    assert_near("difference", E * E * log(D / D0) - (D * D - D0 * D0) / 8, -3 * 3 * 0.8 * t, 1e-9);
    pm_truth_free(truth);
}

static void laws_along_trajectories(void **state) {
    pm_truth *truth = open(*state, 2, 3);
    double z[60][NZ], check[60][NZ];
    pm_truth_report report;
    pm_truth_report_init(&report);
    for (int i = 0; i < 3; ++i) {
        assert_int_equal(pm_truth_run(truth, i, z[0], check[0]), PM_OK);
        assert_true(pm_truth_difference(truth, z[0], check[0]) < 1e-10);
        pm_truth_report_add(&report, truth, z[0]);
    }
    assert_near("energy drift", report.drift[0], 0, 1e-11);
    assert_near("volume", report.magnitude[1], 2 * 0.7 * 1.5, 1e-12);
    assert_near("volume drift", report.drift[1], 0, 1e-12);
    assert_true(report.entropy_step > -1e-13 && report.entropy_rise > 1e-3);
    pm_truth_free(truth);
}

static void wrong_initial_states(void **state) {
    static const struct {
        const char *initial, *words;
    } cases[] = {
        {"{position: [0.3, 3.1], momentum: [-1, 1], entropy: [1, 2]}", "both numbers in (0, 3) m"},
        {"{position: [0.3, 1], momentum: [1, -1], entropy: [1, 2]}", "expected [lowest, highest]"},
        {"{position: [0.3, 1], momentum: 1, entropy: [1, 2]}", "expected 2 numbers"},
        {"{position: [0.3, 1], momentum: [-1, 1]}", "entropy"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        pm_truth *truth = NULL;
        const pm_status status = load_config(*state, 1, 1, cases[i].initial, &truth);
        if (status != PM_ECONFIG || strstr(pm_error(), cases[i].words) == NULL) {
            fail_msg("case %zu: status %d, \"%s\", expected \"%s\"", i, status, pm_error(),
                     cases[i].words);
        }
    }
}

static void shipped_configuration(void **state) {
    (void)state;
    static double z[401][NZ], check[401][NZ];
    pm_truth *truth = NULL;
    pm_dataset *data = NULL;
    if (pm_truth_load(&truth, "configs/truth/gas_containers.yaml", NULL) != PM_OK ||
        pm_dataset_load(&data, "configs/reference/gas_containers.h5") != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_int_equal(truth->ntrajectory, 100);
    assert_int_equal(truth->ntime, 401);
    assert_int_equal(data->ntime, 401);
    assert_int_equal(pm_truth_run(truth, 90, z[0], check[0]), PM_OK);
    assert_true(pm_truth_difference(truth, z[0], check[0]) < 1e-10);
    assert_true(pm_truth_difference(truth, z[0], data->z) < 1e-10);
    pm_dataset_free(data);
    pm_truth_free(truth);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rate_follows_energy),  cmocka_unit_test(small_oscillation),
        cmocka_unit_test(conduction_alone),     cmocka_unit_test(laws_along_trajectories),
        cmocka_unit_test(wrong_initial_states), cmocka_unit_test(shipped_configuration),
    };
    return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
