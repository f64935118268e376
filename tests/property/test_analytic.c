// Subsystems with given formulas in place of learned ones: two thermoelastic pendula are compared
// with the truth simulator, also with steps of 0.3 s and growing conduction between them; friction
// and conduction are compared with formulas.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sim/monolithic.h"
#include "tests/support/unit.h"
#include "truth/chain.h"
#include "truth/ode.h"

#define NZ 10
#define SIZE 5 // components of a link: q[2] p[2] s
#define DT 0.3
#define STEPS 40

// configs/analytic_double_pendulum.yaml with a conductivity of its own.
static const char scene_format[] =
    "scene: pendula\n"
    "time: {dt: 0.3, steps: 40, integrator: rk4}\n"
    "models:\n"
    "  link:\n"
    "    constants: {b: 0.0869, c: 5.08, Tr: 300}\n"
    "    energy:\n"
    "      - \"|p|^2/(2*m)\"\n"
    "      - \"C/2*ln(|q|/l0)^2 + b*Tr*ln(|q|/l0)\"\n"
    "      - \"c*Tr*(exp((s - b*ln(|q|/l0))/c) - 1)\"\n"
    "    entropy: s\n"
    "    reversible: {given: [[q, p, 1.0]]}\n"
    "  joint:\n"
    "    law: bracket\n"
    "    reversible: {given: [[a.p, b.q, 1.0]]}\n"
    "    irreversible: {given: [[a.s, b.s, \"K*b.dE.s/a.dE.s\"]]}\n"
    "subsystems:\n"
    "  upper: {model: link, constants: {m: 1, C: 0.027, l0: 2}, state: {q: {unit: m, size: 2},\n"
    "          p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n"
    "  lower: {model: link, constants: {m: 2, C: 0.192, l0: 1}, state: {q: {unit: m, size: 2},\n"
    "          p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  joint: {law: bracket, between: [upper, lower], model: joint, constants: {K: %g},\n"
    "          expose: {upper: [p, s], lower: [q, s]}}\n";

typedef struct pendula {
    pm_chain chain;
    pm_scene *scene;
    pm_system *system;
} pendula;

static const pm_chain_link two_links[] = {{.mass = 1, .C = 0.027, .l0 = 2, .b = 0.0869, .c = 5.08},
                                          {.mass = 2, .C = 0.192, .l0 = 1, .b = 0.0869, .c = 5.08}};

static void pendula_open(pendula *p, double K) {
    char text[4096];
    snprintf(text, sizeof text, scene_format, K);
    *p = (pendula){
        .chain = {.n = 2, .conductivity = K, .reference_temperature = 300, .link = two_links}};
    require(pm_scene_parse(&p->scene, text, "pendula.yaml"));
    require(pm_system_load(&p->system, p->scene, NULL));
}

static void pendula_close(pendula *p) {
    pm_system_free(p->system);
    pm_scene_free(p->scene);
}

// Converts the absolute state q1 q2 p1 p2 s1 s2 of the chain into that of the scene.
static void to_scene(const double *chain, double *z) {
    const double own[NZ] = {
        chain[0], chain[1], chain[4], chain[5], chain[8], chain[2] - chain[0], chain[3] - chain[1],
        chain[6], chain[7], chain[9]};
    memcpy(z, own, sizeof own);
}

// Draws a state with equal temperatures of about 295 K.
static void start_of(const pm_chain *chain, double *z) {
    static const double start[NZ] = {4.46, 4.4, 1.79, 4.48, -0.524, 1.398, 1.408, -0.184, 0, 0};
    memcpy(z, start, sizeof start);
    pm_chain_equilibrate(chain, -0.03, z);
}

static void roll_out(const pendula *p, const double *start, const char *method, int substeps,
                     double z[STEPS + 1][NZ]) {
    p->scene->physics.integrator = pm_integrator_find(method);
    p->scene->physics.substeps = substeps;
    pm_monolithic *assembly = NULL;
    require(pm_monolithic_open(&assembly, p->system));
    pm_monolithic_set_state(assembly, start);
    for (int i = 0; i <= STEPS; ++i) {
        require(i > 0 ? pm_monolithic_step(assembly) : PM_OK);
        memcpy(z[i], pm_monolithic_sample(assembly)->z, sizeof z[i]);
    }
    pm_monolithic_close(assembly);
}

