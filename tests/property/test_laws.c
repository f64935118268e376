// Both laws of the hard form, for random models, weights and states: the operators themselves, the
// bulk term, the bracket port, and rollouts seen by the ledger. The penalty of the soft form
// measures the violation of the laws.
//   test_laws [whole]
#include <glob.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "graph/program.h"
#include "model/operator.h"
#include "scene/columns.h"
#include "sim/ledger.h"
#include "sim/monolithic.h"
#include "tests/support/balance.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define WORLDS 300
#define BATCH 4
// Rounding, relative to the sum of the magnitudes that cancel. Shipped scenes have tolerances of
// their own.
#define ENERGY_TOLERANCE 1e-12
#define ENTROPY_TOLERANCE 1e-15
// Projections leave rounding errors in proportion to what they remove. A gross flux therefore
// counts as at least this part of that without projections.
#define LEFT_OVER 0.1
// Tolerance of identities between two evaluations of an operator, whose rounding differs. A
// projection amplifies rounding by the ratio of its argument to its result.
#define OPERATOR_TOLERANCE 1e-10
#define RUN_AWAY 1e6
// Implicit substeps of a step times the components of a scene, above which a step takes long.
#define LONG 1000000

static void fill_normal(pm_rng *rng, int n, double *x) {
    for (int i = 0; i < n; ++i) {
        x[i] = pm_rng_normal(rng);
    }
}

// Opens a program of `count` outputs, draws normal numbers for the inputs [ninput] and runs it. The
// caller closes it.
static pm_program *run(random_system *w, pm_graph *g, int count, const pm_node *output, int ninput,
                       const pm_node *input) {
    pm_program *program = NULL;
    assert_int_equal(pm_program_open(&program, g, count, output, BATCH), PM_OK);
    for (int i = 0; i < ninput; ++i) {
        fill_normal(&w->rng, BATCH * pm_graph_shape(g, input[i]).cols,
                    pm_program_value(program, input[i]));
    }
    pm_program_run(program, BATCH);
    return program;
}

// --- operators alone ---

typedef struct test_bench {
    random_system *w;
    pm_graph *g;
    const pm_part *part;
    pm_site site;
    pm_node z, x, y, n;
} test_bench;

static pm_node apply(const test_bench *b, const pm_operator *operator, pm_node driving,
                     pm_node normal, pm_node *degeneracy) {
    *degeneracy = PM_NO_NODE;
    return pm_operator_build(b->g, operator, & b->site, &b->part->params, driving, normal,
                             degeneracy);
}

// Kx, Ky and Kn, with the normal n, show that K is skew or symmetric and semi-definite, and that Kn
// vanishes.
static void check_operator(const test_bench *b, const pm_operator *operator) {
    pm_node degeneracy;
    if (!pm_operator_exists(operator->spec)) {
        return;
    }
    const int nz = b->part->layout.nz;
    const pm_node output[] = {apply(b, operator, b->x, b->n, &degeneracy),
                              apply(b, operator, b->y, b->n, &degeneracy),
                              apply(b, operator, b->n, b->n, &degeneracy),
                              apply(b, operator, b->n, PM_NO_NODE, &degeneracy)};
    pm_program *p = run(b->w, b->g, 4, output, 4, (const pm_node[]){b->z, b->x, b->y, b->n});
    const bool skew = operator->kind == PM_REVERSIBLE;
    for (int i = 0; i < BATCH * nz; i += nz) {
        const double *x = pm_program_value(p, b->x) + i, *y = pm_program_value(p, b->y) + i;
        const double *n = pm_program_value(p, b->n) + i;
        const double *Kx = pm_program_value(p, output[0]) + i;
        const double *Ky = pm_program_value(p, output[1]) + i;
        const double *Kn = pm_program_value(p, output[2]) + i;
        const double *unprojected = pm_program_value(p, output[3]) + i;
        balance yKx = balance_of(nz, y, Kx);
        yKx.net = skew ? yKx.net : -yKx.net;
        check_zero(b->w, "x.Ky +- y.Kx", balance_add(balance_of(nz, x, Ky), yKx),
                   OPERATOR_TOLERANCE);
        if (skew) {
            check_zero(b->w, "x.Lx", balance_of(nz, x, Kx), ENERGY_TOLERANCE);
        } else {
            check_not_negative(b->w, "x.Mx", balance_of(nz, x, Kx), OPERATOR_TOLERANCE);
        }
        check_zero(b->w, "n.Kx", balance_of(nz, n, Kx), ENERGY_TOLERANCE);
        random_system_check(b->w, "Kn", largest(nz, Kn), 0,
                            OPERATOR_TOLERANCE * largest(nz, unprojected));
    }
    pm_program_close(p);
}

