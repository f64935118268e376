// Networks on the graph of a mesh: both laws hold for random weights, operators act node by node,
// messages reach as many edges as there are passes, and dE is the derivative of E. Networks that a
// field drives: test_message_driven.c.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "graph/program.h"
#include "model/operator.h"
#include "sim/monolithic.h"
#include "tests/support/balance.h"
#include "tests/support/mesh_part.h"

#define SYSTEMS 60
// Rounding, relative to the sum of the magnitudes that cancel.
#define TOLERANCE 1e-12
// A rate that is smaller than this part of the rate without projections consists of rounding errors
// of the projections.
#define LEFT_OVER 0.1
// Step and tolerance of central differences, relative to the largest derivative.
#define STEP 1e-5
#define DIFFERENCE_TOLERANCE 1e-6

static const char scene[] =
    "scene: one\n"
    "time: {dt: 0.01, steps: 5, integrator: euler}\n"
    "subsystems:\n"
    "  body: {weights: a.h5, state: {u: {unit: m, size: 81}, m: {unit: m, size: 81}, "
    "s: {unit: J/K, size: 1}}}\n";

// --- parts ---

typedef struct part_nodes {
    pm_graph *g;
    const pm_part *part;
    pm_node z, E, dE, dS, rate, degeneracy;
} part_nodes;

static part_nodes build_part(const random_system *w) {
    part_nodes n = {.part = w->system->part[0], .degeneracy = PM_NO_NODE};
    assert_int_equal(pm_graph_open(&n.g), PM_OK);
    n.z = pm_input(n.g, true, 1, n.part->layout.nz);
    n.E = pm_part_energy(n.g, n.part, n.z);
    pm_gradient(n.g, n.E, PM_NO_NODE, 1, &n.z, &n.dE);
    pm_gradient(n.g, pm_part_entropy(n.g, n.part, n.z), PM_NO_NODE, 1, &n.z, &n.dS);
    n.rate = pm_part_bulk(n.g, n.part, n.z, n.dE, n.dS, &n.degeneracy);
    return n;
}

// Returns the rate of one operator; without a normal it is not projected.
static pm_node operate(const part_nodes *n, pm_operator_kind kind, pm_node driving,
                       pm_node normal) {
    const bool skew = kind == PM_REVERSIBLE;
    const pm_operator op = {skew ? &n->part->spec.reversible : &n->part->spec.irreversible, kind,
                            PM_HARD, skew ? "reversible" : "irreversible"};
    pm_site site = {0};
    pm_node degeneracy = PM_NO_NODE;
    pm_site_add(&site, &n->part->layout, "", 0);
    pm_symbols_add(&site.symbols, n->g, &n->part->layout, "", n->z);
    return pm_operator_build(n->g, &op, &site, &n->part->params, driving, normal, &degeneracy);
}

// Opens and runs a program of one batch item at the state of the random system.
static pm_program *run(const random_system *w, const part_nodes *n, int count,
                       const pm_node *output) {
    pm_program *p = NULL;
    assert_int_equal(pm_program_open(&p, n->g, count, output, 1), PM_OK);
    memcpy(pm_program_value(p, n->z), w->z, (size_t)w->scene->nz * sizeof *w->z);
    pm_program_run(p, 1);
    return p;
}

static void scale_weights(const random_system *w, double factor) {
    for (int i = 0; i < pm_system_components(w->system); ++i) {
        const pm_params *params = pm_system_params(w->system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            for (int j = 0; j < entry->rows * entry->cols && entry->trained; ++j) {
                entry->value[j] *= factor;
            }
        }
    }
}

// Opens a random system; the weights and states of some are a thousand times smaller or larger.
static void open_system(random_system *w, uint64_t seed) {
    static const double factor[] = {1, 1e3, 1e-3};
    random_system_of_text(w, seed, scene, mesh_part[seed % 2], NULL);
    scale_weights(w, factor[seed / 2 % 3]);
    for (int i = 0; i < w->scene->nz; ++i) {
        w->z[i] *= factor[seed / 6 % 3];
    }
}

// --- the laws ---

// Checks the laws of one operator. Returns true if its rate is not zero.
static bool check_laws(const random_system *w, const part_nodes *n, pm_operator_kind kind,
                       pm_node driving, pm_node normal) {
    const int nz = n->part->layout.nz;
    const pm_node output[] = {operate(n, kind, driving, normal),
                              operate(n, kind, driving, PM_NO_NODE), n->dE, n->dS};
    pm_program *p = run(w, n, 4, output);
    const double *rate = pm_program_value(p, output[0]),
                 *free_rate = pm_program_value(p, output[1]);
    const double *dE = pm_program_value(p, n->dE), *dS = pm_program_value(p, n->dS);
    balance energy = balance_of(nz, dE, rate), entropy = balance_of(nz, dS, rate);
    energy.gross = fmax(energy.gross, LEFT_OVER * balance_of(nz, dE, free_rate).gross);
    entropy.gross = fmax(entropy.gross, LEFT_OVER * balance_of(nz, dS, free_rate).gross);
    const bool moves = largest(nz, rate) > 0;
    if (kind == PM_REVERSIBLE) {
        check_zero(w, "dE . L dE", energy, TOLERANCE);
        check_zero(w, "dS . L dE", entropy, TOLERANCE);
    } else {
        check_zero(w, "dE . M dS", energy, TOLERANCE);
        check_not_negative(w, "dS . M dS", entropy, TOLERANCE);
    }
    pm_program_close(p);
    return moves;
}

