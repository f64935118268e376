// Simulation in one process: Butcher tableaux, skipped and counted evaluations, the sums of the
// ledger, steps without allocations, and a clear error when a state becomes non-finite.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "sim/ledger.h"
#include "sim/monolithic.h"
#include "tests/support/allocations.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

// --- scenes ---

#define STATE "{q: {unit: m, size: 2}, p: {unit: kg, size: 2}, s: {unit: J, size: 1}}"
#define HEAD                                                     \
    "scene: small\n"                                             \
    "time: {dt: 0.02, steps: 5, integrator: rk4, substeps: 2}\n" \
    "subsystems:\n"                                              \
    "  a: {weights: a.h5, state: " STATE "}\n"                   \
    "  b: {weights: b.h5, state: " STATE "}\n"
#define PORT(law)                                                                          \
    "ports:\n  joint: {law: " law ", between: [a, b], weights: joint.h5, expose: {a: [p, " \
    "s], b: [q, s]}}\n"
#define ENERGY "energy: {features: [\"|p|^2\", \"|q|^2\"], hidden: [4], skip: linear}\n"
#define CANONICAL "reversible: {given: [[q, p, 1.0]]}\n"
#define ROUNDS 8 // 4 stages of 2 substeps
#define STEPS 5

static const char conservative[] = ENERGY CANONICAL;
static const char inert_entropy[] = ENERGY "entropy: {given: s}\n" CANONICAL;
static const char pull[] = "law: bracket\nreversible: {given: [[a.p, b.q, 1.0]]}\n";
static const char empty[] = "law: bracket\n";

static pm_monolithic *open(const random_system *w) {
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w->system), PM_OK);
    pm_monolithic_set_state(assembly, w->z);
    return assembly;
}

static void step(pm_monolithic *assembly) {
    if (pm_monolithic_step(assembly) != PM_OK) {
        fail_msg("%s", pm_error());
    }
}

// --- integrators ---

// Conditions of order up to 4 (Hairer, Norsett, Wanner, table II.2.1).
static void check_tableau(const pm_integrator *rk) {
    double sum[8] = {0}; // b, bc, bc^2, bac, bc^3, bcac, bac^2, baac
    double c[PM_MAX_STAGES] = {0}, ac[PM_MAX_STAGES] = {0}, ac2[PM_MAX_STAGES] = {0},
           aac[PM_MAX_STAGES] = {0};
    for (int i = 0; i < rk->nstage; ++i) {
        for (int j = 0; j < PM_MAX_STAGES; ++j) {
            assert_true(j < i || rk->a[i][j] == 0); // explicit
            c[i] += rk->a[i][j];
            ac[i] += rk->a[i][j] * c[j];
            ac2[i] += rk->a[i][j] * c[j] * c[j];
            aac[i] += rk->a[i][j] * ac[j];
        }
        assert_true(c[i] >= 0 && c[i] <= 1 && rk->b[i] >= 0);
        const double term[] = {1,      c[i],  c[i] * c[i], ac[i], c[i] * c[i] * c[i], c[i] * ac[i],
                               ac2[i], aac[i]};
        for (int k = 0; k < 8; ++k) {
            sum[k] += rk->b[i] * term[k];
        }
    }
    static const double expected[] = {1, 1. / 2, 1. / 3, 1. / 6, 1. / 4, 1. / 8, 1. / 12, 1. / 24};
    static const int order[] = {1, 2, 3, 3, 4, 4, 4, 4};
    for (int k = 0; k < 8; ++k) {
        if (rk->order >= order[k] && !(fabs(sum[k] - expected[k]) < 1e-15)) {
            fail_msg("%s: condition %d is %.17g, expected %.17g", rk->name, k, sum[k], expected[k]);
        }
    }
}

static void tableaux_meet_their_order(void **state) {
    (void)state;
    char names[256];
    snprintf(names, sizeof names, "%s", pm_integrator_names());
    int count = 0;
    for (char *rest = names, *name; (name = strtok_r(rest, ", ", &rest)) != NULL; ++count) {
        const pm_integrator *rk = pm_integrator_find(name);
        assert_non_null(rk);
        assert_string_equal(rk->name, name);
        assert_in_range(rk->nstage, 1, PM_MAX_STAGES);
        if (!pm_integrator_iterates(rk)) {
            check_tableau(rk);
        }
    }
    assert_in_range(count, 4, 100);
    assert_null(pm_integrator_find("rk5"));
}