// Returns the relative L2 error of positions and momenta, or of entropies, over a rollout.
static double error_of(double z[STEPS + 1][NZ], double exact[STEPS + 1][NZ], bool entropy) {
    double difference = 0, size = 0;
    for (int i = 0; i <= STEPS; ++i) {
        for (int c = 0; c < NZ; ++c) {
            if ((c % SIZE == SIZE - 1) == entropy) {
                difference += (z[i][c] - exact[i][c]) * (z[i][c] - exact[i][c]);
                size += exact[i][c] * exact[i][c];
            }
        }
    }
    return sqrt(difference / size);
}

static void chain_rate(const void *data, const double *z, double *zdot) {
    pm_chain_rate(data, z, zdot);
}

// Computes the motion of the pendula with the truth simulator.
static void simulate(const pendula *p, double z[STEPS + 1][NZ]) {
    double truth[STEPS + 1][NZ];
    const pm_ode ode = {NZ, chain_rate, &p->chain, NULL};
    const pm_ode_family family = p->chain.conductivity > 1 ? PM_ODE_BDF : PM_ODE_ADAMS;
    start_of(&p->chain, truth[0]);
    require(pm_ode_solve(&ode, (pm_ode_method){family, 1e-12, 1e-13}, STEPS + 1, DT, truth[0]));
    for (int i = 0; i <= STEPS; ++i) {
        to_scene(truth[i], z[i]);
    }
}

// --- tests ---

// Scene and simulator share no code, so that they differ only by the errors of their integrators.
static void formulas_are_the_physics(void **state) {
    (void)state;
    static const struct {
        const char *method;
        int substeps;
        double least, most; // the factor by which halving the step divides the error
    } methods[] = {{"heun", 8, 3.5, 4.5}, {"rk4", 4, 14, 20}, {"discrete_gradient", 4, 3.5, 4.5}};
    pendula p;
    double truth[STEPS + 1][NZ], z[STEPS + 1][NZ];
    pendula_open(&p, 0.5);
    simulate(&p, truth);
    for (size_t i = 0; i < sizeof methods / sizeof *methods; ++i) {
        double error[2][2];
        for (int half = 0; half < 2; ++half) {
            roll_out(&p, truth[0], methods[i].method, methods[i].substeps << half, z);
            error[half][0] = error_of(z, truth, false);
            error[half][1] = error_of(z, truth, true);
        }
        for (int group = 0; group < 2; ++group) {
            const double ratio = error[0][group] / error[1][group];
            print_message("%s: errors of %s %.3g, %.3g\n", methods[i].method,
                          group == 1 ? "s" : "q, p", error[0][group], error[1][group]);
            if (!(ratio >= methods[i].least && ratio <= methods[i].most)) {
                fail_msg("%s: halving the step divides the error by %g, expected %g to %g",
                         methods[i].method, ratio, methods[i].least, methods[i].most);
            }
        }
    }
    roll_out(&p, truth[0], "rk6", 32, z);
    if (!(error_of(z, truth, false) < 1e-9 && error_of(z, truth, true) < 1e-9)) {
        fail_msg("rk6: errors %g and %g", error_of(z, truth, false), error_of(z, truth, true));
    }
    pendula_close(&p);
}

static const char rubbing[] =
    "scene: rubbing\n"
    "time: {dt: 0.1, steps: 1, integrator: discrete_gradient}\n"
    "models:\n"
    "  rubbed:\n"
    "    constants: {m: 2, k: 3, mu: 0.4, c: 5, Tr: 300}\n"
    "    energy: [\"|p|^2/(2*m) + k/2*|q|^2\", \"c*Tr*exp(s/c)\"]\n"
    "    entropy: s\n"
    "    reversible: {given: [[q, p, 1]]}\n"
    "    irreversible: {given: [[p, s, \"mu*dE.s\"]]}\n"
    "  bath: {energy: \"1000*exp(s/4)\", entropy: s}\n"
    "  wire: {law: bracket, irreversible: {given: [[a.s, b.s, \"0.7*b.dE.s/a.dE.s\"]]}}\n"
    "subsystems:\n"
    "  body: {model: rubbed, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2},\n"
    "         s: {unit: J/K, size: 1}}}\n"
    "  bath: {model: bath, state: {s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  wire: {law: bracket, between: [body, bath], model: wire, expose: {body: s, bath: s}}\n";

