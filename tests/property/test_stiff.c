// Subsystems with given formulas instead of learned ones: two thermoelastic pendula whose weights
// are set by hand, against the simulator's own formulas; and the error of steps of 0.3 s as the
// conduction between them grows.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "sim/assembly.h"
#include "truth/chain.h"
#include "truth/ode.h"
#include "world.h"

#define NZ 10
#define SIZE 5 // of a link: q[2] p[2] s
#define DT 0.3
#define STEPS 40

static const char scene[] =
    "scene: pendula\n"
    "time: {dt: 0.3, steps: 40, integrator: discrete_gradient}\n"
    "subsystems:\n"
    "  upper: {weights: a.h5, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: "
    "J/K, size: 1}}}\n"
    "  lower: {weights: b.h5, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: "
    "J/K, size: 1}}}\n"
    "ports:\n"
    "  joint: {law: bracket, between: [upper, lower], weights: c.h5, expose: {upper: [q, p, s], "
    "lower: [q, p, s]}}\n";
// Kinetic; elastic; thermal, c Tr exp((s - b ln(l/l0))/c).
static const char link[] =
    "energy:\n"
    "  - {features: [\"|p|^2\"], skip: linear}\n"
    "  - {features: [\"ln|q|\"], skip: quadratic}\n"
    "  - {features: [\"ln|q|\", s], hidden: [1], activation: exp, skip: none}\n"
    "entropy: {given: s}\n"
    "reversible: {given: [[q, p, 1.0]]}\n";
static const char joint[] = "law: bracket\n"
                            "reversible: {given: [[a.p, b.q, 1.0]]}\n"
                            "irreversible: {learned: {acts_on: [a.s, b.s], rank: 1}}\n";

static pm_chain pendula(double K) {
    return (pm_chain){.n = 2,
                      .conductivity = K,
                      .reference_temperature = 300,
                      .link = {{.mass = 1, .C = 0.027, .l0 = 2, .b = 0.0869, .c = 5.08},
                               {.mass = 2, .C = 0.192, .l0 = 1, .b = 0.0869, .c = 5.08}}};
}

static void set(const pm_params *params, const char *name, int count, const double *value) {
    const pm_param_entry *entry = pm_params_find(params, name);
    assert_non_null(entry);
    assert_int_equal(entry->rows * entry->cols, count);
    memcpy(entry->value, value, (size_t)count * sizeof *value);
}

static void set_link(const pm_params *params, const pm_chain_link *l, double Tr) {
    const double half = 1 / (2 * l->mass), log_length = log(l->l0), elastic = l->C / 2;
    const double linear = l->b * Tr, thermal = l->c * Tr, nothing = 0, one = 1;
    set(params, "energy.0.mean", 1, &nothing);
    set(params, "energy.0.deviation", 1, &one);
    set(params, "energy.1.deviation", 1, &one);
    set(params, "energy.2.deviation", 2, (const double[]){1, 1});
    set(params, "energy.0.linear", 1, &half);
    set(params, "energy.1.mean", 1, &log_length);
    set(params, "energy.1.linear", 1, &linear);
    set(params, "energy.1.quadratic", 1, &elastic);
    set(params, "energy.2.mean", 2, (const double[]){log_length, 0});
    set(params, "energy.2.layer0.weight", 2, (const double[]){-l->b / l->c, 1 / l->c});
    set(params, "energy.2.layer0.bias", 1, &nothing);
    set(params, "energy.2.output.weight", 1, &thermal);
    set(params, "energy.2.output.bias", 1, (const double[]){-thermal});
}

// The world's two links and joint with the chain's constants. The learned constant is conduction
// K (T_b/T_a - 1), to the third order in the difference of the temperatures.
static void open_pendula(world *w, const pm_chain *chain) {
    world_of_text(w, 1, scene, link, joint);
    for (int i = 0; i < 2; ++i) {
        set_link(&w->system->part[i].params, &chain->link[i], chain->reference_temperature);
    }
    const double factor = sqrt(chain->conductivity);
    set(&w->system->port[0].params, "irreversible.scale", 2, (const double[]){1, 1});
    set(&w->system->port[0].params, "irreversible.matrix.constant", 2,
        (const double[]){factor, -factor});
}

