// Discrete gradients: they satisfy their defining equation, a step conserves energy and lets
// entropy grow, and stiff heat exchange is stable.
#include <math.h>
#include <string.h>

#include "graph/program.h"
#include "sim/ledger.h"
#include "sim/monolithic.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define WORLDS 40
#define NZ 5
// Two states a factor of twenty apart in length are still exact to this.
#define EXACTNESS 1e-9

// Every feature that has a discrete derivative.
static const char every_feature[] =
    "energy:\n"
    "  - {given: {s: 25.0}}\n"
    "  - \"0.3*|min(p,0)|^2 + |min(q,0)|\"\n"
    "  - {features: [\"ln|q|\", \"|p|\", s], hidden: [5, 4], skip: quadratic}\n"
    "  - {features: [\"|p|^2\", \"<q,p>\", q], hidden: [4], skip: linear, zero_at_origin: true}\n"
    "  - {features: [\"ln|q-p|\", \"|p-q|\"], hidden: [3]}\n"
    "entropy: [{given: s}, {features: [\"ln|q|\", s, \"sin(q)\", \"cos(p)\"], hidden: [3]}]\n"
    "reversible: {given: [[q, p, 1.0]]}\n"
    "irreversible: {learned: {acts_on: [s], rank: 1}}\n";

static const char springs[] = "law: bracket\n"
                              "reversible: {given: [[a.p, b.q, 1.0]]}\n"
                              "irreversible: {learned: {acts_on: [a.s, b.s], rank: 1, features: "
                              "[\"|a.q|\"], hidden: [3]}}\n";

// --- exactness ---

typedef struct values {
    double E, S, dE[NZ], dS[NZ];
} values;

// E and S at `to`, and their slopes between the two states; from NULL: their derivatives at `to`.
static values slopes(const pm_part *part, const double *from, const double *to) {
    pm_graph *g = NULL;
    pm_program *program = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z_to = pm_input(g, true, 1, NZ);
    const pm_node z_from = from == NULL ? PM_NO_NODE : pm_input(g, true, 1, NZ);
    pm_node output[4] = {pm_part_energy(g, part, z_to), pm_part_entropy(g, part, z_to)};
    pm_part_coenergies(g, part, z_from, z_to, &output[2], &output[3]);
    assert_int_equal(pm_program_open(&program, g, 4, output, 1), PM_OK);
    memcpy(pm_program_value(program, z_to), to, NZ * sizeof *to);
    if (from != NULL) {
        memcpy(pm_program_value(program, z_from), from, NZ * sizeof *from);
    }
    pm_program_run(program, 1);
    values v = {.E = *pm_program_value(program, output[0]),
                .S = *pm_program_value(program, output[1])};
    memcpy(v.dE, pm_program_value(program, output[2]), sizeof v.dE);
    memcpy(v.dS, pm_program_value(program, output[3]), sizeof v.dS);
    pm_program_close(program);
    pm_graph_close(g);
    return v;
}

static double change(const double *slope, const double *from, const double *to) {
    double sum = 0;
    for (int i = 0; i < NZ; ++i) {
        sum += slope[i] * (to[i] - from[i]);
    }
    return sum;
}

// Steps from a thousandth of the state to twenty times shorter vectors.
static void slopes_are_exact(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, random_system_scene, every_feature, springs);
        const pm_part *part = w.system->part[0];
        double to[NZ];
        for (int i = 0; i < NZ; ++i) {
            const double size = seed % 3 == 0 ? 1e-3 : 1;
            to[i] = seed % 5 == 0 && i < 4 ? w.z[i] / 20 : w.z[i] + size * pm_rng_normal(&w.rng);
        }
        const values start = slopes(part, NULL, w.z), end = slopes(part, w.z, to);
        random_system_check(&w, "change of E", change(end.dE, w.z, to), end.E - start.E, EXACTNESS);
        random_system_check(&w, "change of S", change(end.dS, w.z, to), end.S - start.S, EXACTNESS);
        random_system_close(&w);
    }
}

static void slopes_of_no_change_are_derivatives(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, random_system_scene, every_feature, springs);
        const pm_part *part = w.system->part[0];
        const values slope = slopes(part, w.z, w.z), derivative = slopes(part, NULL, w.z);
        for (int i = 0; i < NZ; ++i) {
            random_system_check(&w, "dE", slope.dE[i], derivative.dE[i],
                                1e-12 * (1 + fabs(slope.dE[i])));
            random_system_check(&w, "dS", slope.dS[i], derivative.dS[i],
                                1e-12 * (1 + fabs(slope.dS[i])));
        }
        random_system_close(&w);
    }
}

