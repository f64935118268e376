// Compares the simulators of links with exact solutions, conservation laws and finite differences.
#include <math.h>

#include "store/dataset.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"
#include "truth/chain.h"
#include "truth/truth.h"

#define PI 3.14159265358979323846

static const pm_ode_method adams = {PM_ODE_ADAMS, 1e-14, 1e-15};
static const pm_ode_method bdf = {PM_ODE_BDF, 1e-13, 1e-14};

static void chain_rate(const void *data, const double *z, double *zdot) {
    pm_chain_rate(data, z, zdot);
}

static void solve(const pm_chain *chain, pm_ode_method method, int ntime, double dt, double *z) {
    const pm_ode ode = {5 * chain->n, chain_rate, chain, NULL};
    if (pm_ode_solve(&ode, method, ntime, dt, z) != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

// Modified Bessel function I0, by its series.
static double bessel_i0(double x) {
    double term = 1, sum = 1;
    for (int k = 1; k < 40; ++k) {
        term *= x * x / (4.0 * k * k);
        sum += term;
    }
    return sum;
}

// A logarithmic spring without thermal coupling, released at rest with the length l0 exp(u),
// returns after the period 2 pi l0 sqrt(m/C) I0(u), and is shortest, l0 exp(-u), after half of it.
static void radial_period(void **state) {
    (void)state;
    const pm_chain_link link = {.mass = 1.5, .C = 0.3, .l0 = 2, .b = 0, .c = 5};
    const pm_chain chain = {.n = 1, .conductivity = 5, .reference_temperature = 300, .link = &link};
    const double u = 0.7, period = 2 * PI * 2 * sqrt(1.5 / 0.3) * bessel_i0(u);
    double z[3][5] = {{2 * exp(u) * 0.6, 2 * exp(u) * 0.8, 0, 0, 0.01}};
    solve(&chain, adams, 3, period / 2, z[0]);
    assert_near("shortest", hypot(z[1][0], z[1][1]), 2 * exp(-u), 1e-10);
    for (int i = 0; i < 5; ++i) {
        assert_near("after a period", z[2][i], z[0][i], 1e-10);
    }
}

// In a circular motion the tension is the centripetal force, and the temperature is constant.
static void circular_orbit(void **state) {
    (void)state;
    const pm_chain_link link = {.mass = 2, .C = 0.2, .l0 = 1, .b = 0.09, .c = 5};
    const pm_chain chain = {.n = 1, .reference_temperature = 300, .link = &link};
    const double l = 3, T = 296;
    const double tension = (link.C * log(l / link.l0) - link.b * (T - 300)) / l;
    const double speed = sqrt(tension * l / link.mass), turn = speed / l * 7;
    double z[2][5] = {{l, 0, 0, link.mass * speed, 0}};
    pm_chain_set_temperatures(&chain, &T, z[0]);
    solve(&chain, adams, 2, 7, z[0]);
    assert_near("x", z[1][0], l * cos(turn), 1e-10);
    assert_near("y", z[1][1], l * sin(turn), 1e-10);
    assert_near("s", z[1][4], z[0][4], 1e-15);
    assert_near("T", pm_chain_temperature(&chain, z[1], 0), T, 1e-10);
}

// Without thermal coupling, equal heat capacities c: T1 - T2 decays as exp(-2 K t / c).
static void conduction_alone(void **state) {
    (void)state;
    const pm_chain_link link = {.mass = 1, .C = 0.1, .l0 = 1, .b = 0, .c = 5};
    const pm_chain_link links[2] = {link, link};
    const double T[2] = {310, 280};
    for (int stiff = 0; stiff < 2; ++stiff) {
        const double K = stiff ? 3000 : 0.5, dt = 5 / K;
        const pm_chain chain = {
            .n = 2, .conductivity = K, .reference_temperature = 300, .link = links};
        double z[2][10] = {{1, 1, 2, 3, 0, 0, 0, 0, 0, 0}};
        pm_chain_set_temperatures(&chain, T, z[0]);
        solve(&chain, stiff ? bdf : adams, 2, dt, z[0]);
        const double difference = 30 * exp(-2 * K * dt / link.c);
        assert_near("T1", pm_chain_temperature(&chain, z[1], 0), 295 + difference / 2, 1e-8);
        assert_near("T2", pm_chain_temperature(&chain, z[1], 1), 295 - difference / 2, 1e-8);
    }
}

static const pm_chain_link three[] = {
    {1, 0.03, 2, 0.09, 5}, {2, 0.2, 1, 0.07, 4}, {0.5, 0.1, 1.5, 0.05, 6}};
static const pm_chain three_links = {
    .n = 3, .conductivity = 2, .reference_temperature = 300, .link = three};

static void random_state(pm_rng *rng, double *z) {
    for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < 2; ++i) {
            z[pm_chain_q(k) + i] = 2 * (k + 1) + 0.5 * pm_rng_normal(rng);
            z[pm_chain_p(&three_links, k) + i] = 0.5 * pm_rng_normal(rng);
        }
        z[pm_chain_s(&three_links, k)] = 0.1 * pm_rng_normal(rng);
    }
}