static void operators_are_skew_or_positive_and_degenerate(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_random(&w, seed, PM_HARD);
        test_bench b = {.w = &w, .part = w.system->part[0]};
        assert_int_equal(pm_graph_open(&b.g), PM_OK);
        pm_node *const input[] = {&b.z, &b.x, &b.y, &b.n};
        for (int i = 0; i < 4; ++i) {
            *input[i] = pm_input(b.g, true, 1, b.part->layout.nz);
        }
        pm_site_add(&b.site, &b.part->layout, "", 0);
        pm_symbols_add(&b.site.symbols, b.g, &b.part->layout, "", b.z);
        const pm_part_spec *spec = &b.part->spec;
        check_operator(&b, &(pm_operator){&spec->reversible, PM_REVERSIBLE, PM_HARD, "reversible"});
        check_operator(
            &b, &(pm_operator){&spec->irreversible, PM_IRREVERSIBLE, PM_HARD, "irreversible"});
        pm_graph_close(b.g);
        random_system_close(&w);
    }
}

// --- the bulk term ---

typedef struct part_nodes {
    pm_node z, dE, dS, rate, degeneracy;
} part_nodes;

static part_nodes build_part(pm_graph *g, const pm_part *part) {
    part_nodes n = {.z = pm_input(g, true, 1, part->layout.nz), .degeneracy = PM_NO_NODE};
    pm_gradient(g, pm_part_energy(g, part, n.z), PM_NO_NODE, 1, &n.z, &n.dE);
    pm_gradient(g, pm_part_entropy(g, part, n.z), PM_NO_NODE, 1, &n.z, &n.dS);
    n.rate = pm_part_bulk(g, part, n.z, n.dE, n.dS, &n.degeneracy);
    return n;
}

// Returns the numbers of a node for one batch item. The batch may share the node.
static const double *item(const pm_graph *g, pm_program *p, pm_node x, int i) {
    const pm_shape shape = pm_graph_shape(g, x);
    return pm_program_value(p, x) + (shape.batched ? i * shape.cols : 0);
}

static void check_bulk(random_system *w, const pm_part *part) {
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const part_nodes n = build_part(g, part);
    assert_int_equal(n.degeneracy, PM_NO_NODE);
    pm_part soft = *part; // the same operators without the projections
    soft.spec.form = PM_SOFT;
    pm_node penalty = PM_NO_NODE;
    const bool has_entropy = n.dS != PM_NO_NODE;
    const pm_node output[] = {n.rate, n.dE, pm_part_bulk(g, &soft, n.z, n.dE, n.dS, &penalty),
                              n.dS};
    pm_program *p = run(w, g, has_entropy ? 4 : 3, output, 1, &n.z);
    for (int i = 0; i < BATCH; ++i) {
        const int nz = part->layout.nz;
        const double *rate = item(g, p, n.rate, i), *dE = item(g, p, n.dE, i);
        const double *unprojected = item(g, p, output[2], i);
        balance energy = balance_of(nz, dE, rate);
        energy.gross = fmax(energy.gross, LEFT_OVER * balance_of(nz, dE, unprojected).gross);
        check_zero(w, "dE . zdot_bulk", energy, ENERGY_TOLERANCE);
        if (has_entropy) {
            const double *dS = item(g, p, n.dS, i);
            balance entropy = balance_of(nz, dS, rate);
            entropy.gross = fmax(entropy.gross, LEFT_OVER * balance_of(nz, dS, unprojected).gross);
            check_not_negative(w, "dS . zdot_bulk", entropy, ENTROPY_TOLERANCE);
        }
    }
    pm_program_close(p);
    pm_graph_close(g);
}