// --- steps ---

static double total(int n, const double *x) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += x[i];
    }
    return sum;
}

// The largest change of the total energy over `steps` steps; checks that entropy does not fall.
static double energy_drift(const random_system *w, const char *integrator, double dt, int steps) {
    w->scene->physics.integrator = pm_integrator_find(integrator);
    w->scene->physics.dt = dt;
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w->system), PM_OK);
    pm_monolithic_set_state(assembly, w->z);
    const pm_sample *sample = pm_monolithic_sample(assembly);
    const double start = total(2, sample->energy);
    double entropy = total(2, sample->entropy), drift = 0;
    for (int i = 0; i < steps; ++i) {
        if (pm_monolithic_step(assembly) != PM_OK) {
            drift = INFINITY;
            break;
        }
        sample = pm_monolithic_sample(assembly);
        const double S = total(2, sample->entropy);
        if (strcmp(integrator, "discrete_gradient") == 0) {
            random_system_check(w, "fall of S", fmin(S - entropy, 0), 0, 1e-9);
        }
        entropy = S;
        drift = fmax(drift, fabs(total(2, sample->energy) - start));
    }
    pm_monolithic_close(assembly);
    return drift;
}

// As far as the iteration converges, which it does fast for these steps.
static void steps_keep_energy_and_entropy(void **state) {
    (void)state;
    double heun = 0;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, random_system_scene, every_feature, springs);
        for (int i = 0; i < 2 * NZ; ++i) {
            w.z[i] = (i % NZ < 4 ? 2 : 0) + 0.3 * w.z[i]; // away from where ln|q| bends most
        }
        random_system_check(&w, "drift of E", energy_drift(&w, "discrete_gradient", 0.005, 50), 0,
                            1e-9);
        heun = fmax(heun, energy_drift(&w, "heun", 0.005, 50));
        random_system_close(&w);
    }
    if (!(heun > 1e-6)) {
        fail_msg("heun drifts by %g only: nothing was tested", heun);
    }
}

// --- stiff exchange ---

static const char bodies[] =
    "scene: bodies\n"
    "time: {dt: 1, steps: 20, integrator: discrete_gradient}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: {s: {unit: J/K, size: 1}}}\n"
    "  b: {weights: b.h5, state: {s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  contact: {law: bracket, between: [a, b], weights: c.h5, expose: {a: [s], b: [s]}}\n";
static const char body[] = "energy:\n"
                           "  - {given: {s: 300.0}}\n"
                           "  - {features: [s], skip: quadratic}\n"
                           "entropy: {given: s}\n";
static const char contact[] = "law: bracket\n"
                              "irreversible: {learned: {acts_on: [a.s, b.s], rank: 1}}\n";

static void set(pm_params *params, const char *name, int count, const double *value) {
    const pm_param_entry *entry = pm_params_find(params, name);
    assert_non_null(entry);
    assert_int_equal(entry->rows * entry->cols, count);
    memcpy(entry->value, value, (size_t)count * sizeof *value);
}

// Two bodies of 300 + 10 s kelvin; conduction relaxes their temperatures `rate` times per second.
static void two_bodies(random_system *w, double rate) {
    random_system_of_text(w, 1, bodies, body, contact);
    set(&w->system->port[0]->params, "irreversible.scale", 2, (const double[]){1, 1});
    for (int i = 0; i < 2; ++i) {
        set(&w->system->part[i]->params, "energy.0.mean", 1, (const double[]){0});
        set(&w->system->part[i]->params, "energy.0.deviation", 1, (const double[]){1});
        set(&w->system->part[i]->params, "energy.0.linear", 1, (const double[]){0});
        set(&w->system->part[i]->params, "energy.0.quadratic", 1, (const double[]){5});
    }
    // The law is K (T_b - T_a)/T into a, K the square of the factor: the difference of the
    // temperatures decays by 2 K 10/300 per second.
    const double factor = sqrt(rate * 300 / (2 * 10));
    set(&w->system->port[0]->params, "irreversible.matrix.constant", 2,
        (const double[]){factor, -factor});
    w->z[0] = 1;
    w->z[1] = -1;
}

static double temperature_difference(double s_a, double s_b) {
    return 10 * (s_a - s_b);
}