// --- what is skipped ---

// Evaluated and skipped terms of both subsystems after one step; `exposed` of ROUNDS
// exposures are evaluated.
static void check_counts(const char *part, const char *port, long exposed, long evaluated,
                         long skipped) {
    random_system w;
    random_system_of_text(&w, 1, port == NULL ? HEAD : HEAD PORT("bracket"), part, port);
    pm_monolithic *assembly = open(&w);
    step(assembly);
    const pm_sample *sample = pm_monolithic_sample(assembly);
    for (int i = 0; i < 2; ++i) {
        if (sample->evaluated[i] != exposed + evaluated ||
            sample->skipped[i] != ROUNDS - exposed + skipped) {
            random_system_fail(&w, "subsystem %d: %ld evaluated, %ld skipped, expected %ld and %ld",
                               i, sample->evaluated[i], sample->skipped[i], exposed + evaluated,
                               ROUNDS - exposed + skipped);
        }
    }
    pm_monolithic_close(assembly);
    random_system_close(&w);
}

static void terms_are_counted(void **state) {
    (void)state;
    check_counts(conservative, NULL, ROUNDS, ROUNDS, 0);
    check_counts(conservative, pull, ROUNDS, 2 * ROUNDS, 0);
    check_counts(conservative, empty, ROUNDS, ROUNDS, ROUNDS);
    check_counts(ENERGY, pull, ROUNDS, ROUNDS, ROUNDS);
    check_counts(ENERGY, empty, 0, 0, 2 * ROUNDS);
}

// The same rollout with and without what does not matter, in q and p of both and in energy.
static void check_same_bits(const char *part, const char *port, const char *other_part,
                            const char *other_port) {
    random_system w[2];
    pm_monolithic *assembly[2];
    random_system_of_text(&w[0], 3, port == NULL ? HEAD : HEAD PORT("bracket"), part, port);
    random_system_of_text(&w[1], 3, other_port == NULL ? HEAD : HEAD PORT("bracket"), other_part,
                          other_port);
    memcpy(w[1].z, w[0].z, (size_t)w[0].scene->physics.nz * sizeof *w[0].z);
    for (int i = 0; i < 2; ++i) {
        assembly[i] = open(&w[i]);
        for (int k = 0; k < STEPS; ++k) {
            step(assembly[i]);
        }
    }
    const pm_sample *one = pm_monolithic_sample(assembly[0]),
                    *two = pm_monolithic_sample(assembly[1]);
    assert_memory_equal(one->z, two->z, (size_t)w[0].scene->physics.nz * sizeof *one->z);
    assert_memory_equal(one->energy, two->energy, 2 * sizeof *one->energy);
    assert_true(one->z[0] != w[0].z[0]);
    for (int i = 0; i < 2; ++i) {
        pm_monolithic_close(assembly[i]);
        random_system_close(&w[i]);
    }
}

static void skipping_changes_no_bit(void **state) {
    (void)state;
    check_same_bits(inert_entropy, pull, conservative, pull);
    check_same_bits(conservative, empty, conservative, NULL);
    check_same_bits(inert_entropy, empty, conservative, NULL);
}

static void without_entropy_none_is_evaluated(void **state) {
    (void)state;
    random_system w;
    random_system_of_text(&w, 1, HEAD PORT("bracket"), conservative, pull);
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z = pm_input(g, true, 1, 5);
    const int size = pm_graph_size(g);
    assert_int_equal(pm_part_entropy(g, w.system->part[0], z), PM_NO_NODE);
    assert_in_range(pm_graph_size(g), size, size + 3); // slices of z at most
    pm_graph_close(g);
    pm_monolithic *assembly = open(&w);
    step(assembly);
    const pm_sample *sample = pm_monolithic_sample(assembly);
    for (int i = 0; i < 2; ++i) {
        assert_true(sample->entropy[i] == 0 && sample->bulk_entropy[i] == 0);
        assert_true(sample->flux[0][i].entropy == 0 && sample->flux[0][i].entropy_gross == 0);
        assert_true(sample->flux[0][i].energy_gross > 0);
    }
    pm_monolithic_close(assembly);
    random_system_close(&w);
}