static void operators_keep_both_laws(void **state) {
    (void)state;
    int moving = 0;
    for (uint64_t seed = 1; seed <= SYSTEMS; ++seed) {
        random_system w;
        open_system(&w, seed);
        const part_nodes n = build_part(&w);
        assert_int_equal(n.degeneracy, PM_NO_NODE);
        moving += check_laws(&w, &n, PM_REVERSIBLE, n.dE, n.dS);
        moving += check_laws(&w, &n, PM_IRREVERSIBLE, n.dS, n.dE);
        pm_graph_close(n.g);
        random_system_close(&w);
    }
    if (moving <
        SYSTEMS * 2 * 3 / 4) { // large weights saturate a network, whose slope is then zero
        fail_msg("only %d of %d operators move anything", moving, 2 * SYSTEMS);
    }
}

// Without projections, the power that leaves one component of a node enters another of the same
// node.
static void operators_act_node_by_node(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 12; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, scene, mesh_part[1], NULL);
        part_nodes n = build_part(&w);
        const int nz = n.part->layout.nz, node = (int)pm_rng_below(&w.rng, MESH_NODES);
        for (int kind = 0; kind < 2; ++kind) {
            const pm_node d = pm_input(n.g, true, 1, nz);
            const pm_node rate = operate(&n, (pm_operator_kind)kind, d, PM_NO_NODE);
            pm_program *p = run(&w, &n, 1, &rate);
            memset(pm_program_value(p, d), 0, (size_t)nz * sizeof(double));
            pm_program_value(p, d)[3 * node + 1] = 1;
            pm_program_run(p, 1);
            const double *moved = pm_program_value(p, rate);
            for (int i = 0; i < nz - 1; ++i) {
                const bool own = i / 3 % MESH_NODES == node;
                const bool zero_by_skewness = kind == PM_REVERSIBLE && i == 3 * node + 1;
                if ((moved[i] != 0) != (own && !zero_by_skewness)) {
                    random_system_fail(&w,
                                       "operator %d: node %d moves component %d of node %d by %g",
                                       kind, node, i, i / 3 % MESH_NODES, moved[i]);
                }
            }
            pm_program_close(p);
        }
        pm_graph_close(n.g);
        random_system_close(&w);
    }
}

// --- the soft form ---

static void the_soft_form_pays_and_does_not_project(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 12; ++seed) {
        char text[RANDOM_SYSTEM_TEXT];
        random_system w;
        snprintf(text, sizeof text, "form: soft\n%s", mesh_part[seed % 2]);
        random_system_of_text(&w, seed, scene, text, NULL);
        const part_nodes n = build_part(&w);
        assert_int_not_equal(n.degeneracy, PM_NO_NODE);
        pm_node output[] = {n.rate, n.degeneracy, operate(&n, PM_REVERSIBLE, n.dE, PM_NO_NODE),
                            operate(&n, PM_IRREVERSIBLE, n.dS, PM_NO_NODE)};
        pm_program *p = run(&w, &n, 4, output);
        if (!(*pm_program_value(p, n.degeneracy) > 0)) {
            random_system_fail(&w, "no penalty");
        }
        // The given pairs of the other model are degenerate by themselves.
        for (int i = 0; i < n.part->layout.nz && seed % 2 == 1; ++i) {
            const double sum =
                pm_program_value(p, output[2])[i] + pm_program_value(p, output[3])[i];
            random_system_check(&w, "rate", pm_program_value(p, n.rate)[i], sum,
                                TOLERANCE * (fabs(sum) + 1));
        }
        pm_program_close(p);
        pm_graph_close(n.g);
        random_system_close(&w);
    }
}

// --- reach ---

#define FREE_SCENE                                    \
    "scene: one\n"                                    \
    "time: {dt: 0.01, steps: 5, integrator: euler}\n" \
    "subsystems:\n"                                   \
    "  body: {weights: a.h5, state: {u: {unit: m, size: 81}, sigma: {unit: Pa, size: 162}}}\n"

// Checks that a change of the input of a node changes the rates within `reach` edges, and no
// others.
static void check_reach(const random_system *w, const double *before, const double *after, int node,
                        int reach) {
    for (int i = 0; i < MESH_NODES; ++i) {
        bool changed = false;
        for (int c = 0; c < 9; ++c) {
            const int at = c < 3 ? 3 * i + c : 3 * MESH_NODES + 6 * i + c - 3;
            changed = changed || before[at] != after[at];
        }
        if (changed != (mesh_distance(node, i) <= reach)) {
            random_system_fail(w, "node %d, %d edges from node %d, %s", i, mesh_distance(node, i),
                               node, changed ? "changes" : "does not change");
        }
    }
}