static void bulk_keeps_both_laws(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_random(&w, seed, PM_HARD);
        check_bulk(&w, w.system->part[0]);
        check_bulk(&w, w.system->part[1]);
        random_system_close(&w);
    }
}

// --- the bracket port, for any co-energies ---

static void bracket_keeps_both_laws(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_random(&w, seed, PM_HARD);
        const pm_port_model *port = w.system->port[0];
        pm_graph *g = NULL;
        assert_int_equal(pm_graph_open(&g), PM_OK);
        pm_port_nodes end[2];
        pm_node input[6], output[2], degeneracy = PM_NO_NODE;
        for (int i = 0; i < 6; ++i) {
            input[i] = pm_input(g, true, 1, port->layout[i / 3].nz);
        }
        for (int i = 0; i < 2; ++i) {
            end[i] = (pm_port_nodes){input[3 * i], input[3 * i + 1], input[3 * i + 2], PM_NO_NODE};
        }
        for (int i = 0; i < 2; ++i) {
            output[i] = port->law->rate(g, port, (pm_end)i, end, &degeneracy);
        }
        assert_int_equal(degeneracy, PM_NO_NODE);
        pm_program *p = run(&w, g, 2, output, 6, input);
        for (int i = 0; i < BATCH; ++i) {
            balance energy = {0, 0}, entropy = {0, 0};
            for (int k = 0; k < 2; ++k) {
                const int ny = port->layout[k].nz;
                const double *rate = item(g, p, output[k], i);
                energy = balance_add(energy, balance_of(ny, item(g, p, end[k].e, i), rate));
                entropy = balance_add(entropy, balance_of(ny, item(g, p, end[k].eta, i), rate));
            }
            check_zero(&w, "energy fluxes a + b", energy, ENERGY_TOLERANCE);
            check_not_negative(&w, "entropy fluxes a + b", entropy, ENTROPY_TOLERANCE);
        }
        pm_program_close(p);
        pm_graph_close(g);
        random_system_close(&w);
    }
}

// --- rollouts ---

// Checks the ledger of every step and returns the number of steps. It ends early when the state
// grows without bound, as random weights may make it: its squares must not overflow for a law to
// hold.
static int roll_out(const random_system *w, const pm_system *system,
                    const pm_boundary_input *boundary_input, const double *z, int steps) {
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, system), PM_OK);
    pm_monolithic_set_boundary_input(assembly, boundary_input);
    pm_monolithic_set_state(assembly, z);
    pm_ledger ledger;
    pm_ledger_init(&ledger, system);
    int step = 0;
    pm_status status = PM_OK;
    while (step < steps && status == PM_OK) {
        status = pm_monolithic_step(assembly);
        pm_sample sample = *pm_monolithic_sample(assembly);
        if (status == PM_OK && largest(system->scene->physics.nz, sample.z) > RUN_AWAY) {
            break;
        }
        if (status == PM_OK) {
            status = pm_ledger_add_sample(&ledger, &sample);
            ++step;
        }
    }
    if (status != PM_OK && status != PM_ENUMERIC) {
        random_system_fail(w, "%s", pm_error());
    }
    assert_int_equal(ledger.violations, 0);
    pm_monolithic_close(assembly);
    return step;
}

static void rollouts_keep_both_laws(void **state) {
    (void)state;
    const int steps = 10;
    int booked = 0;
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        random_system_random(&w, seed, PM_HARD);
        assert_true(w.scene->run.energy_tolerance == ENERGY_TOLERANCE);
        w.scene->run.entropy_tolerance = ENTROPY_TOLERANCE; // less than a scene allows by default
        booked += roll_out(&w, w.system, NULL, w.z, steps);
        random_system_close(&w);
    }
    if (booked < WORLDS * steps * 3 / 4) {
        fail_msg("only %d of %d steps before states ran away: the laws were hardly tested", booked,
                 WORLDS * steps);
    }
}

