// Multirate integrators: a fast vibration that warms a slow bath by friction takes substeps of its
// own between exchanges. Accuracy improves, and the fluxes stay exact.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "sim/ledger.h"
#include "sim/monolithic.h"

// 40 radians per exchange step. The bath is two-dimensional, lest there be nowhere to move it.
static const char text[] =
    "scene: vibration\n"
    "time: {dt: 1.0, steps: 10, integrator: multirate3}\n"
    "models:\n"
    "  body:\n"
    "    constants: {m: 0.5, k: 800, mu: 0.05, c: 5, Tr: 300}\n"
    "    energy: [\"|p|^2/(2*m) + k/2*|q|^2\", \"c*Tr*exp(s/c)\"]\n"
    "    entropy: s\n"
    "    reversible: {given: [[q, p, 1]]}\n"
    "    irreversible: {given: [[p, s, \"mu*dE.s\"]]}\n"
    "  bath:\n"
    "    energy: [\"1000*exp(s/4)\", \"q^2/2 + p^2/2\"]\n"
    "    entropy: s\n"
    "    reversible: {given: [[q, p, 1]]}\n"
    "  wire: {law: bracket, irreversible: {given: [[a.s, b.s, \"0.7*b.dE.s/a.dE.s\"]]}}\n"
    "subsystems:\n"
    "  body: {model: body, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2},\n"
    "         s: {unit: J/K, size: 1}}}\n"
    "  bath: {model: bath, state: {q: {unit: m, size: 1}, p: {unit: kg m/s, size: 1},\n"
    "         s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  wire: {law: bracket, between: [body, bath], model: wire, expose: {body: s, bath: s}}\n";
#define NZ 8
static const double start[NZ] = {0.3, -0.1, 5, 2, 0.1, 0.5, 0, -0.2};

typedef struct setting {
    const char *integrator;
    int substeps, own; // exchange steps per step; steps of the body per interval
} setting;

typedef struct outcome {
    double z[NZ];
    double drift, fall, residual; // of the energy, of the entropy, of the exchange's balance
} outcome;

static void require(pm_status status) {
    if (status != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

static outcome roll_out(setting how) {
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_monolithic *assembly = NULL;
    pm_ledger ledger;
    outcome o;
    require(pm_scene_parse(&scene, text, "vibration.yaml"));
    require(pm_system_load(&system, scene, NULL));
    scene->integrator = pm_integrator_find(how.integrator);
    scene->substeps = how.substeps;
    scene->subsystem[0].substeps = how.own;
    require(pm_monolithic_open(&assembly, system));
    pm_monolithic_set_state(assembly, start);
    pm_ledger_init(&ledger, system);
    for (int i = 0; i <= scene->steps; ++i) {
        require(i > 0 ? pm_monolithic_step(assembly) : PM_OK);
        pm_sample sample = *pm_monolithic_sample(assembly);
        require(pm_ledger_book(&ledger, &sample));
        memcpy(o.z, sample.z, sizeof o.z);
    }
    o.drift = ledger.energy_drift;
    o.fall = ledger.worst_entropy_fall;
    o.residual = ledger.worst_energy;
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

static double error_of(setting how, const outcome *exact) {
    const double error = distance(roll_out(how).z, exact->z);
    print_message("%s, %d substeps, %d steps of the body each: error %.3g\n", how.integrator,
                  how.substeps, how.own, error);
    return error;
}

static void check_ratio(double coarse, double fine, double expected) {
    if (!(fabs(coarse / fine - expected) < 0.2 * expected)) {
        fail_msg("errors %g and %g: expected a ratio of %g", coarse, fine, expected);
    }
}

// Halving a fast part's own steps divides its error by 16 with the same exchanges, until these are
// what limits it.
static void own_steps_resolve_a_fast_part(void **state) {
    (void)state;
    const outcome exact = roll_out((setting){"rk6", 2048, 1});
    check_ratio(error_of((setting){"multirate3", 4, 32}, &exact),
                error_of((setting){"multirate3", 4, 64}, &exact), 16);
    check_ratio(error_of((setting){"multirate3", 2, 1024}, &exact),
                error_of((setting){"multirate3", 4, 512}, &exact), 8);
    // 12 exchanges a step do better than 768 where all parts go at the pace of the fastest.
    const double together = error_of((setting){"rk4", 192, 1}, &exact);
    assert_true(error_of((setting){"multirate3", 4, 128}, &exact) < together);
}

static void both_laws_hold_between_rates(void **state) {
    (void)state;
    for (int own = 8; own <= 128; own *= 4) {
        const outcome plain = roll_out((setting){"multirate3", 4, own});
        const outcome balanced = roll_out((setting){"multirate3_balanced", 4, own});
        print_message("%d steps per interval: energy strays by %.3g, balanced %.3g J\n", own,
                      plain.drift, balanced.drift);
        assert_true(plain.residual < 1e-14 && balanced.residual < 1e-14);
        assert_true(plain.fall == 0 && balanced.fall == 0);
        assert_true(balanced.drift < 1e-11);
    }
}

static void only_multirate_integrators_have_own_steps(void **state) {
    (void)state;
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_monolithic *assembly = NULL;
    require(pm_scene_parse(&scene, text, "vibration.yaml"));
    require(pm_system_load(&system, scene, NULL));
    scene->integrator = pm_integrator_find("rk4");
    scene->subsystem[0].substeps = 2;
    scene->subsystem[0].substeps_at = "vibration.yaml:17:20";
    assert_int_equal(pm_monolithic_open(&assembly, system), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "vibration.yaml:17:20: subsystem body asks for substeps of "
                                       "its own: integrator rk4 has none"));
    pm_system_free(system);
    pm_scene_free(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(own_steps_resolve_a_fast_part),
        cmocka_unit_test(both_laws_hold_between_rates),
        cmocka_unit_test(only_multirate_integrators_have_own_steps),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
