// Subsystems at rest are not evaluated, and this changes no bit. In a chain of five the first one
// is disturbed, and the disturbance reaches one more subsystem with every exchange.
#include <stdio.h>
#include <string.h>

#include "sim/monolithic.h"
#include "tests/support/divided.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define COUNT 5
#define NZ 4
#define STEPS 12

static const char scene_text[] =
    "scene: chain\n"
    "time: {dt: 0.001, steps: 20, integrator: euler}\n"
    "subsystems:\n"
    "  n0: {weights: n.h5, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}}}\n"
    "  n1: {weights: n.h5, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}}}\n"
    "  n2: {weights: n.h5, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}}}\n"
    "  n3: {weights: n.h5, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}}}\n"
    "  n4: {weights: n.h5, state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}}}\n"
    "ports:\n"
    "  p0: {law: bracket, between: [n0, n1], expose: {n0: [q, p], n1: [q, p]}, weights: p.h5}\n"
    "  p1: {law: bracket, between: [n1, n2], expose: {n1: [q, p], n2: [q, p]}, weights: p.h5}\n"
    "  p2: {law: bracket, between: [n2, n3], expose: {n2: [q, p], n3: [q, p]}, weights: p.h5}\n"
    "  p3: {law: bracket, between: [n3, n4], expose: {n3: [q, p], n4: [q, p]}, weights: p.h5}\n";

// At rest where q and p are zero.
static const char part_text[] =
    "energy: {features: [\"|q|^2\", \"|p|^2\"], hidden: [4], skip: linear}\n"
    "reversible: {given: [[q, p, 1.0]]}\n";

static const char port_text[] = "law: bracket\n"
                                "reversible: {learned: {acts_on: [a.q, a.p, b.q, b.p], features: "
                                "[\"|a.q|^2\", \"|b.p|^2\"], hidden: [3]}}\n";

static pm_monolithic *open(const random_system *w) {
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w->system), PM_OK);
    pm_monolithic_set_state(assembly, w->z);
    return assembly;
}

static void open_chain(random_system *w, uint64_t seed) {
    random_system_of_text(w, seed, scene_text, part_text, port_text);
    memset(w->z + NZ, 0, (COUNT - 1) * NZ * sizeof *w->z);
}

static void check_numbers(const random_system *w, const char *what, long step, int n,
                          const double *x, const double *y) {
    for (int i = 0; i < n; ++i) {
        if (memcmp(&x[i], &y[i], sizeof *x) != 0) {
            random_system_fail(w, "%s[%d] after step %ld: %.17g, evaluated anew %.17g", what, i,
                               step, x[i], y[i]);
        }
    }
}

static void check_samples(const random_system *w, const pm_sample *x, const pm_sample *y) {
    check_numbers(w, "z", x->step, COUNT * NZ, x->z, y->z);
    check_numbers(w, "energy", x->step, COUNT, x->energy, y->energy);
    check_numbers(w, "bulk energy", x->step, COUNT, x->bulk_energy, y->bulk_energy);
    check_numbers(w, "bulk energy, gross", x->step, COUNT, x->bulk_energy_gross,
                  y->bulk_energy_gross);
    check_numbers(w, "bulk entropy, gross", x->step, COUNT, x->bulk_entropy_gross,
                  y->bulk_entropy_gross);
    for (int i = 0; i < COUNT - 1; ++i) {
        check_numbers(w, "flux", x->step, 2 * (int)(sizeof(pm_flux) / sizeof(double)),
                      &x->flux[i][0].energy, &y->flux[i][0].energy);
    }
}

// A step after setting the state evaluates everything: nothing is known then. (Balanced integrators
// carry over more than the state.)
static void check_against_new(const char *integrator, uint64_t seed) {
    random_system w;
    open_chain(&w, seed);
    w.scene->physics.integrator = pm_integrator_find(integrator);
    pm_monolithic *kept = open(&w), *anew = open(&w);
    for (int i = 0; i < STEPS; ++i) {
        double z[COUNT * NZ];
        memcpy(z, pm_monolithic_sample(kept)->z, sizeof z);
        pm_monolithic_set_state(anew, z);
        assert_int_equal(pm_monolithic_step(kept), PM_OK);
        assert_int_equal(pm_monolithic_step(anew), PM_OK);
        check_samples(&w, pm_monolithic_sample(kept), pm_monolithic_sample(anew));
    }
    pm_monolithic_close(kept);
    pm_monolithic_close(anew);
    random_system_close(&w);
}

