// Networks on the graph of a mesh: both laws hold whatever their weights, operators act node by
// node, messages reach as far as they are passed on, what a field drives is proportional to it, and
// derivatives are derivatives.
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
#include "learn/objective.h"
#include "model/operator.h"
#include "sim/monolithic.h"
#include "tests/support/projection.h"

#define WORLDS 60
#define NNODE 27 // of 3 x 2 x 2 bricks
#define MESH "mesh: {size: [3, 2, 1], elements: [3, 2, 2]}\n"
// Rounding, relative to the sum of the magnitudes that cancel.
#define TOLERANCE 1e-12
// A rate smaller than this part of what it would be without the projections has their rounding.
#define LEFT_OVER 0.1
// Of central differences, relative to the largest derivative.
#define STEP 1e-5
#define DIFFERENCE_TOLERANCE 1e-6

static const char scene[] =
    "scene: one\n"
    "time: {dt: 0.01, steps: 5, integrator: euler}\n"
    "subsystems:\n"
    "  body: {weights: a.h5, state: {u: {unit: m, size: 81}, m: {unit: m, size: 81}, "
    "s: {unit: J/K, size: 1}}}\n";

// As of a beam: the heat variable s takes what is dissipated. All depends on all in the second.
static const char *const part[2] = {
    MESH "energy:\n"
         "  - {given: {s: 300.0}}\n"
         "  - \"|u|^2/2 - 0.3*<u,m> + 0.4*|m|^2/2\"\n"
         "  - {nodes: [u], width: 4, passes: 2, patterns: 3, hidden: [5]}\n"
         "entropy: {given: s}\n"
         "reversible: {learned: {acts_on: [u, m], nodes: [u], width: 3, passes: 1}}\n"
         "irreversible:\n"
         "  given: [[u, s, 60.0], [m, s, 7.0]]\n"
         "  learned: {acts_on: [u, m], rank: 2, nodes: [u], width: 3, passes: 1}\n",
    MESH "energy:\n"
         "  - {given: {s: 300.0}}\n"
         "  - {nodes: [u, m], width: 4, passes: 2, patterns: 3}\n"
         "entropy: [{given: s}, {nodes: [m, u], width: 4, passes: 0, patterns: 2, hidden: [3]}]\n"
         "reversible: {learned: {acts_on: [u, m], nodes: [m, u], width: 3, passes: 0}}\n"
         "irreversible: {learned: {acts_on: [m, u], rank: 3, nodes: [u], width: 3, passes: 2}}\n",
};

// --- parts ---

typedef struct part_nodes {
    pm_graph *g;
    const pm_part *part;
    pm_node z, E, dE, dS, rate, degeneracy;
} part_nodes;

static part_nodes build_part(const random_system *w) {
    part_nodes n = {.part = &w->system->part[0], .degeneracy = PM_NO_NODE};
    assert_int_equal(pm_graph_open(&n.g), PM_OK);
    n.z = pm_input(n.g, true, 1, n.part->layout.nz);
    n.E = pm_part_energy(n.g, n.part, n.z);
    pm_gradient(n.g, n.E, PM_NO_NODE, 1, &n.z, &n.dE);
    pm_gradient(n.g, pm_part_entropy(n.g, n.part, n.z), PM_NO_NODE, 1, &n.z, &n.dS);
    n.rate = pm_part_bulk(n.g, n.part, n.z, n.dE, n.dS, &n.degeneracy);
    return n;
}

// One operator's rate; without a normal, unprojected.
static pm_node operate(const part_nodes *n, pm_operator_kind kind, pm_node driving,
                       pm_node normal) {
    const bool skew = kind == PM_REVERSIBLE;
    const pm_operator op = {skew ? &n->part->spec.reversible : &n->part->spec.irreversible, kind,
                            PM_HARD, skew ? "reversible" : "irreversible"};
    pm_site site = {0};
    pm_node degeneracy = PM_NO_NODE;
    pm_site_add(&site, &n->part->layout, "");
    pm_symbols_add(&site.symbols, n->g, &n->part->layout, "", n->z);
    return pm_operator_build(n->g, &op, &site, &n->part->params, driving, normal, &degeneracy);
}

// A program of one item at the random_system's state.
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

// From tame to extreme: weights and states a thousand times smaller and larger.
static void open_world(random_system *w, uint64_t seed) {
    static const double factor[] = {1, 1e3, 1e-3};
    random_system_of_text(w, seed, scene, part[seed % 2], NULL);
    scale_weights(w, factor[seed / 2 % 3]);
    for (int i = 0; i < w->scene->nz; ++i) {
        w->z[i] *= factor[seed / 6 % 3];
    }
}

// --- the laws ---

