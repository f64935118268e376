// Proposals of training files from data of driven systems: regressions of rates leave out what
// boundary inputs contribute, and conservation of angular momentum leaves out their moments.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "propose/look.h"
#include "tests/support/proposal.h"
#include "tests/support/unit.h"

// --- driven systems ---

#define MOST 8 // variables and inputs of a system

// A system with nz variables z and inputs u, which are the columns behind those of z.
typedef struct driven {
    int nz, ncolumn;
    const char *const *column;
    void (*input)(int trajectory, double t, const double *z, double *u);
    void (*rate)(const double *z, const double *u, double *rate);
    void (*start)(int trajectory, double *z);
} driven;

static void step(const driven *s, int trajectory, double t, double h, double *z) {
    static const double at[4] = {0, 0.5, 0.5, 1}, weight[4] = {1, 2, 2, 1};
    double u[MOST], k[MOST] = {0}, sum[MOST] = {0}, y[MOST];
    for (int stage = 0; stage < 4; ++stage) {
        for (int c = 0; c < s->nz; ++c) {
            y[c] = z[c] + h * at[stage] * k[c];
        }
        s->input(trajectory, t + at[stage] * h, y, u);
        s->rate(y, u, k);
        for (int c = 0; c < s->nz; ++c) {
            sum[c] += weight[stage] * k[c] / 6;
        }
    }
    for (int c = 0; c < s->nz; ++c) {
        z[c] += h * sum[c];
    }
}

static pm_dataset *simulate(const driven *s, double dt) {
    enum { TRAJECTORIES = 6, STATES = 80, FINE = 10 };
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, TRAJECTORIES, STATES, s->ncolumn, dt, s->column), PM_OK);
    for (int i = 0; i < TRAJECTORIES; ++i) {
        double z[MOST];
        s->start(i, z);
        for (int j = 0; j < STATES; ++j) {
            double *row = pm_dataset_state(d, i, j);
            memcpy(row, z, (size_t)s->nz * sizeof *z);
            s->input(i, j * dt, z, row + s->nz);
            for (int k = 0; k < FINE; ++k) {
                step(s, i, j * dt + k * dt / FINE, dt / FINE, z);
            }
        }
    }
    return d;
}

// --- a link on a moving pivot ---

static void link_start(int i, double *z) {
    memcpy(z, (const double[]){2 + 0.2 * i, 0.5 - 0.3 * i, 0.2 * i - 1, 1 - 0.1 * i, 0.02 * i},
           5 * sizeof *z);
}

// The velocity of the pivot, the force of the hand and the temperature of the bath.
static void link_input(int i, double t, const double *z, double *u) {
    (void)z;
    for (int c = 0; c < 4; ++c) {
        u[c] = (c < 2 ? 0.5 : 0.8) * sin((0.7 + 0.3 * c + 0.1 * i) * t + 2 * c + i);
    }
    u[4] = 300 + 5 * sin(0.9 * t + i);
}

// A mass of 2 kg on a spring; `side` is the stiffness of another one along the first axis.
static void link_rate(const double *z, const double *u, double side, double *rate) {
    const double length = hypot(z[0], z[1]), T = 300 * exp(z[4] / 3);
    const double tension = 3 * (length - 1) + (length - 1) * (length - 1) * (length - 1);
    rate[0] = z[2] / 2 - u[0];
    rate[1] = z[3] / 2 - u[1];
    rate[2] = -tension * z[0] / length - side * z[0] - u[2];
    rate[3] = -tension * z[1] / length - u[3];
    rate[4] = 0.5 * (u[4] - T) / T;
}

static void free_rate(const double *z, const double *u, double *rate) {
    link_rate(z, u, 0, rate);
}

// A spring whose energy is quadratic in the logarithm of its length.
static void stretched_rate(const double *z, const double *u, double *rate) {
    const double length = hypot(z[0], z[1]);
    link_rate(z, u, 0, rate);
    for (int c = 0; c < 2; ++c) {
        rate[2 + c] = -5 * log(length) * z[c] / (length * length) - u[2 + c];
    }
}

// The mass slides on a viscous table.
static void slowed_rate(const double *z, const double *u, double *rate) {
    link_rate(z, u, 0, rate);
    for (int c = 0; c < 2; ++c) {
        const double v = z[2 + c] / 2;
        rate[2 + c] -= 0.2 * v;
        rate[4] += 0.2 * v * v / (300 * exp(z[4] / 3));
    }
}

static void sided_rate(const double *z, const double *u, double *rate) {
    link_rate(z, u, 1, rate);
}

static const char *const link_column[] = {"x", "y", "px", "py", "s", "vx", "vy", "fx", "fy", "T"};