static void rest_changes_no_bit(void **state) {
    (void)state;
    char names[256];
    snprintf(names, sizeof names, "%s", pm_integrator_names());
    for (char *rest = names, *name; (name = strtok_r(rest, ", ", &rest)) != NULL;) {
        if (pm_integrator_find(name)->balanced) {
            continue; // what a step leaves unbalanced is not in the state that is set
        }
        for (uint64_t seed = 1; seed <= 5; ++seed) {
            check_against_new(name, seed);
        }
    }
}

// Terms of part i that step `step` must evaluate: at its beginning parts 0 to step - 1 move. A port
// is evaluated when either end moves, an exposure when the step has moved the part.
static long moving_terms(int i, int step) {
    const long exposure = i < step + 1, bulk = i < step,
               right = i < COUNT - 1 && i<step, left = i> 0 && i - 1 < step;
    return exposure + bulk + right + left;
}

static void rest_is_skipped(void **state) {
    (void)state;
    random_system w;
    open_chain(&w, 1);
    pm_monolithic *assembly = open(&w);
    const pm_sample *sample = pm_monolithic_sample(assembly);
    long before[COUNT] = {0};
    for (int step = 1; step <= STEPS; ++step) {
        assert_int_equal(pm_monolithic_step(assembly), PM_OK);
        sample = pm_monolithic_sample(assembly);
        for (int i = 0; i < COUNT; ++i) {
            const long terms = i == 0 || i == COUNT - 1 ? 3 : 4;
            // The first step knows nothing yet but what is exposed.
            const long still = step == 1 ? terms - (i > 1) : moving_terms(i, step);
            const long expected = before[i] + still;
            if (sample->evaluated[i] != expected || sample->skipped[i] != step * terms - expected) {
                random_system_fail(
                    &w, "n%d after step %d: %ld evaluated, %ld skipped, expected %ld and %ld", i,
                    step, sample->evaluated[i], sample->skipped[i], expected,
                    step * terms - expected);
            }
            before[i] = expected;
        }
    }
    pm_monolithic_close(assembly);
    random_system_close(&w);
}

// --- a return from a checkpoint ---

// Whoever goes on from a checkpoint knows what has not changed since, and counts as if it had never
// been away. With `still` all parts are, as their steps are too short to move them, but fluxes
// flow.
static void check_return(const char *integrator, bool still) {
    random_system w;
    if (still) {
        random_system_of_text(&w, 1, scene_text, part_text, port_text);
        w.scene->physics.dt = 1e-300;
    } else {
        open_chain(&w, 1);
    }
    w.scene->physics.integrator = pm_integrator_find(integrator);
    divided kept, returned;
    divided_open(&kept, w.system, 0, NULL);
    divided_set_state(&kept, w.z);
    for (int step = 0; step < STEPS; ++step) {
        divided_return(&returned, &kept);
        assert_int_equal(divided_step(&kept), PM_OK);
        assert_int_equal(divided_step(&returned), PM_OK);
        for (int i = 0; i < COUNT; ++i) {
            double z[2][NZ];
            pm_flux flux[2];
            pm_books books[2];
            for (int k = 0; k < 2; ++k) {
                const pm_local_subsystems *local = (k == 0 ? &kept : &returned)->local[i];
                pm_local_subsystems_state(local, 0, z[k]);
                books[k] = pm_local_subsystems_books(local, 0);
                flux[k] = books[k].flux[0];
            }
            check_numbers(&w, "z", step, NZ, z[0], z[1]);
            check_numbers(&w, "bulk", step, 4, &books[0].bulk.energy, &books[1].bulk.energy);
            check_numbers(&w, "flux", step, 4, &flux[0].energy, &flux[1].energy);
            if (books[0].evaluated != books[1].evaluated || books[0].skipped != books[1].skipped) {
                random_system_fail(
                    &w, "%s, n%d after step %d: %ld evaluated, %ld skipped, expected %ld, %ld",
                    integrator, i, step, books[1].evaluated, books[1].skipped, books[0].evaluated,
                    books[0].skipped);
            }
        }
        divided_close(&returned);
    }
    divided_close(&kept);
    random_system_close(&w);
}

static void rest_is_known_after_a_return(void **state) {
    (void)state;
    char names[256];
    snprintf(names, sizeof names, "%s", pm_integrator_names());
    for (char *rest = names, *name; (name = strtok_r(rest, ", ", &rest)) != NULL;) {
        check_return(name, false);
        check_return(name, true);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rest_changes_no_bit),
        cmocka_unit_test(rest_is_skipped),
        cmocka_unit_test(rest_is_known_after_a_return),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