// At rates far above one per step the temperatures meet at once, where an explicit step explodes;
// at low ones they relax as they should.
static void exchange_is_stable_at_any_rate(void **state) {
    (void)state;
    static const double rates[] = {1e-3, 1e-2, 1, 30, 1e3, 1e6};
    for (size_t i = 0; i < sizeof rates / sizeof *rates; ++i) {
        random_system w;
        two_bodies(&w, rates[i]);
        random_system_check(&w, "drift of E", energy_drift(&w, "discrete_gradient", 1, 20), 0,
                            1e-9);
        pm_monolithic *assembly = NULL;
        assert_int_equal(pm_monolithic_open(&assembly, w.system), PM_OK);
        pm_monolithic_set_state(assembly, w.z);
        assert_int_equal(pm_monolithic_step(assembly), PM_OK);
        const double *z = pm_monolithic_sample(assembly)->z;
        const double before = temperature_difference(w.z[0], w.z[1]);
        // The rule's own factor for a linear decay: the slope is taken at the mean of both ends.
        const double expected = before * (1 - rates[i] / 2) / (1 + rates[i] / 2);
        random_system_check(&w, "difference after a step", temperature_difference(z[0], z[1]),
                            expected, 0.02 * fabs(before));
        pm_monolithic_close(assembly);
        random_system_close(&w);
    }
    random_system w;
    two_bodies(&w, 30);
    if (!(energy_drift(&w, "rk4", 1, 20) > 1)) {
        random_system_fail(&w, "rk4 is stable too: the exchange is not stiff");
    }
    random_system_close(&w);
}

// Cells of 300 exp(2 s) kelvin that conduct heat to all their neighbours.
static const char grid[] =
    "scene: grid\n"
    "time: {dt: 0.2, steps: 3, integrator: discrete_gradient}\n"
    "models:\n"
    "  cell: {energy: \"150*(exp(2*s) - 1)\", entropy: s}\n"
    "  conducts: {law: bracket, irreversible: {given: [[a.s, b.s, \"10*b.dE.s/a.dE.s\"]]}}\n"
    "subsystems:\n"
    "  \"cell[0:8][0:8]\": {model: cell, state: {s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  \"across[0:7][0:8]\": {law: bracket, model: conducts,\n"
    "    between: [\"cell[i][j]\", \"cell[i+1][j]\"],\n"
    "    expose: {\"cell[i][j]\": [s], \"cell[i+1][j]\": [s]}}\n"
    "  \"along[0:8][0:7]\": {law: bracket, model: conducts,\n"
    "    between: [\"cell[i][j]\", \"cell[i][j+1]\"],\n"
    "    expose: {\"cell[i][j]\": [s], \"cell[i][j+1]\": [s]}}\n";

// Heat that relaxes at up to 160 per second on a grid: the steps are divided until they converge,
// and both laws hold.
static void grids_conduct_as_fast_as_they_like(void **state) {
    (void)state;
    enum { CELLS = 64 };
    pm_scene *scene = NULL;
    pm_system *system = NULL;
    pm_monolithic *run = NULL;
    double z[CELLS] = {0};
    z[0] = z[27] = 0.1;
    z[62] = -0.1;
    assert_int_equal(pm_scene_parse(&scene, grid, "grid.yaml"), PM_OK);
    assert_int_equal(scene->physics.diameter, 14);
    assert_int_equal(pm_system_load(&system, scene, NULL), PM_OK);
    assert_int_equal(pm_monolithic_open(&run, system), PM_OK);
    pm_monolithic_set_state(run, z);
    pm_ledger ledger;
    pm_ledger_init(&ledger, system);
    for (int i = 0; i <= 3; ++i) {
        assert_int_equal(i == 0 ? PM_OK : pm_monolithic_step(run), PM_OK);
        assert_int_equal(pm_ledger_add_sample(&ledger, (pm_sample *)pm_monolithic_sample(run)),
                         PM_OK);
    }
    assert_int_equal(ledger.violations, 0);
    assert_true(ledger.energy_drift < 1e-9 && ledger.worst_entropy_fall == 0);
    double spread = 0;
    for (int i = 0; i < CELLS; ++i) {
        spread = fmax(spread, fabs(pm_monolithic_sample(run)->z[i]));
    }
    assert_true(spread < 0.02);
    pm_monolithic_close(run);
    pm_system_free(system);
    pm_scene_free(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slopes_are_exact),
        cmocka_unit_test(slopes_of_no_change_are_derivatives),
        cmocka_unit_test(steps_keep_energy_and_entropy),
        cmocka_unit_test(exchange_is_stable_at_any_rate),
        cmocka_unit_test(grids_conduct_as_fast_as_they_like),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