// --- the ledger ---

// One step's fluxes by hand, in the random_system of `pull`.
static pm_status book(const random_system *w, pm_ledger *ledger, const pm_flux flux[2],
                      const double bulk[4], pm_sample *sample) {
    pm_ledger_init(ledger, w->system);
    assert_int_equal(pm_ledger_add_sample(ledger, sample), PM_OK);
    sample->step = 1;
    sample->flux[0][0] = flux[0];
    sample->flux[0][1] = flux[1];
    sample->bulk_energy[0] = bulk[0];
    sample->bulk_entropy[0] = bulk[1];
    sample->bulk_energy_gross[0] = bulk[2];
    sample->bulk_entropy_gross[0] = bulk[3];
    sample->energy[0] = 2;
    sample->entropy[0] = -0.5;
    return pm_ledger_add_sample(ledger, sample);
}

static void ledger_finds_violations(void **state) {
    (void)state;
    static const struct {
        pm_flux flux[2];
        double bulk[4], energy_residual, entropy_residual;
        pm_status status;
        const char *name;
    } c[] = {
        {{{1, 1, 1, 1}, {-1, -0.5, 2, 1}}, {0, 1, 1, 1}, 0, 0, PM_OK, NULL},
        {{{1, 1, 1, 1}, {-1.5, 0, 2, 1}}, {0, 0, 0, 0}, 0.25, 0, PM_ELAW, "joint"},
        {{{1, 1, 1, 1}, {-1, -3, 2, 4}}, {0, 0, 0, 0}, 0, -0.5, PM_ELAW, "joint"},
        {{{0, 0, 0, 0}, {0, 0, 0, 0}}, {-1, 0, 4, 0}, 0.25, 0, PM_ELAW, "a"},
        {{{0, 0, 0, 0}, {0, 0, 0, 0}}, {0, -1, 4, 2}, 0, -0.5, PM_ELAW, "a"},
        // Within the tolerances, and rounding of what cancels.
        {{{1, 1, 1, 1}, {-1 - 9e-13, -1 - 8e-16, 1, 1}}, {0, 0, 0, 0}, 9e-13, -8e-16, PM_OK, NULL},
        {{{1, 1, 1, 1}, {-1, 0, 1, 1}}, {1e-17, -1e-17, 1e-17, 1e-17}, 0, 0, PM_OK, NULL},
        {{{0, -1e-31, 0, 1e-31}, {0, 0, 0, 0}}, {0, 0, 0, 0}, 0, 0, PM_OK, NULL},
    };
    random_system w;
    random_system_of_text(&w, 1, HEAD PORT("bracket"), inert_entropy, pull);
    for (size_t i = 0; i < sizeof c / sizeof *c; ++i) {
        pm_sample *sample = NULL;
        pm_ledger ledger;
        assert_int_equal(pm_sample_new(&sample, w.scene), PM_OK);
        assert_int_equal(book(&w, &ledger, c[i].flux, c[i].bulk, sample), c[i].status);
        random_system_check(&w, "energy residual", sample->energy_residual, c[i].energy_residual,
                            2e-16);
        random_system_check(&w, "entropy residual", sample->entropy_residual, c[i].entropy_residual,
                            2e-16);
        assert_int_equal(ledger.violations, c[i].status == PM_OK ? 0 : 1);
        if (c[i].name != NULL) {
            assert_string_equal(pm_ledger_name(&ledger, c[i].energy_residual > 0
                                                            ? ledger.worst_energy_place
                                                            : ledger.worst_entropy_place),
                                c[i].name);
            assert_non_null(strstr(pm_error(), c[i].name));
        }
        assert_true(ledger.first_energy == 0 && ledger.energy == 2 && ledger.energy_drift == 2);
        assert_true(ledger.worst_entropy_fall == 0.5 && ledger.steps == 1);
        pm_sample_free(sample);
    }
    random_system_close(&w);
}