// Whether anything moves.
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
    for (uint64_t seed = 1; seed <= WORLDS; ++seed) {
        random_system w;
        open_world(&w, seed);
        const part_nodes n = build_part(&w);
        assert_int_equal(n.degeneracy, PM_NO_NODE);
        moving += check_laws(&w, &n, PM_REVERSIBLE, n.dE, n.dS);
        moving += check_laws(&w, &n, PM_IRREVERSIBLE, n.dS, n.dE);
        pm_graph_close(n.g);
        random_system_close(&w);
    }
    if (moving < WORLDS * 2 * 3 / 4) { // large weights saturate a network, whose slope is then zero
        fail_msg("only %d of %d operators move anything", moving, 2 * WORLDS);
    }
}

// Without the projections what leaves one node enters another component of that node.
static void operators_act_node_by_node(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 12; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, scene, part[1], NULL);
        part_nodes n = build_part(&w);
        const int nz = n.part->layout.nz, node = (int)pm_rng_below(&w.rng, NNODE);
        for (int kind = 0; kind < 2; ++kind) {
            const pm_node d = pm_input(n.g, true, 1, nz);
            const pm_node rate = operate(&n, (pm_operator_kind)kind, d, PM_NO_NODE);
            pm_program *p = run(&w, &n, 1, &rate);
            memset(pm_program_value(p, d), 0, (size_t)nz * sizeof(double));
            pm_program_value(p, d)[3 * node + 1] = 1;
            pm_program_run(p, 1);
            const double *moved = pm_program_value(p, rate);
            for (int i = 0; i < nz - 1; ++i) {
                const bool own = i / 3 % NNODE == node;
                const bool zero_by_skewness = kind == PM_REVERSIBLE && i == 3 * node + 1;
                if ((moved[i] != 0) != (own && !zero_by_skewness)) {
                    random_system_fail(&w,
                                       "operator %d: node %d moves component %d of node %d by %g",
                                       kind, node, i, i / 3 % NNODE, moved[i]);
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
        char text[WORLD_TEXT];
        random_system w;
        snprintf(text, sizeof text, "form: soft\n%s", part[seed % 2]);
        random_system_of_text(&w, seed, scene, text, NULL);
        const part_nodes n = build_part(&w);
        assert_int_not_equal(n.degeneracy, PM_NO_NODE);
        pm_node output[] = {n.rate, n.degeneracy, operate(&n, PM_REVERSIBLE, n.dE, PM_NO_NODE),
                            operate(&n, PM_IRREVERSIBLE, n.dS, PM_NO_NODE)};
        pm_program *p = run(&w, &n, 4, output);
        if (!(*pm_program_value(p, n.degeneracy) > 0)) {
            random_system_fail(&w, "no penalty");
        }
        // What is given in the other model is degenerate as it stands.
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

// Edges between two nodes, for their indices along x, y, z.
static int distance(int a, int b) {
    const int n[3] = {3, 3, 3};
    int sum = 0;
    for (int c = 0; c < 3; a /= n[c], b /= n[c], ++c) {
        sum += abs(a % n[c] - b % n[c]);
    }
    return sum;
}

// Whether rates that change when a node's input does are those within `reach` edges of it.
static void check_reach(const random_system *w, const double *before, const double *after, int node,
                        int reach) {
    for (int i = 0; i < NNODE; ++i) {
        bool changed = false;
        for (int c = 0; c < 9; ++c) {
            const int at = c < 3 ? 3 * i + c : 3 * NNODE + 6 * i + c - 3;
            changed = changed || before[at] != after[at];
        }
        if (changed != (distance(node, i) <= reach)) {
            random_system_fail(w, "node %d, %d edges from node %d, %s", i, distance(node, i), node,
                               changed ? "changes" : "does not change");
        }
    }
}

// One item at a time, as the place in a batch may decide how a product rounds.
static const double *run_at(pm_program *p, pm_node input, const double *value, int n,
                            pm_node output) {
    memcpy(pm_program_value(p, input), value, (size_t)n * sizeof *value);
    pm_program_run(p, 1);
    return pm_program_value(p, output);
}

static void messages_reach_as_far_as_they_are_passed(void **state) {
    (void)state;
    for (int passes = 0; passes <= 3; ++passes) {
        char text[WORLD_TEXT];
        random_system w;
        snprintf(text, sizeof text,
                 MESH "form: free\nrate: {nodes: [u, sigma], width: 6, passes: %d}\n", passes);
        random_system_of_text(&w, 1 + (uint64_t)passes, FREE_SCENE, text, NULL);
        assert_false(pm_part_has_energy(&w.system->part[0]));
        pm_graph *g = NULL;
        assert_int_equal(pm_graph_open(&g), PM_OK);
        const int nz = w.scene->nz;
        pm_node z = pm_input(g, true, 1, nz), degeneracy = PM_NO_NODE;
        const pm_node rate =
            pm_part_bulk(g, &w.system->part[0], z, PM_NO_NODE, PM_NO_NODE, &degeneracy);
        pm_program *p = NULL;
        assert_int_equal(pm_program_open(&p, g, 1, &rate, 1), PM_OK);
        double *before = pm_arena_array(&w.scene->arena, (size_t)nz, sizeof *before);
        assert_non_null(before);
        memcpy(before, run_at(p, z, w.z, nz, rate), (size_t)nz * sizeof *before);
        for (int node = 0; node < NNODE; ++node) {
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

// A box that is a network's whole step, a baseline without laws.
static void a_free_part_steps_and_trades_nothing(void **state) {
    (void)state;
    random_system w;
    random_system_of_text(&w, 3, FREE_SCENE,
                          MESH
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

// --- what the random_system drives ---

static const char driven_scene[] =
    "scene: driven\n"
    "time: {dt: 0.01, steps: 5, integrator: euler}\n"
    "subsystems:\n"
    "  body: {weights: a.h5, state: {u: {unit: m, size: 81}, m: {unit: m, size: 81}, "
    "s: {unit: J/K, size: 1}}}\n"
    "boundary_inputs:\n"
    "  hand: {f: {unit: m, dE: \"f[0:81]\"}}\n"
    "ports:\n"
    "  grip: {law: exchange, between: [body, hand], expose: {body: [u, m], hand: [f]}, "
    "weights: b.h5}\n";
#define GRIP(patterns)                                                                  \
    "law: exchange\nform: free\n" MESH "rate: {nodes: [own.u], driven_by: other.dE.f, " \
    "width: 4, passes: 1, " patterns "within: 0.5}\n"
static const char *const grip[2] = {GRIP(""), GRIP("patterns: 3, hidden: [5], ")};

#define NY (6 * NNODE) // u and m

typedef struct driven {
    random_system w;
    pm_graph *g;
    pm_node own, force, rate;
    pm_program *p;
} driven;

static void open_driven(driven *d, uint64_t seed) {
    *d = (driven){0};
    random_system_of_text(&d->w, seed, driven_scene, part[0], grip[seed % 2]);
    const pm_port_model *port = &d->w.system->port[0];
    assert_int_equal(pm_graph_open(&d->g), PM_OK);
    d->own = pm_input(d->g, true, 1, NY);
    d->force = pm_input(d->g, true, 1, 3 * NNODE);
    const pm_port_nodes end[2] = {
        {d->own, pm_constant(d->g, 0, 1, NY), PM_NO_NODE, PM_NO_NODE},
        {pm_constant(d->g, 0, 1, 3 * NNODE), d->force, PM_NO_NODE, PM_NO_NODE}};
    pm_node degeneracy = PM_NO_NODE;
    d->rate = port->law->rate(d->g, port, PM_END_A, end, &degeneracy);
    assert_int_equal(port->law->rate(d->g, port, PM_END_B, end, &degeneracy), PM_NO_NODE);
    assert_int_equal(degeneracy, PM_NO_NODE);
    assert_int_equal(pm_program_open(&d->p, d->g, 1, &d->rate, 1), PM_OK);
    memcpy(pm_program_value(d->p, d->own), d->w.z, NY * sizeof *d->w.z);
}

static void close_driven(driven *d) {
    pm_program_close(d->p);
    pm_graph_close(d->g);
    random_system_close(&d->w);
}

static void run_driven(driven *d, double rate[NY]) {
    pm_program_run(d->p, 1);
    memcpy(rate, pm_program_value(d->p, d->rate), NY * sizeof *rate);
}

static void what_is_driven_is_proportional_to_the_driver(void **state) {
    (void)state;
    // Powers of two scale every sum without rounding.
    static const double factor[] = {-4, 0, 1 / 3.0}, tolerance[] = {0, 0, TOLERANCE};
    for (uint64_t seed = 1; seed <= 10; ++seed) {
        driven d;
        double rate[NY], scaled[NY], force[3 * NNODE];
        open_driven(&d, seed);
        for (int i = 0; i < 3 * NNODE; ++i) {
            force[i] = pm_rng_normal(&d.w.rng);
        }
        memcpy(pm_program_value(d.p, d.force), force, sizeof force);
        run_driven(&d, rate);
        const double size = largest(NY, rate);
        assert_true(size > 0);
        for (int k = 0; k < 3; ++k) {
            for (int i = 0; i < 3 * NNODE; ++i) {
                pm_program_value(d.p, d.force)[i] = factor[k] * force[i];
            }
            run_driven(&d, scaled);
            for (int i = 0; i < NY; ++i) {
                random_system_check(&d.w, "rate", scaled[i], factor[k] * rate[i],
                                    tolerance[k] * size);
            }
        }
        close_driven(&d);
    }
}

// A force is felt one edge away, and the shape that decides how, two: passed once, and once more by
// what it gates.
static void a_force_reaches_as_far_as_messages_do(void **state) {
    (void)state;
    driven d;
    double before[NY], by_force[NY], by_shape[NY];
    open_driven(&d, 2);
    double *force = pm_program_value(d.p, d.force), *own = pm_program_value(d.p, d.own);
    memcpy(force, d.w.z + 3 * NNODE, 3 * NNODE * sizeof *force);
    run_driven(&d, before);
    for (int node = 0; node < NNODE; ++node) {
        const double kept[2] = {force[3 * node], own[3 * node]};
        force[3 * node] += 0.1;
        run_driven(&d, by_force);
        force[3 * node] = kept[0];
        own[3 * node] += 0.1;
        run_driven(&d, by_shape);
        own[3 * node] = kept[1];
        for (int i = 0; i < NY; ++i) {
            const int away = distance(node, i / 3 % NNODE);
            if ((by_force[i] != before[i]) != (away <= 1) ||
                (by_shape[i] != before[i]) != (away <= 2)) {
                random_system_fail(&d.w,
                                   "component %d, %d edges away: %g, by force %g, by shape %g", i,
                                   away, before[i], by_force[i], by_shape[i]);
            }
        }
    }
    close_driven(&d);
}

// --- derivatives ---

static void co_energies_are_the_slope_of_the_energy(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 6; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, scene, part[seed % 2], NULL);
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

#define COUNT 3 // windows

// Windows of one step, with the forces over it, around the random_system's state.
static pm_samples draw_windows(random_system *w) {
    const pm_scene *s = w->scene;
    pm_samples samples = {.count = COUNT,
                          .unroll = 1,
                          .nz = s->nz,
                          .nboundary_input = s->nprescribed,
                          .input_order = 1,
                          .scale = NULL};
    const int width = pm_samples_width(&samples);
    samples.z = pm_arena_array(&w->scene->arena, (size_t)(COUNT * width), sizeof(double));
    samples.scale = pm_arena_array(&w->scene->arena, (size_t)s->nz, sizeof(double));
    assert_true(samples.z != NULL && samples.scale != NULL);
    for (int i = 0; i < COUNT * width; ++i) {
        samples.z[i] = pm_rng_normal(&w->rng);
    }
    for (int i = 0; i < s->nz; ++i) {
        samples.scale[i] = 0.3;
    }
    return samples;
}

// The loss reads dE: its gradient is of second order in the energy's network.
static void the_gradient_of_a_loss_is_its_slope(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 4; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, driven_scene, part[seed / 2 % 2], grip[seed % 2]);
        const pm_samples samples = draw_windows(&w);
        const pm_loss loss = {
            .residual = PM_RESIDUAL_STEP, .integrator = pm_integrator_find("euler"), .substeps = 1};
        pm_objective *o = NULL;
        assert_int_equal(pm_objective_open(&o, w.system, &samples, &loss), PM_OK);
        const int size = pm_objective_size(o);
        double *theta = calloc(4 * (size_t)size, sizeof *theta);
        assert_non_null(theta);
        double *gradient = theta + size, *moved = gradient + size, *v = moved + size;
        pm_objective_weights(o, theta);
        pm_objective_evaluate(o, 0, NULL, gradient);
        const double length = sqrt(balance_of(size, gradient, gradient).net);
        for (int i = 0; i < 8; ++i) {
            double value[2];
            for (int k = 0; k < size; ++k) {
                v[k] = pm_rng_normal(&w.rng) / sqrt(size);
            }
            const double slope = balance_of(size, gradient, v).net;
            for (int side = 0; side < 2; ++side) {
                for (int k = 0; k < size; ++k) {
                    moved[k] = theta[k] + (side == 0 ? -STEP : STEP) * v[k];
                }
                pm_objective_set_weights(o, moved);
                value[side] = pm_objective_evaluate(o, 0, NULL, moved);
            }
            random_system_check(&w, "slope of the loss", slope, (value[1] - value[0]) / (2 * STEP),
                                DIFFERENCE_TOLERANCE * length);
        }
        assert_true(length > 0);
        free(theta);
        pm_objective_close(o);
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
        cmocka_unit_test(what_is_driven_is_proportional_to_the_driver),
        cmocka_unit_test(a_force_reaches_as_far_as_messages_do),
        cmocka_unit_test(co_energies_are_the_slope_of_the_energy),
        cmocka_unit_test(the_gradient_of_a_loss_is_its_slope),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