// Systems in which a projection leaves little of a large rate or of a large co-energy, so that the
// rounding of the first pass is no longer small beside the result.
static void small_remainders_keep_both_laws(void **state) {
    (void)state;
    static const uint64_t seeds[] = {621,    1094,   2399,   100142, 100444,
                                     100461, 101295, 101485, 101489};
    for (size_t i = 0; i < sizeof seeds / sizeof seeds[0]; ++i) {
        random_system w;
        random_system_random(&w, seeds[i], PM_HARD);
        w.scene->physics.integrator = pm_integrator_find(seeds[i] % 2 == 0 ? "rk4" : "heun");
        roll_out(&w, w.system, NULL, w.z, 20);
        random_system_close(&w);
    }
}

// A shipped scene: its weights, the first state of its reference, and its boundary inputs.
typedef struct shipped {
    pm_scene *scene;
    pm_system *system;
    pm_dataset *reference;
    pm_boundary_input boundary_input;
    double *z;
} shipped;

// Returns false if weights that the scene needs are not there.
static bool load_shipped(shipped *s, const char *path) {
    assert_int_equal(pm_scene_load(&s->scene, path), PM_OK);
    const pm_scene *scene = s->scene;
    pm_arena *arena = &s->scene->arena;
    const char *weights = scene->physics.subsystem[0].weights;
    if (scene->run.reference == NULL || (weights != NULL && access(weights, R_OK) != 0)) {
        return false;
    }
    pm_columns columns;
    const int trajectory = scene->run.reference_trajectory;
    assert_int_equal(pm_system_load(&s->system, scene, NULL), PM_OK);
    assert_int_equal(pm_dataset_load(&s->reference, scene->run.reference), PM_OK);
    assert_int_equal(pm_columns_bind(&columns, scene, s->reference, arena), PM_OK);
    s->z = pm_arena_array(arena, (size_t)columns.nz, sizeof *s->z);
    assert_non_null(s->z);
    pm_columns_to_state(&columns, pm_dataset_state(s->reference, trajectory, 0), s->z);
    const int stride = (int)lround(s->reference->dt / scene->physics.dt);
    assert_int_equal(pm_boundary_input_bind(&s->boundary_input, scene, s->reference, stride, arena),
                     PM_OK);
    pm_boundary_input_follow(&s->boundary_input, s->reference, trajectory);
    return true;
}

static void unload_shipped(shipped *s) {
    pm_dataset_free(s->reference);
    pm_system_free(s->system);
    pm_scene_free(s->scene);
}

// Scenes whose form guarantees no law still run without errors.
static void take_steps(const shipped *s, int steps) {
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, s->system), PM_OK);
    pm_monolithic_set_boundary_input(assembly, &s->boundary_input);
    pm_monolithic_set_state(assembly, s->z);
    for (int i = 0; i < steps; ++i) {
        assert_int_equal(pm_monolithic_step(assembly), PM_OK);
    }
    pm_monolithic_close(assembly);
}

static bool whole; // whether runs go to their end, as in the test test_laws_long

// Returns how many steps of a shipped scene are taken. The sanitizers take ten times as long and
// look for other defects, which show in the first steps. Bodies with many implicit substeps take
// seconds for a step, and the test distributed_scenes lets them touch.
static int steps_of(const pm_scene *scene) {
#ifdef PM_SANITIZED
    const int most = 3;
#else
    const bool long_steps = scene->physics.integrator == pm_integrator_find("discrete_gradient") &&
                            scene->physics.substeps * scene->physics.nz > LONG;
    const int most = long_steps ? 2 : INT_MAX;
#endif
    return whole || scene->run.steps < most ? scene->run.steps : most;
}