static double energy_slope(const double *z, int i) {
    double moved[15];
    memcpy(moved, z, sizeof moved);
    const double h = 1e-5;
    moved[i] = z[i] + h;
    const double above = pm_chain_energy(&three_links, moved);
    moved[i] = z[i] - h;
    return (above - pm_chain_energy(&three_links, moved)) / (2 * h);
}

// qdot = dE/dp, pdot = -dE/dq, T = dE/ds, sum T sdot = 0 and sum sdot >= 0, by finite differences.
static void rate_follows_energy(void **state) {
    (void)state;
    pm_rng rng;
    pm_rng_init(&rng, 11, 0);
    for (int trial = 0; trial < 20; ++trial) {
        double z[15], zdot[15], heat = 0, production = 0;
        random_state(&rng, z);
        pm_chain_rate(&three_links, z, zdot);
        for (int i = 0; i < 6; ++i) {
            assert_near("qdot", zdot[i], energy_slope(z, 6 + i), 1e-7);
            assert_near("pdot", zdot[6 + i], -energy_slope(z, i), 1e-7);
        }
        for (int k = 0; k < 3; ++k) {
            const double T = pm_chain_temperature(&three_links, z, k);
            assert_near("T", energy_slope(z, 12 + k), T, 1e-6);
            heat += T * zdot[12 + k];
            production += zdot[12 + k];
        }
        assert_near("heat", heat, 0, 1e-12);
        assert_true(production > 0);
    }
}

static void laws_along_a_trajectory(void **state) {
    (void)state;
    enum { NTIME = 100 };
    static double z[2][NTIME][15];
    pm_rng rng;
    pm_rng_init(&rng, 12, 0);
    random_state(&rng, z[0][0]);
    memcpy(z[1][0], z[0][0], sizeof z[0][0]);
    solve(&three_links, adams, NTIME, 0.1, z[0][0]);
    solve(&three_links, bdf, NTIME, 0.1, z[1][0]);
    const double E = pm_chain_energy(&three_links, z[0][0]);
    const double L = pm_chain_angular_momentum(&three_links, z[0][0]);
    for (int i = 1; i < NTIME; ++i) {
        assert_near("energy", pm_chain_energy(&three_links, z[0][i]), E, 1e-10);
        assert_near("angular momentum", pm_chain_angular_momentum(&three_links, z[0][i]), L, 1e-10);
        assert_true(pm_chain_entropy(&three_links, z[0][i]) >
                    pm_chain_entropy(&three_links, z[0][i - 1]));
        for (int j = 0; j < 15; ++j) {
            assert_near("adams and bdf", z[1][i][j], z[0][i][j], 1e-8);
        }
    }
}

static void equilibrium(void **state) {
    (void)state;
    double z[15], zdot[15];
    pm_rng rng;
    pm_rng_init(&rng, 13, 0);
    random_state(&rng, z);
    pm_chain_equilibrate(&three_links, 0.25, z);
    assert_near("total entropy", pm_chain_entropy(&three_links, z), 0.25, 1e-15);
    pm_chain_rate(&three_links, z, zdot);
    for (int k = 0; k < 3; ++k) {
        assert_near("sdot", zdot[12 + k], 0, 1e-14);
    }
}

static void run_into_a_wall(const void *data, const double *z, double *zdot) {
    (void)data;
    zdot[0] = -1 + 0 * sqrt(z[0]); // not a number from t = z(0) on
}

static void failing_solver_is_reported(void **state) {
    (void)state;
    const pm_ode ode = {1, run_into_a_wall, NULL, NULL};
    double z[4] = {0.8};
    assert_int_equal(pm_ode_solve(&ode, adams, 4, 0.5, z), PM_ENUMERIC);
    assert_non_null(strstr(pm_error(), "between t = 0.5 and 1 s"));
    assert_near("before", z[1], 0.3, 1e-10);
}