// Checks the rates of the first small step against the formulas, and both laws.
static void check_first_step(pm_monolithic *tiny, double dt, const double start[6]) {
    const double T[] = {300 * exp(0.1 / 5), 250 * exp(-0.2 / 4)}, v2 = 13.0 / 4;
    const pm_sample *s = pm_monolithic_sample(tiny);
    const double heat = 0.7 * (T[1] - T[0]);
    const double expected[] = {
        1.5, 1, -3 - 0.4 * 1.5, 1.5 - 0.4 * 1, (0.4 * v2 + heat) / T[0], -heat / T[1]};
    for (int c = 0; c < 6; ++c) {
        const double rate = (s->z[c] - start[c]) / dt;
        if (!(fabs(rate - expected[c]) < 1e-8)) {
            fail_msg("component %d: rate %g, expected %g", c, rate, expected[c]);
        }
    }
    assert_true(fabs(s->bulk_energy[0]) < 1e-14 && s->bulk_entropy[0] > 0);
    assert_true(fabs(s->flux[0][0].energy + s->flux[0][1].energy) < 1e-13);
    assert_true(s->flux[0][0].entropy + s->flux[0][1].entropy > 0);
}

// Checks that 200 steps keep the energy and do not lower the entropy.
static void check_laws(pm_monolithic *assembly) {
    for (int i = 0; i < 200; ++i) {
        const pm_sample before = *pm_monolithic_sample(assembly);
        const double E = before.energy[0] + before.energy[1];
        const double S = before.entropy[0] + before.entropy[1];
        require(pm_monolithic_step(assembly));
        const pm_sample *after = pm_monolithic_sample(assembly);
        assert_true(fabs(after->energy[0] + after->energy[1] - E) < 1e-9);
        assert_true(after->entropy[0] + after->entropy[1] >= S);
    }
}

// A mass on a spring has friction in one bath and heats another through a wire. Friction and
// conduction agree with formulas, and both laws hold to rounding.
static void given_pairs_dissipate(void **state) {
    (void)state;
    static const double start[] = {1, -0.5, 3, 2, 0.1, -0.2};
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_monolithic *assembly = NULL;
    require(pm_scene_parse(&scene, rubbing, "rubbing.yaml"));
    require(pm_system_load(&system, scene, NULL));
    require(pm_monolithic_open(&assembly, system));
    pm_monolithic_set_state(assembly, start);
    scene->physics.integrator = pm_integrator_find("euler");
    scene->physics.dt = 1e-6;
    pm_monolithic *tiny = NULL;
    require(pm_monolithic_open(&tiny, system));
    pm_monolithic_set_state(tiny, start);
    require(pm_monolithic_step(tiny));
    check_first_step(tiny, scene->physics.dt, start);
    check_laws(assembly);
    pm_monolithic_close(tiny);
    pm_monolithic_close(assembly);
    pm_system_free(system);
    pm_scene_free(scene);
}

// The temperatures of the springs relax at a rate of up to 1200 per second, that is 350 per step.
// Pendula with fast conduction obey other equations, for which a method of second order has a
// larger error with steps of any length. Steps that resolve the exchange show by how much.
static void stiffness_costs_no_accuracy(void **state) {
    (void)state;
    static const double K[] = {0.5, 300, 3000};
    static const int substeps[] = {1, 128};
    double error[3][2][2]; // by K, substeps, group
    for (int i = 0; i < 3; ++i) {
        pendula p;
        double truth[STEPS + 1][NZ], z[STEPS + 1][NZ];
        pendula_open(&p, K[i]);
        simulate(&p, truth);
        for (int n = 0; n < 2; ++n) {
            roll_out(&p, truth[0], "discrete_gradient", substeps[n], z);
            error[i][n][0] = error_of(z, truth, false);
            error[i][n][1] = error_of(z, truth, true);
            print_message("K = %g W/K, %d substeps: errors of q, p %.3g, of s %.3g\n", K[i],
                          substeps[n], error[i][n][0], error[i][n][1]);
        }
        pendula_close(&p);
        for (int group = 0; group < 2; ++group) {
            const double stiff = error[i][0][group] / error[0][0][group];
            const double resolved = error[i][1][group] / error[0][1][group];
            if (!(stiff <= 1.1 * resolved && stiff <= 2.5)) {
                fail_msg("K = %g W/K: %g times the error of slow conduction, with steps that "
                         "resolve the exchange %g times",
                         K[i], stiff, resolved);
            }
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(formulas_are_the_physics),
        cmocka_unit_test(given_pairs_dissipate),
        cmocka_unit_test(stiffness_costs_no_accuracy),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
