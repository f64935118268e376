// Networks on a mesh whose output a field drives: the output is proportional to the driver and
// reaches as far as the messages do, and the gradient of a loss over such steps is its slope.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "graph/program.h"
#include "learn/objective.h"
#include "tests/support/balance.h"
#include "tests/support/mesh_part.h"

// Rounding, relative to the largest rate.
#define TOLERANCE 1e-12
// Step and tolerance of central differences, relative to the length of the gradient.
#define STEP 1e-5
#define DIFFERENCE_TOLERANCE 1e-6

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
#define GRIP(patterns)                                                                       \
    "law: exchange\nform: free\n" MESH_TEXT "rate: {nodes: [own.u], driven_by: other.dE.f, " \
    "width: 4, passes: 1, " patterns "within: 0.5}\n"
static const char *const grip[2] = {GRIP(""), GRIP("patterns: 3, hidden: [5], ")};

#define NY (6 * MESH_NODES) // u and m

typedef struct driven {
    random_system w;
    pm_graph *g;
    pm_node own, force, rate;
    pm_program *p;
} driven;

static void open_driven(driven *d, uint64_t seed) {
    *d = (driven){0};
    random_system_of_text(&d->w, seed, driven_scene, mesh_part[0], grip[seed % 2]);
    const pm_port_model *port = d->w.system->port[0];
    assert_int_equal(pm_graph_open(&d->g), PM_OK);
    d->own = pm_input(d->g, true, 1, NY);
    d->force = pm_input(d->g, true, 1, 3 * MESH_NODES);
    const pm_port_nodes end[2] = {
        {d->own, pm_constant(d->g, 0, 1, NY), PM_NO_NODE, PM_NO_NODE},
        {pm_constant(d->g, 0, 1, 3 * MESH_NODES), d->force, PM_NO_NODE, PM_NO_NODE}};
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
        double rate[NY], scaled[NY], force[3 * MESH_NODES];
        open_driven(&d, seed);
        for (int i = 0; i < 3 * MESH_NODES; ++i) {
            force[i] = pm_rng_normal(&d.w.rng);
        }
        memcpy(pm_program_value(d.p, d.force), force, sizeof force);
        run_driven(&d, rate);
        const double size = largest(NY, rate);
        assert_true(size > 0);
        for (int k = 0; k < 3; ++k) {
            for (int i = 0; i < 3 * MESH_NODES; ++i) {
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

// With one pass a force acts one edge away. The shape, which sets the gates of these messages, acts
// two edges away.
static void a_force_reaches_as_far_as_messages_do(void **state) {
    (void)state;
    driven d;
    double before[NY], by_force[NY], by_shape[NY];
    open_driven(&d, 2);
    double *force = pm_program_value(d.p, d.force), *own = pm_program_value(d.p, d.own);
    memcpy(force, d.w.z + 3 * MESH_NODES, 3 * MESH_NODES * sizeof *force);
    run_driven(&d, before);
    for (int node = 0; node < MESH_NODES; ++node) {
        const double kept[2] = {force[3 * node], own[3 * node]};
        force[3 * node] += 0.1;
        run_driven(&d, by_force);
        force[3 * node] = kept[0];
        own[3 * node] += 0.1;
        run_driven(&d, by_shape);
        own[3 * node] = kept[1];
        for (int i = 0; i < NY; ++i) {
            const int away = mesh_distance(node, i / 3 % MESH_NODES);
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

#define COUNT 3 // windows

// Draws windows of one step with the forces during the step.
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

// The loss contains dE, so that its gradient has second derivatives of the network of the energy.
static void the_gradient_of_a_loss_is_its_slope(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 4; ++seed) {
        random_system w;
        random_system_of_text(&w, seed, driven_scene, mesh_part[seed / 2 % 2], grip[seed % 2]);
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
        cmocka_unit_test(what_is_driven_is_proportional_to_the_driver),
        cmocka_unit_test(a_force_reaches_as_far_as_messages_do),
        cmocka_unit_test(the_gradient_of_a_loss_is_its_slope),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