// Runs one item at a time, since rounding may depend on the place in a batch.
static const double *run_at(pm_program *p, pm_node input, const double *value, int n,
                            pm_node output) {
    memcpy(pm_program_value(p, input), value, (size_t)n * sizeof *value);
    pm_program_run(p, 1);
    return pm_program_value(p, output);
}

static void messages_reach_as_far_as_they_are_passed(void **state) {
    (void)state;
    for (int passes = 0; passes <= 3; ++passes) {
        char text[RANDOM_SYSTEM_TEXT];
        random_system w;
        snprintf(text, sizeof text,
                 MESH_TEXT "form: free\nrate: {nodes: [u, sigma], width: 6, passes: %d}\n", passes);
        random_system_of_text(&w, 1 + (uint64_t)passes, FREE_SCENE, text, NULL);
        assert_false(pm_part_has_energy(w.system->part[0]));
        pm_graph *g = NULL;
        assert_int_equal(pm_graph_open(&g), PM_OK);
        const int nz = w.scene->nz;
        pm_node z = pm_input(g, true, 1, nz), degeneracy = PM_NO_NODE;
        const pm_node rate =
            pm_part_bulk(g, w.system->part[0], z, PM_NO_NODE, PM_NO_NODE, &degeneracy);
        pm_program *p = NULL;
        assert_int_equal(pm_program_open(&p, g, 1, &rate, 1), PM_OK);
        double *before = pm_arena_array(&w.scene->arena, (size_t)nz, sizeof *before);
        assert_non_null(before);
        memcpy(before, run_at(p, z, w.z, nz, rate), (size_t)nz * sizeof *before);
        for (int node = 0; node < MESH_NODES; ++node) {
            const double kept = w.z[3 * node + 1];
            w.z[3 * node + 1] += 0.1;
            check_reach(&w, before, run_at(p, z, w.z, nz, rate), node, passes);
            w.z[3 * node + 1] = kept;
        }
        pm_program_close(p);
        pm_graph_close(g);
        random_system_close(&w);
    }
}

// A free part on a mesh makes steps, and has no energy to exchange.
static void a_free_part_steps_and_trades_nothing(void **state) {
    (void)state;
    random_system w;
    random_system_of_text(&w, 3, FREE_SCENE,
                          MESH_TEXT
                          "form: free\nrate: {nodes: [u, sigma], width: 6, passes: 2, patterns: 4, "
                          "hidden: [5], within: 0.5}\n",
                          NULL);
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w.system), PM_OK);
    pm_monolithic_set_state(assembly, w.z);
    for (int i = 0; i < w.scene->steps; ++i) {
        assert_int_equal(pm_monolithic_step(assembly), PM_OK);
    }
    const pm_sample *sample = pm_monolithic_sample(assembly);
    bool moved = true;
    for (int i = 0; i < w.scene->nz; ++i) {
        moved = moved && isfinite(sample->z[i]) && sample->z[i] != w.z[i];
    }
    assert_true(moved);
    pm_monolithic_close(assembly);
    random_system_close(&w);
}

// --- derivatives ---

static void co_energies_are_the_slope_of_the_energy(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 6; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, scene, mesh_part[seed % 2], NULL);
        const part_nodes n = build_part(&w);
        const pm_node output[] = {n.E, n.dE};
        pm_program *p = run(&w, &n, 2, output);
        const int nz = n.part->layout.nz;
        double *z = pm_program_value(p, n.z), *dE = malloc((size_t)nz * sizeof *dE);
        assert_non_null(dE);
        memcpy(dE, pm_program_value(p, n.dE), (size_t)nz * sizeof *dE);
        const double size = largest(nz - 1, dE) + fabs(*pm_program_value(p, n.E));
        for (int k = 0; k < nz; k += 5) {
            double E[2];
            for (int side = 0; side < 2; ++side) {
                z[k] = w.z[k] + (side == 0 ? -STEP : STEP);
                pm_program_run(p, 1);
                E[side] = *pm_program_value(p, n.E);
            }
            z[k] = w.z[k];
            random_system_check(&w, "dE", dE[k], (E[1] - E[0]) / (2 * STEP),
                                DIFFERENCE_TOLERANCE * size);
        }
        free(dE);
        pm_program_close(p);
        pm_graph_close(n.g);
        random_system_close(&w);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(operators_keep_both_laws),
        cmocka_unit_test(operators_act_node_by_node),
        cmocka_unit_test(the_soft_form_pays_and_does_not_project),
        cmocka_unit_test(messages_reach_as_far_as_they_are_passed),
        cmocka_unit_test(a_free_part_steps_and_trades_nothing),
        cmocka_unit_test(co_energies_are_the_slope_of_the_energy),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