// --- configurations ---

#define LINK                                            \
    "    - {mass: 1, C: 0.02, l0: 2, b: 0.09, c: 5, "   \
    "position: {mean: [4, 4], deviation: [0.1, 0.2]}, " \
    "momentum: {mean: [0, 1], deviation: [0.1, 0.1]}"
#define HEAD                                                                              \
    "simulator: pendulum_chain\nseed: 5\ntrajectories: 3\nstates: 20\ndt: 0.2\nsystem:\n" \
    "  reference_temperature: 300\n  conductivity: 1\n"
static const char good[] = HEAD "  links:\n" LINK ", temperature: {mean: 300, deviation: 1}}\n";

#define EQUAL                                           \
    "{mass: 1, C: 0.02, l0: 2, b: 0.09, c: 5, "         \
    "momentum: {mean: [0, 1], deviation: [0.1, 0.1]}, " \
    "temperature: {mean: 300, deviation: 1}, position: {deviation: [0.1, 0.2], mean: "

static pm_status load(scratch *folder, const char *text, pm_truth **truth) {
    const char *path = scratch_path(folder, "truth.yaml");
    scratch_write(path, text, strlen(text));
    return pm_truth_load(truth, path, NULL);
}

static void trajectories_are_their_own(void **state) {
    pm_truth *truth = NULL;
    double z[2][20][5], check[20][5];
    assert_int_equal(load(*state, good, &truth), PM_OK);
    assert_string_equal(truth->model.column[4], "s1");
    assert_string_equal(truth->model.units, "m;m;kg m/s;kg m/s;J/K");
    assert_int_equal(pm_truth_run(truth, 2, z[0][0], check[0]), PM_OK);
    assert_int_equal(pm_truth_run(truth, 1, z[1][0], check[0]), PM_OK);
    assert_true(z[0][0][0] != z[1][0][0]);
    assert_int_equal(pm_truth_run(truth, 2, z[1][0], check[0]), PM_OK);
    assert_memory_equal(z[0], z[1], sizeof z[0]);
    pm_truth_free(truth);
}

// An item with `count` stands for as many links, which are `spacing` apart.
static void equal_links_are_counted(void **state) {
    static const char *const text[] = {HEAD "  links:\n    - " EQUAL "[4, 4]}}\n    - " EQUAL
                                            "[6, 4]}}\n    - " EQUAL "[7.5, 4.25]}}\n    - " EQUAL
                                            "[9, 4.5]}}\n",
                                       HEAD "  links:\n    - " EQUAL "[4, 4]}}\n    - " EQUAL
                                            "[6, 4]}, count: 3, spacing: [1.5, 0.25]}\n"};
    double z[2][20][20], check[20][20];
    for (int i = 0; i < 2; ++i) {
        pm_truth *truth = NULL;
        if (load(*state, text[i], &truth) != PM_OK) {
            fail_msg("%s", pm_error());
        }
        assert_int_equal(truth->model.ode.nz, 20);
        assert_string_equal(truth->model.column[19], "s4");
        assert_non_null(strstr(truth->model.parameters, "link 1 to 4: m 1 kg"));
        assert_int_equal(pm_truth_run(truth, 1, z[i][0], check[0]), PM_OK);
        pm_truth_free(truth);
    }
    assert_memory_equal(z[0], z[1], sizeof z[0]);
}

static void report_tells_what_is_wrong(void **state) {
    pm_truth *truth = NULL;
    double z[20][5], check[20][5];
    pm_truth_report report;
    assert_int_equal(load(*state, good, &truth), PM_OK);
    assert_int_equal(pm_truth_run(truth, 0, z[0], check[0]), PM_OK);
    pm_truth_report_init(&report);
    pm_truth_report_add(&report, truth, z[0]);
    assert_true(pm_truth_difference(truth, z[0], check[0]) < 1e-12);
    assert_true(report.drift[0] < 1e-11 && report.drift[1] < 1e-11);
    z[19][2] += 1e-3;
    z[19][4] -= 1e-3;
    pm_truth_report_add(&report, truth, z[0]);
    assert_true(pm_truth_difference(truth, z[0], check[0]) > 1e-4);
    assert_true(report.drift[0] > 1e-5 && report.drift[1] > 1e-4);
    assert_near("smallest entropy step", report.entropy_step, -1e-3, 1e-12);
    assert_near("mean rise", report.entropy_rise, -0.5e-3, 1e-12);
    pm_truth_free(truth);
}