static void a_guard_ends_what_strays(void **state) {
    (void)state;
    static const pm_flux none[2] = {{0, 0, 0, 0}, {0, 0, 0, 0}};
    static const double nothing[4] = {0, 0, 0, 0};
    random_system w;
    random_system_of_text(&w, 1, HEAD PORT("bracket"), inert_entropy, pull);
    for (int i = 0; i < 2; ++i) {
        pm_sample *sample = NULL;
        pm_ledger ledger;
        assert_int_equal(pm_sample_new(&sample, w.scene), PM_OK);
        w.scene->run.largest_drift = i == 0 ? 2 : 1.9; // J; the total goes from 0 to 2
        assert_int_equal(book(&w, &ledger, none, nothing, sample), i == 0 ? PM_OK : PM_ENUMERIC);
        assert_true(i == 0 || strstr(pm_error(), "step 1: the total energy has drifted by 2 J"));
        pm_sample_free(sample);
    }
    random_system_close(&w);
}

// Energy appears that nothing has booked: an integrator that keeps the energy has failed, and for
// another one it is its error.
static void energy_from_nowhere_is_counted(void **state) {
    (void)state;
    static const pm_flux none[2] = {{0, 0, 0, 0}, {0, 0, 0, 0}};
    static const double nothing[4] = {0, 0, 0, 0};
    static const struct {
        const char *integrator;
        int counted;
    } c[] = {{"rk4", 0}, {"rk4_balanced", 1}, {"discrete_gradient", 1}};
    random_system w;
    random_system_of_text(&w, 1, HEAD PORT("bracket"), inert_entropy, pull);
    for (size_t i = 0; i < sizeof c / sizeof *c; ++i) {
        pm_sample *sample = NULL;
        pm_ledger ledger;
        assert_int_equal(pm_sample_new(&sample, w.scene), PM_OK);
        w.scene->physics.integrator = pm_integrator_find(c[i].integrator);
        assert_int_equal(book(&w, &ledger, none, nothing, sample), PM_OK);
        random_system_check(&w, "energy of a step", ledger.worst_step, 1, 1e-15);
        assert_int_equal(ledger.worst_step_at, 1);
        assert_int_equal(ledger.unbalanced, c[i].counted);
        assert_int_equal(ledger.violations, c[i].counted);
        pm_sample_free(sample);
    }
    random_system_close(&w);
}

// The soft form's fluxes do not cancel: measured and counted, not an error.
static void exchange_is_measured(void **state) {
    (void)state;
    static const char part[] =
        "form: soft\nenergy: {features: [q, p, s], hidden: [4], skip: linear}\n"
        "entropy: {given: s}\n" CANONICAL;
    static const char port[] =
        "law: exchange\nform: soft\n"
        "energy: {features: [own.p, own.q, other.p, other.q], hidden: [4], skip: linear}\n"
        "entropy: {given: own.s}\n"
        "reversible: {learned: {acts_on: [own.q, own.p], features: [other.s], hidden: [3]}}\n"
        "irreversible: {learned: {acts_on: [own.s], features: [other.dE.s], hidden: [3]}}\n";
    static const char scene[] =
        HEAD "ports:\n  joint: {law: exchange, between: [a, b], weights: j.h5, expose: {a: [q, p, "
             "s], b: [q, p, s]}}\n";
    for (uint64_t seed = 1; seed <= 10; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, scene, part, port);
        pm_monolithic *assembly = open(&w);
        pm_ledger ledger;
        pm_ledger_init(&ledger, w.system);
        for (int i = 0; i < STEPS; ++i) {
            step(assembly);
            pm_sample sample = *pm_monolithic_sample(assembly);
            assert_int_equal(pm_ledger_add_sample(&ledger, &sample), PM_OK);
            const pm_flux *a = &sample.flux[0][0], *b = &sample.flux[0][1];
            assert_true(a->energy_gross > 0 && b->energy_gross > 0);
            random_system_check(
                &w, "energy residual", sample.energy_residual,
                fabs(a->energy + b->energy) / fmax(a->energy_gross, b->energy_gross), 1e-12);
        }
        assert_int_equal(ledger.violations, STEPS);
        assert_string_equal(pm_ledger_name(&ledger, ledger.worst_energy_place), "joint");
        pm_monolithic_close(assembly);
        random_system_close(&w);
    }
}

