// Balanced integrators: the energy and entropy of every subsystem change by the sum of its fluxes.
// The totals therefore conserve energy and never lose entropy, to rounding, for any kind of entropy
// and any step.
#include <math.h>
#include <string.h>

#include "sim/invariant_projection.h"
#include "sim/monolithic.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define WORLDS 16
#define STEPS 20
// Of sums of numbers of order one.
#define ROUNDING 1e-13

// The largest departures of a rollout from what was booked, and from the laws.
typedef struct departure {
    double energy, entropy; // of a part, since the start
    double total;           // of the total energy
    double fall;            // of the total entropy over a step
} departure;

static double total(int n, const double *x) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += x[i];
    }
    return sum;
}

// What has flowed into part i during the step: its own terms, and its end of the port.
static double energy_of(const pm_sample *sample, int i) {
    return sample->bulk_energy[i] + sample->flux[0][i].energy;
}

static double entropy_of(const pm_sample *sample, int i) {
    return sample->bulk_entropy[i] + sample->flux[0][i].entropy;
}

static departure roll_out(const random_system *w, const char *integrator, double dt) {
    w->scene->physics.integrator = pm_integrator_find(integrator);
    w->scene->physics.dt = dt;
    w->scene->physics.substeps = 2;
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w->system), PM_OK);
    pm_monolithic_set_state(assembly, w->z);
    const pm_sample *sample = pm_monolithic_sample(assembly);
    double E[2], S[2];
    memcpy(E, sample->energy, sizeof E);
    memcpy(S, sample->entropy, sizeof S);
    const double start = total(2, E);
    departure d = {0, 0, 0, 0};
    for (int i = 0; i < STEPS; ++i) {
        const double before = total(2, sample->entropy);
        if (pm_monolithic_step(assembly) != PM_OK) {
            random_system_fail(w, "%s", pm_error());
        }
        sample = pm_monolithic_sample(assembly);
        for (int part = 0; part < 2; ++part) {
            E[part] += dt * energy_of(sample, part);
            S[part] += dt * entropy_of(sample, part);
            d.energy = fmax(d.energy, fabs(sample->energy[part] - E[part]));
            d.entropy = fmax(d.entropy, fabs(sample->entropy[part] - S[part]));
        }
        d.total = fmax(d.total, fabs(total(2, sample->energy) - start));
        d.fall = fmax(d.fall, before - total(2, sample->entropy));
    }
    pm_monolithic_close(assembly);
    return d;
}

// Links whose entropy is learned in part, as far from straight as any function of the state.
static void open_links(random_system *w, uint64_t seed, double size) {
    random_system_of_text(w, seed, random_system_scene, random_system_part, random_system_port);
    for (int i = 0; i < w->scene->physics.nz; ++i) {
        w->z[i] *= size;
    }
}

static void parts_have_what_was_booked(void **state) {
    (void)state;
    static const char *const integrator[] = {"rk4_balanced", "rk6_balanced"};
    double plain = 0;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        open_links(&w, seed, 0.3);
        const departure d = roll_out(&w, integrator[seed % 2], 0.002);
        random_system_check(&w, "E of a part", d.energy, 0, ROUNDING);
        random_system_check(&w, "S of a part", d.entropy, 0, ROUNDING);
        random_system_check(&w, "total E", d.total, 0, ROUNDING);
        random_system_check(&w, "fall of S", fmax(d.fall, 0), 0, ROUNDING);
        plain = fmax(plain, roll_out(&w, "rk4", 0.002).total);
        random_system_close(&w);
    }
    if (!(plain > 1e3 * ROUNDING)) {
        fail_msg("rk4 strays by %g only: nothing was tested", plain);
    }
}

// Energy and entropy that depend on one variable alone: there is nowhere to move, and the step is
// that of the plain method.
static void what_cannot_move_stays(void **state) {
    (void)state;
    static const char bodies[] =
        "scene: bodies\n"
        "time: {dt: 0.1, steps: 20, integrator: rk4}\n"
        "subsystems:\n"
        "  a: {weights: a.h5, state: {s: {unit: J/K, size: 1}}}\n"
        "  b: {weights: b.h5, state: {s: {unit: J/K, size: 1}}}\n"
        "ports:\n"
        "  contact: {law: bracket, between: [a, b], weights: c.h5, expose: {a: [s], b: [s]}}\n";
    static const char body[] = "energy: [{given: {s: 3.0}}, {features: [s], skip: quadratic}]\n"
                               "entropy: {given: s}\n";
    static const char contact[] =
        "law: bracket\nirreversible: {learned: {acts_on: [a.s, b.s], rank: 1}}\n";
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, bodies, body, contact);
        const departure plain = roll_out(&w, "rk4", 0.01);
        const departure d = roll_out(&w, "rk4_balanced", 0.01);
        random_system_check(&w, "total E", d.total, plain.total, 0);
        random_system_check(&w, "fall of S", d.fall, plain.fall, 0);
        random_system_close(&w);
    }
}

// A tenth of the step is made good; twice the step is not, and is not asked for again.
static void what_is_too_far_is_written_off(void **state) {
    (void)state;
    const pm_layout layout = {
        .ngroup = 1, .nz = 2, .group = (pm_group[]){{"x", "m", 2, 0, PM_ROLE_OTHER, false}}};
    static const double start[2] = {0, 0}, dE[2] = {1, 0};
    const random_system nameless = {.seed = 0};
    double z[2] = {0.1, 0};
    pm_invariant_projection balance;
    pm_invariant_projection_start(&balance, 1, 0);
    assert_true(
        pm_invariant_projection_newton_step(&balance, &layout, start, 1.01, 0, dE, NULL, z));
    random_system_check(&nameless, "x", z[0], 0.09, 1e-15);
    assert_false(pm_invariant_projection_newton_step(&balance, &layout, start, 1, 0, dE, NULL, z));
    assert_true(balance.energy == 1);
    assert_false(
        pm_invariant_projection_newton_step(&balance, &layout, start, 1.2, 0, dE, NULL, z));
    random_system_check(&nameless, "x", z[0], 0.09, 1e-15);
    assert_true(balance.energy == 1.2);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_too_far_is_written_off),
        cmocka_unit_test(parts_have_what_was_booked),
        cmocka_unit_test(what_cannot_move_stays),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