// The chain's state q1 q2 p1 p2 s1 s2, absolute, as the world's.
static void to_world(const double *chain, double *z) {
    const double own[NZ] = {
        chain[0], chain[1], chain[4], chain[5], chain[8], chain[2] - chain[0], chain[3] - chain[1],
        chain[6], chain[7], chain[9]};
    memcpy(z, own, sizeof own);
}

// At one temperature of about 295 K.
static void start_of(const pm_chain *chain, double *z) {
    static const double start[NZ] = {4.46, 4.4, 1.79, 4.48, -0.524, 1.398, 1.408, -0.184, 0, 0};
    memcpy(z, start, sizeof start);
    pm_chain_equilibrate(chain, -0.03, z);
}

static void roll_out(const world *w, const double *start, const char *method, int substeps,
                     double z[STEPS + 1][NZ]) {
    w->scene->integrator = method;
    w->scene->substeps = substeps;
    pm_assembly *assembly = NULL;
    assert_int_equal(pm_assembly_open(&assembly, w->system), PM_OK);
    pm_assembly_set_state(assembly, start);
    for (int i = 0; i <= STEPS; ++i) {
        if (i > 0 && pm_assembly_step(assembly) != PM_OK) {
            world_fail(w, "%s", pm_error());
        }
        memcpy(z[i], pm_assembly_sample(assembly)->z, sizeof z[i]);
    }
    pm_assembly_close(assembly);
}

// Relative L2 error of the positions and momenta, or of the entropies, over a whole rollout.
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

// --- tests ---

static void chain_rate(const void *data, const double *z, double *zdot) {
    pm_chain_rate(data, z, zdot);
}

static void hand_set_weights_are_the_physics(void **state) {
    (void)state;
    const pm_chain chain = pendula(0.5);
    world w;
    double truth[STEPS + 1][NZ], expected[STEPS + 1][NZ], z[STEPS + 1][NZ];
    open_pendula(&w, &chain);
    start_of(&chain, truth[0]);
    const pm_ode ode = {NZ, chain_rate, &chain};
    assert_int_equal(
        pm_ode_solve(&ode, (pm_ode_method){PM_ODE_ADAMS, 1e-13, 1e-14}, STEPS + 1, DT, truth[0]),
        PM_OK);
    for (int i = 0; i <= STEPS; ++i) {
        to_world(truth[i], expected[i]);
    }
    roll_out(&w, expected[0], "rk6_balanced", 16, z);
    // The port's conduction is the simulator's to the third order in the temperatures.
    world_check(&w, "q and p", error_of(z, expected, false), 0, 1e-6);
    world_check(&w, "s", error_of(z, expected, true), 0, 5e-5);
    world_close(&w);
}

// The springs' temperatures relax to each other up to 1200 times per second, 350 times per step.
// Fast conduction moves twice the entropy that slow does.
static void stiff_conduction_costs_little_accuracy(void **state) {
    (void)state;
    static const double K[] = {0.5, 300, 3000}, most[] = {2, 2.5}; // of q and p, of s
    double slow[2] = {0, 0};
    for (size_t i = 0; i < sizeof K / sizeof *K; ++i) {
        const pm_chain chain = pendula(K[i]);
        world w;
        double start[NZ], absolute[NZ], exact[STEPS + 1][NZ], z[STEPS + 1][NZ];
        open_pendula(&w, &chain);
        start_of(&chain, absolute);
        to_world(absolute, start);
        roll_out(&w, start, "rk6", 512, exact);
        roll_out(&w, start, "discrete_gradient", 1, z);
        for (int group = 0; group < 2; ++group) {
            const double error = error_of(z, exact, group == 1);
            slow[group] = i == 0 ? error : slow[group];
            print_message("K = %g W/K: error of %s %.3g\n", K[i], group == 1 ? "s" : "q, p", error);
            if (!(error <= most[group] * slow[group])) {
                world_fail(&w, "more than %g times %g", most[group], slow[group]);
            }
        }
        world_close(&w);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(hand_set_weights_are_the_physics),
        cmocka_unit_test(stiff_conduction_costs_little_accuracy),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