// --- a link under a load ---

#define DRIVEN(velocity, force, bath, frequency, spring)                                      \
    "simulator: driven_link\nseed: 7\ntrajectories: 3\nstates: 20\ndt: 0.2\nsystem:\n"        \
    "  reference_temperature: 300\n  conductivity: 2\n"                                       \
    "  link: {mass: 2, l0: 2, c: 5, " spring ", position: {mean: [4, 4], deviation: [1, 1]}," \
    " momentum: {mean: [0, 1], deviation: [1, 1]}, temperature: {mean: 290, deviation: 5}}\n" \
    "  load: {sines: 2, frequency: " frequency ", velocity: " velocity ", force: " force      \
    ", temperature: {mean: 310, deviation: " bath "}}\n"
#define SPRING "C: 0.1, b: 0.09"
enum { DRIVEN_NZ = 12 + 3 * 5 * 2 };

static void drive(scratch *folder, const char *text, int trajectory, double z[20][DRIVEN_NZ]) {
    pm_truth *truth = NULL;
    double check[20][DRIVEN_NZ];
    if (load(folder, text, &truth) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_int_equal(truth->model.ode.nz, DRIVEN_NZ);
    assert_int_equal(truth->model.ncolumn, 10);
    assert_int_equal(pm_truth_run(truth, trajectory, z[0], check[0]), PM_OK);
    pm_truth_free(truth);
}

// Relative to a pivot that moves steadily, a link moves as if the pivot were at rest; its momentum
// is larger by m v.
static void a_steady_pivot_is_at_rest(void **state) {
    double z[20][DRIVEN_NZ], still[20][5];
    drive(*state, DRIVEN("0.5", "0", "0", "[0, 0]", "C: 0.1, b: 0"), 1, z);
    const pm_chain_link link = {.mass = 2, .C = 0.1, .l0 = 2, .b = 0, .c = 5};
    const pm_chain chain = {.n = 1, .reference_temperature = 300, .link = &link};
    memcpy(still[0], z[0], sizeof still[0]);
    const double *v = z[0] + 5;
    assert_true(fabs(v[0]) > 0.01 && fabs(v[1]) > 0.01);
    still[0][2] -= 2 * v[0];
    still[0][3] -= 2 * v[1];
    solve(&chain, adams, 20, 0.2, still[0]);
    for (int j = 0; j < 20; ++j) {
        for (int i = 0; i < 2; ++i) {
            assert_near("q", z[j][i], still[j][i], 1e-10);
            assert_near("p", z[j][2 + i], still[j][2 + i] + 2 * v[i], 1e-10);
        }
        // Without thermal coupling the temperature decays to that of the bath.
        const double T = 300 * exp(z[j][4] / 5), T0 = 300 * exp(z[0][4] / 5);
        assert_near("T", T, 310 + (T0 - 310) * exp(-2 * 0.2 * j / 5), 1e-9);
    }
}

// Computes sine i of input k, whose oscillator starts at `start`, and its integral, at time t.
static double sine_of(const double *start, double t) {
    return start[0] * cos(start[2] * t) + start[1] * sin(start[2] * t);
}
static double integral_of(const double *start, double t) {
    return (start[0] * sin(start[2] * t) + start[1] * (1 - cos(start[2] * t))) / start[2];
}

// The inputs are sums of sines, and without a spring the momentum is the integral of the force.
static void loads_act_as_they_are_written(void **state) {
    double z[20][DRIVEN_NZ];
    drive(*state, DRIVEN("0.5", "0.3", "4", "[0.5, 2]", "C: 0, b: 0"), 2, z);
    for (int j = 0; j < 20; ++j) {
        for (int k = 0; k < 5; ++k) {
            double sum = k == 4 ? 310 : 0, integral = 0;
            for (int i = 0; i < 2; ++i) {
                const double *start = z[0] + 12 + 3 * (5 * i + k);
                sum += sine_of(start, 0.2 * j);
                integral += integral_of(start, 0.2 * j);
            }
            assert_near("load", z[j][5 + k], sum, 1e-11);
            if (k == 2 || k == 3) {
                assert_near("momentum", z[j][k], z[0][k] + integral, 1e-11);
            }
        }
    }
}

static void energy_with_the_world_is_kept(void **state) {
    static const char text[] = DRIVEN("0.5", "0.3", "4", "[0.5, 2]", SPRING);
    pm_truth *truth = NULL;
    double z[20][DRIVEN_NZ], check[20][DRIVEN_NZ];
    pm_truth_report report;
    pm_truth_report_init(&report);
    assert_int_equal(load(*state, text, &truth), PM_OK);
    for (int i = 0; i < 3; ++i) {
        assert_int_equal(pm_truth_run(truth, i, z[0], check[0]), PM_OK);
        pm_truth_report_add(&report, truth, z[0]);
        assert_true(pm_truth_difference(truth, z[0], check[0]) < 1e-11);
        assert_true(fabs(z[19][10]) > 1e-2 && fabs(z[19][11]) > 1e-5);
    }
    assert_true(report.drift[0] < 1e-12 * report.magnitude[0]);
    assert_true(report.entropy_step > 0);
    pm_truth_free(truth);
}

static void wrong_configurations(void **state) {
    static const struct {
        const char *text, *words;
    } cases[] = {
        {"simulator: pendulum\n", "seed"},
        {HEAD "  links: []\n", ":9:10: links: expected a list"},
        {HEAD "  links:\n" LINK "}\n", "temperature"},
        {HEAD "  total_entropy: 0\n  links:\n" LINK ", temperature: {mean: 1, deviation: 1}}\n",
         "`total_entropy` already sets the temperatures"},
        {HEAD "  links:\n" LINK ", temperature: {mean: [1, 2], deviation: 1}}\n",
         "mean: expected 1 number"},
        {HEAD "  links:\n" LINK ", colour: 1}\n", "colour"},
        {HEAD "  gravity: 9.81\n", "gravity"},
        {DRIVEN("0", "0", "0", "[1]", SPRING), "frequency: expected 2 numbers"},
        {DRIVEN("fast", "0", "0", "[0, 1]", SPRING), "velocity: expected a number"},
        {DRIVEN("0", "0", "0", "[0, 1]", SPRING ", colour: 1"), "colour"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        pm_truth *truth = NULL;
        const pm_status status = load(*state, cases[i].text, &truth);
        if (status != PM_ECONFIG || strstr(pm_error(), cases[i].words) == NULL) {
            fail_msg("case %zu: status %d, \"%s\", expected \"%s\"", i, status, pm_error(),
                     cases[i].words);
        }
        assert_null(truth);
    }
}

// The shipped configurations reproduce the shipped references.
static void shipped_configurations(void **state) {
    (void)state;
    static const char *const names[] = {"double_pendulum", "double_pendulum_fast"};
    static double z[200][10], check[200][10];
    for (int i = 0; i < 2; ++i) {
        char config[128], reference[128];
        pm_truth *truth = NULL;
        pm_dataset *data = NULL;
        snprintf(config, sizeof config, "configs/truth/%s.yaml", names[i]);
        snprintf(reference, sizeof reference, "configs/reference/%s.h5", names[i]);
        if (pm_truth_load(&truth, config, NULL) != PM_OK ||
            pm_dataset_load(&data, reference) != PM_OK) {
            fail_msg("%s", pm_error());
        }
        assert_int_equal(truth->ntrajectory, 50);
        assert_int_equal(data->ntrajectory, 1);
        assert_int_equal(truth->ntime, 200);
        assert_int_equal(data->ntime, 200);
        assert_int_equal(truth->model.ode.nz, 10);
        assert_int_equal(pm_truth_run(truth, 45, z[0], check[0]), PM_OK);
        assert_true(pm_truth_difference(truth, z[0], check[0]) < 1e-10);
        assert_true(pm_truth_difference(truth, z[0], data->z) < 1e-10);
        pm_dataset_free(data);
        pm_truth_free(truth);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(radial_period),
        cmocka_unit_test(circular_orbit),
        cmocka_unit_test(conduction_alone),
        cmocka_unit_test(rate_follows_energy),
        cmocka_unit_test(laws_along_a_trajectory),
        cmocka_unit_test(equilibrium),
        cmocka_unit_test(failing_solver_is_reported),
        cmocka_unit_test_setup_teardown(trajectories_are_their_own, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(equal_links_are_counted, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(report_tells_what_is_wrong, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(a_steady_pivot_is_at_rest, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(loads_act_as_they_are_written, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(energy_with_the_world_is_kept, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(wrong_configurations, scratch_setup, scratch_teardown),
        cmocka_unit_test(shipped_configurations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