#define LINK                                                             \
    "scene: driven\n"                                                    \
    "time: {dt: 0.1, steps: 79, integrator: rk4, substeps: 4}\n"         \
    "subsystems:\n"                                                      \
    "  link:\n"                                                          \
    "    weights: link.h5\n"                                             \
    "    state:\n"                                                       \
    "      q: {unit: m, columns: [x, y]}\n"                              \
    "      p: {unit: kg m/s, columns: [px, py]}\n"                       \
    "      s: {unit: J/K, columns: [s]}\n"                               \
    "boundary_inputs:\n"                                                 \
    "  pivot:\n"                                                         \
    "    p: {unit: kg m/s, dE: [vx, vy]}\n"                              \
    "    s: {unit: J/K, dE: [T], dS: [1]}\n"                             \
    "  hand: {q: {unit: m, dE: [fx, fy]}}\n"                             \
    "ports:\n"                                                           \
    "  base: {law: bracket, between: [pivot, link], weights: base.h5,\n" \
    "         expose: {pivot: [p, s], link: [q, s]}}\n"                  \
    "  tip: {law: bracket, between: [link, hand], weights: tip.h5,\n"    \
    "        expose: {link: [p], hand: [q]}}\n"

static void propose_link(void (*rate)(const double *, const double *, double *),
                         char text[PM_PROPOSAL_TEXT]) {
    const driven system = {5, 10, link_column, link_input, rate, link_start};
    pm_dataset *d = simulate(&system, 0.1);
    propose_text(LINK, d, text);
    pm_dataset_free(d);
}

// The pivot's velocity moves q beside the momentum, and both inputs turn the mass.
static void a_driven_link_shows_its_kinetic_energy_and_its_symmetry(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose_link(free_rate, text);
    assert_proposal_says(text, "its rate is linear in momenta");
    assert_proposal_says(text, "- {features: [\"|p|^2\"], skip: linear}");
    assert_proposal_says(text, "inputs alone change the sum of q x p");
    assert_proposal_says(text, "- {features: [\"|q|\"], hidden");
}

// The force along the spring shows on which function of its length the energy depends.
static void a_force_shows_a_logarithm(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose_link(stretched_rate, text);
    assert_proposal_says(text, "- {features: [\"ln|q|\"], hidden");
    assert_proposal_says(text, "- {features: [\"ln|q|\", s], rising: true, hidden");
}

static void friction_has_no_direction(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose_link(slowed_rate, text);
    assert_proposal_says(text, "# Friction and boundary inputs alone change the sum of q x p");
}

static void a_spring_along_one_axis_has_a_direction(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    propose_link(sided_rate, text);
    assert_proposal_says(text, "- {features: [\"|p|^2\"], skip: linear}");
    assert_proposal_omits(text, "the sum of q x p");
    assert_proposal_says(text, "- {features: [q], hidden");
}

// --- a motor with a prescribed voltage ---

static void motor_start(int i, double *z) {
    memcpy(z, (const double[]){0.3 * i - 0.8, 1 - 0.3 * i, 0.2 * i - 0.5, 0}, 4 * sizeof *z);
}

static void motor_input(int i, double t, const double *z, double *u) {
    (void)z;
    u[0] = 6 * sin((2 + 0.3 * i) * t + i) + 4 * cos((1.1 - 0.1 * i) * t);
}

// The voltage that a controller sets: it brakes by the angular momentum.
static void braked_input(int i, double t, const double *z, double *u) {
    (void)i;
    (void)t;
    u[0] = -0.4 * z[1];
}

// An angle, an angular momentum, a flux that decays by 8 per s, and the heat of the winding.
static void motor_rate(const double *z, const double *u, double *rate) {
    const double w = z[1] / 1.5, current = z[2] / 0.25, torque = 2 * z[0] + z[0] * z[0] * z[0];
    rate[0] = w;
    rate[1] = -torque + 0.7 * current;
    rate[2] = u[0] - 2 * current - 0.7 * w;
    rate[3] = 2 * current * current / 300;
}

static const char *const motor_column[] = {"theta", "L", "phi", "s", "V"};

#define MOTOR                                                                \
    "scene: motor\n"                                                         \
    "time: {dt: 0.03, steps: 79, integrator: rk4, substeps: 4}\n"            \
    "subsystems:\n"                                                          \
    "  motor:\n"                                                             \
    "    weights: motor.h5\n"                                                \
    "    state:\n"                                                           \
    "      theta: {unit: rad, columns: [theta]}\n"                           \
    "      L: {unit: kg m^2/s, columns: [L]}\n"                              \
    "      phi: {unit: Wb, columns: [phi]}\n"                                \
    "      s: {unit: J/K, columns: [s]}\n"                                   \
    "boundary_inputs:\n"                                                     \
    "  supply: {Q: {unit: C, dE: [V]}}\n"                                    \
    "ports:\n"                                                               \
    "  leads: {law: bracket, between: [supply, motor], weights: leads.h5,\n" \
    "          expose: {supply: [Q], motor: [phi]}}\n"