// --- the step ---

static void steps_allocate_nothing(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 6; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, random_system_scene, random_system_part,
                              random_system_port);
        w.scene->physics.dt = 1e-4;
        pm_monolithic *assembly = open(&w);
        step(assembly);
        const long before = allocations;
        for (int i = 0; i < 20; ++i) {
            step(assembly);
        }
        assert_int_equal(allocations, before);
        pm_monolithic_close(assembly);
        random_system_close(&w);
    }
}

// A quadratic potential with a long step: the state grows until it is no number.
static void running_away_ends_with_the_last_finite_state(void **state) {
    (void)state;
    static const char part[] = "energy: {features: [q, p], skip: quadratic}\n" CANONICAL;
    random_system w;
    random_system_of_text(&w, 2, HEAD, part, NULL);
    w.scene->physics.dt = 1e9;
    pm_monolithic *assembly = open(&w);
    double last[10];
    pm_status status = PM_OK;
    int steps = 0;
    while (status == PM_OK && ++steps < 100) {
        memcpy(last, pm_monolithic_sample(assembly)->z, sizeof last);
        status = pm_monolithic_step(assembly);
    }
    assert_int_equal(status, PM_ENUMERIC);
    assert_non_null(strstr(pm_error(), "subsystem a"));
    assert_null(strchr(pm_error(), '\n'));
    const pm_sample *sample = pm_monolithic_sample(assembly);
    assert_memory_equal(sample->z, last, sizeof last);
    assert_int_equal(sample->step, steps - 1);
    for (int i = 0; i < 10; ++i) {
        assert_true(isfinite(last[i]));
    }
    pm_monolithic_close(assembly);
    random_system_close(&w);
}

// The same of a subsystem in a process of its own: its last good state is still there.
static void a_failed_step_is_taken_back(void **state) {
    (void)state;
    static const char *const energy[] = {"q, p", "\"|q|^2\", p"}; // the second overflows before q
    for (int i = 0; i < 2; ++i) {
        char part[RANDOM_SYSTEM_TEXT];
        snprintf(part, sizeof part, "energy: {features: [%s], skip: quadratic}\n" CANONICAL,
                 energy[i]);
        random_system w;
        random_system_of_text(&w, 2, HEAD, part, NULL);
        w.scene->physics.dt = 1e9;
        pm_local_subsystems *s = NULL;
        assert_int_equal(pm_local_subsystems_open(&s, w.system, 1, &(int){0}), PM_OK);
        pm_local_subsystems_set_state(s, w.z);
        double last[5], now[5];
        pm_status status = PM_OK;
        for (int k = 0; k < 100 && status == PM_OK; ++k) {
            pm_local_subsystems_state(s, 0, last);
            while (!pm_local_subsystems_completes_step(s)) {
                pm_local_subsystems_bulk(s);
                pm_local_subsystems_advance(s);
            }
            status = pm_local_subsystems_end_step(s);
            assert_true(status != PM_OK || isfinite(pm_local_subsystems_books(s, 0).energy));
        }
        assert_int_equal(status, PM_ENUMERIC);
        pm_local_subsystems_state(s, 0, now);
        assert_memory_equal(now, last, sizeof last);
        pm_local_subsystems_close(s);
        random_system_close(&w);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tableaux_meet_their_order),
        cmocka_unit_test(terms_are_counted),
        cmocka_unit_test(skipping_changes_no_bit),
        cmocka_unit_test(without_entropy_none_is_evaluated),
        cmocka_unit_test(ledger_finds_violations),
        cmocka_unit_test(energy_from_nowhere_is_counted),
        cmocka_unit_test(a_guard_ends_what_strays),
        cmocka_unit_test(exchange_is_measured),
        cmocka_unit_test(steps_allocate_nothing),
        cmocka_unit_test(running_away_ends_with_the_last_finite_state),
        cmocka_unit_test(a_failed_step_is_taken_back),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