static void shipped_weights_keep_both_laws(void **state) {
    (void)state;
    glob_t found;
    assert_int_equal(glob("configs/*.yaml", 0, NULL, &found), 0);
    for (size_t i = 0; i < found.gl_pathc; ++i) {
        shipped s = {.z = NULL};
        if (!load_shipped(&s, found.gl_pathv[i])) {
            print_message("    %s has no weights\n", found.gl_pathv[i]);
        } else if (s.system->port[0]->spec.form != PM_HARD) {
            print_message("    %s keeps none\n", found.gl_pathv[i]);
            take_steps(&s, 10);
        } else {
            const random_system nameless = {.seed = 0};
            print_message("    %s\n", found.gl_pathv[i]);
            const int steps = steps_of(s.scene);
            assert_int_equal(roll_out(&nameless, s.system, &s.boundary_input, s.z, steps), steps);
        }
        unload_shipped(&s);
    }
    globfree(&found);
}

// --- the soft form's penalty ---

// Returns the mean penalty of part 0 at random states.
static double penalty(random_system *w) {
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const part_nodes n = build_part(g, w->system->part[0]);
    assert_int_not_equal(n.degeneracy, PM_NO_NODE);
    const pm_node square = pm_dot(g, n.degeneracy, n.degeneracy);
    pm_program *p = run(w, g, 1, &square, 1, &n.z);
    double sum = 0;
    for (int i = 0; i < BATCH; ++i) {
        sum += *item(g, p, square, i) / BATCH;
    }
    pm_program_close(p);
    pm_graph_close(g);
    return sum;
}

// With L = [[q, p]] and S of s alone, and with M on s alone and E of q and p alone, L dS = M dE =
// 0. All other choices have a penalty > 0.
static void penalty_is_zero_exactly_for_degenerate_models(void **state) {
    (void)state;
    static const char scene[] =
        "scene: one\ntime: {dt: 0.01, steps: 1, integrator: euler}\nsubsystems:\n  a: {weights: "
        "a.h5, state: {q: "
        "{unit: m, size: 2}, p: {unit: kg, size: 2}, s: {unit: J, size: 1}}}\n";
    static const struct {
        const char *energy, *entropy;
        bool degenerate;
    } model[] = {
        {"\"|p|^2\", q", "s", true},
        {"\"|p|^2\", q", "s, q", false},
        {"\"|p|^2\", q, s", "s", false},
    };
    for (uint64_t seed = 1; seed <= 20; ++seed) {
        for (size_t i = 0; i < sizeof model / sizeof *model; ++i) {
            char part[RANDOM_SYSTEM_TEXT];
            snprintf(part, sizeof part,
                     "form: soft\nenergy: {features: [%s], hidden: [4], skip: linear}\n"
                     "entropy: {features: [%s], hidden: [4], skip: linear}\n"
                     "reversible: {given: [[q, p, 1.0]]}\n"
                     "irreversible: {learned: {acts_on: s}}\n",
                     model[i].energy, model[i].entropy);
            random_system w;
            random_system_of_text(&w, seed, scene, part, NULL);
            const double value = penalty(&w);
            if (model[i].degenerate) {
                random_system_check(&w, "penalty", value, 0, 0);
            } else if (!(value > 1e-15)) {
                random_system_fail(&w, "penalty: %g, expected > 0", value);
            }
            random_system_close(&w);
        }
    }
}

int main(int argc, char **argv) {
    whole = argc > 1 && strcmp(argv[1], "whole") == 0;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(operators_are_skew_or_positive_and_degenerate),
        cmocka_unit_test(bulk_keeps_both_laws),
        cmocka_unit_test(bracket_keeps_both_laws),
        cmocka_unit_test(rollouts_keep_both_laws),
        cmocka_unit_test(small_remainders_keep_both_laws),
        cmocka_unit_test(shipped_weights_keep_both_laws),
        cmocka_unit_test(penalty_is_zero_exactly_for_degenerate_models),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