// The voltage hides neither that the flux and the angular momentum drive each other, nor how fast
// the current decays.
static void a_fed_motor_shows_its_coupling_and_its_decay(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    const driven system = {4, 5, motor_column, motor_input, motor_rate, motor_start};
    pm_dataset *d = simulate(&system, 0.03);
    propose_text(MOTOR, d, text);
    assert_proposal_says(text, "- {features: [\"|L|^2\"], skip: linear}");
    assert_proposal_says(text, "learned: {acts_on: [L, phi]}");
    pm_scene *scene = NULL;
    pm_look look;
    assert_int_equal(pm_scene_parse(&scene, MOTOR, "motor.yaml"), PM_OK);
    assert_int_equal(pm_look_make(&look, scene, d), PM_OK);
    const double decay = look.decay;
    if (!(fabs(decay - 8) < 0.4)) {
        fail_msg("a decay of %.3g per s, expected 8 within 0.4", decay);
    }
    pm_look_free(&look);
    pm_scene_free(scene);
    pm_dataset_free(d);
}

// A controller sets the voltage as the state demands, so that the voltage alone explains the rate
// of the angle.
static void an_input_that_follows_the_state_hides_nothing(void **state) {
    (void)state;
    char text[PM_PROPOSAL_TEXT];
    const driven system = {4, 5, motor_column, braked_input, motor_rate, motor_start};
    pm_dataset *d = simulate(&system, 0.03);
    propose_text(MOTOR, d, text);
    assert_proposal_says(text, "- {features: [\"|L|^2\"], skip: linear}");
    pm_dataset_free(d);
}

// A message names the column of an input that the data lack.
static void a_missing_input_is_named(void **state) {
    (void)state;
    static const char *const column[] = {"theta", "L", "phi", "s", "U"};
    const driven system = {4, 5, column, motor_input, motor_rate, motor_start};
    pm_dataset *d = simulate(&system, 0.03);
    pm_scene *scene = NULL;
    pm_look look;
    assert_int_equal(pm_scene_parse(&scene, MOTOR, "motor.yaml"), PM_OK);
    assert_int_equal(pm_look_make(&look, scene, d), PM_EDATA);
    assert_proposal_says(pm_error(), "column \"V\" is not in the dataset");
    pm_scene_free(scene);
    pm_dataset_free(d);
}

// --- a planet and a moon ---

// Relative position and momentum, the spin of the planet and the heat of the tides. What the orbit
// loses the spin gains.
static void tide_rate(const double *z, const double *u, double *rate) {
    (void)u;
    const double square = z[0] * z[0] + z[1] * z[1], pull = pow(square, -1.5);
    const double slip = (z[0] * z[3] - z[1] * z[2]) / square - z[4] / 0.3;
    const double torque = 0.005 * slip / square;
    rate[0] = z[2];
    rate[1] = z[3];
    rate[2] = -pull * z[0] + torque * z[1] / square;
    rate[3] = -pull * z[1] - torque * z[0] / square;
    rate[4] = torque;
    rate[5] = torque * slip / 300;
}

static void moon_start(int i, double *z) {
    memcpy(z, (const double[]){1 + 0.05 * i, 0.1 * i, -0.1 * i, 1 - 0.03 * i, 0.1 * i, 0},
           6 * sizeof *z);
}

static void no_input(int i, double t, const double *z, double *u) {
    (void)i, (void)t, (void)z, (void)u;
}

// The orbit alone loses angular momentum; with the spin it does not.
static void a_spin_makes_up_for_the_angular_momentum_of_an_orbit(void **state) {
    (void)state;
    static const char *const column[] = {"x", "y", "px", "py", "L", "s"};
    static const char scene[] = "scene: orbit\n"
                                "time: {dt: 0.1, steps: 79, integrator: rk4, substeps: 4}\n"
                                "subsystems:\n"
                                "  pair:\n"
                                "    weights: pair.h5\n"
                                "    state:\n"
                                "      q: {unit: m, columns: [x, y]}\n"
                                "      p: {unit: kg m/s, columns: [px, py]}\n"
                                "      L: {unit: mN m s, columns: [L]}\n"
                                "      s: {unit: J/K, columns: [s]}\n";
    char text[PM_PROPOSAL_TEXT];
    const driven system = {6, 6, column, no_input, tide_rate, moon_start};
    pm_dataset *d = simulate(&system, 0.1);
    propose_text(scene, d, text);
    assert_proposal_says(text, "# The sum of q x p is conserved");
    assert_proposal_says(text, "- {features: [\"ln|q|\", L], hidden");
    for (int i = 0; i < d->ntrajectory * d->ntime; ++i) {
        d->z[i * 6 + 4] = sin(i);
    }
    propose_text(scene, d, text);
    assert_proposal_omits(text, "# The sum of q x p is conserved");
    pm_dataset_free(d);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_driven_link_shows_its_kinetic_energy_and_its_symmetry),
        cmocka_unit_test(a_force_shows_a_logarithm),
        cmocka_unit_test(friction_has_no_direction),
        cmocka_unit_test(a_spring_along_one_axis_has_a_direction),
        cmocka_unit_test(a_spin_makes_up_for_the_angular_momentum_of_an_orbit),
        cmocka_unit_test(a_fed_motor_shows_its_coupling_and_its_decay),
        cmocka_unit_test(an_input_that_follows_the_state_hides_nothing),
        cmocka_unit_test(a_missing_input_is_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
