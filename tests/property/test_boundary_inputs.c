// Subsystems with boundary inputs: their ports obey the same laws as all ports, a boundary input
// acts like a neighbour with the same values, and the trainer computes the same steps.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "graph/program.h"
#include "loss/loss_graph.h"
#include "sim/ledger.h"
#include "sim/monolithic.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define NZ 10
#define PART_NZ 5
#define NTIME 9
#define SEEDS 20
// The tolerance for equal sums in another order.
#define STEP_TOLERANCE 1e-13
#define CALM 0.3

#define STATE "{q: {unit: m, size: 2}, p: {unit: kg, size: 2}, s: {unit: J, size: 1}}"
#define EXPOSE "[q, p, s]"

// Two subsystems joined by a port, and boundary inputs that act on the first and on the second.
static const char loaded[] =
    "scene: loaded\n"
    "time: {dt: 0.02, steps: 8, integrator: rk4, substeps: 2}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: " STATE "}\n"
    "  b: {weights: b.h5, state: " STATE "}\n"
    "boundary_inputs:\n"
    "  idle: {x: {unit: m, dE: [u0, 7]}}\n"
    "  wind:\n"
    "    q: {unit: m, value: [u0, 0.3], dE: [u1, u2]}\n"
    "    p: {unit: kg, dE: [u3, -0.4]}\n"
    "    s: {unit: J, value: u4, dE: u5, dS: 1}\n"
    "ports:\n"
    "  base: {law: bracket, between: [wind, a], weights: base.h5, expose: {wind: " EXPOSE
    ", a: " EXPOSE "}}\n"
    "  joint: {law: bracket, between: [a, b], weights: joint.h5, expose: {a: " EXPOSE ", b: " EXPOSE
    "}}\n"
    "  tip: {law: bracket, between: [b, wind], weights: tip.h5, expose: {wind: [p, s, q], "
    "b: " EXPOSE "}}\n";

static const char *const columns[] = {"u0", "u1", "u2", "u3", "u4", "u5"};
#define NCOLUMN 6

// A system whose boundary inputs follow sines, sampled every `stride` steps.
typedef struct boundary_inputs {
    random_system w;
    pm_dataset *data;
    pm_arena arena;
    pm_boundary_input boundary_input;
    pm_monolithic *assembly;
    pm_ledger ledger;
} boundary_inputs;

static void require_for(const boundary_inputs *l, pm_status status) {
    if (status != PM_OK) {
        random_system_fail(&l->w, "%s", pm_error());
    }
}

// With random potentials and exchanges, states may diverge within a few steps.
static void calm(random_system *w) {
    for (int i = 0; i < w->scene->physics.nz; ++i) {
        w->z[i] *= 0.5;
    }
    for (int i = 0; i < pm_system_components(w->system); ++i) {
        const pm_params *params = pm_system_params(w->system, i);
        for (int k = 0; k < params->count; ++k) {
            const pm_param_entry *entry = &params->entry[k];
            for (int j = 0; j < entry->rows * entry->cols && entry->trained; ++j) {
                entry->value[j] *= CALM;
            }
        }
    }
}

// Lets all columns have one behaviour between their samples.
static void hold_all(const pm_scene *scene, pm_hold hold) {
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        const pm_scene_boundary_input *owner = &scene->physics.boundary_input[i];
        for (int k = 0; k < 3 * owner->layout.nz; ++k) {
            ((pm_scene_prescribed *)owner->value)[k].hold = hold;
        }
    }
}

static void open(boundary_inputs *l, uint64_t seed, const char *integrator, double dt, int stride,
                 pm_hold hold) {
    *l = (boundary_inputs){0};
    // The two ends of `tip` have their groups in different orders. The layouts follow the scene.
    random_system_of_text(&l->w, seed, loaded, random_system_part, random_system_port);
    calm(&l->w);
    hold_all(l->w.scene, hold);
    l->w.scene->physics.integrator = pm_integrator_find(integrator);
    l->w.scene->physics.substeps = strcmp(integrator, "euler") == 0 ? 1 : 2;
    l->w.scene->physics.dt = dt;
    require_for(l, pm_dataset_new(&l->data, 1, NTIME, NCOLUMN, dt * stride, columns));
    for (int j = 0; j < NTIME; ++j) {
        for (int k = 0; k < NCOLUMN; ++k) {
            const double phase = 0.7 * k + (3 + k) * l->data->t[j];
            pm_dataset_state(l->data, 0, j)[k] = 0.5 * sin(phase) + (k == 5 ? 1 : 0);
        }
    }
    require_for(l,
                pm_boundary_input_bind(&l->boundary_input, l->w.scene, l->data, stride, &l->arena));
    pm_boundary_input_follow(&l->boundary_input, l->data, 0);
    require_for(l, pm_monolithic_open(&l->assembly, l->w.system));
    pm_monolithic_set_boundary_input(l->assembly, &l->boundary_input);
    pm_monolithic_set_state(l->assembly, l->w.z);
    pm_ledger_init(&l->ledger, l->w.system);
}

static void close(boundary_inputs *l) {
    pm_monolithic_close(l->assembly);
    pm_arena_free(&l->arena);
    pm_dataset_free(l->data);
    random_system_close(&l->w);
}

static void book(boundary_inputs *l) {
    pm_sample sample = *pm_monolithic_sample(l->assembly);
    require_for(l, pm_ledger_add_sample(&l->ledger, &sample));
    random_system_check(&l->w, "the sample's random_system", sample.outside_energy,
                        l->ledger.outside_energy, 0);
}

static void run(boundary_inputs *l) {
    book(l);
    for (long i = 0; i < l->boundary_input.end; ++i) {
        require_for(l, pm_monolithic_step(l->assembly));
        book(l);
    }
}

// --- laws ---

// The energy that leaves a subsystem enters the boundary input, and no port lowers the entropy. A
// wrong flux is detected.
static void both_laws_hold_at_boundary_inputs(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= SEEDS; ++seed) {
        boundary_inputs l;
        open(&l, seed, seed % 2 == 0 ? "rk4" : "discrete_gradient", 0.02, 1, (pm_hold)(seed % 3));
        run(&l);
        const pm_sample *sample = pm_monolithic_sample(l.assembly);
        for (int port = 0; port < 3; port += 2) {
            const pm_flux *flux = &sample->flux[port][port == 0 ? 0 : 1];
            if (!(flux->energy_gross > 1e-9 && flux->entropy_gross > 1e-9)) {
                random_system_fail(&l.w, "port %d: nothing is exchanged with the boundary input",
                                   port);
            }
        }
        // An iteration may not converge; energy_with_the_outside_is_kept bounds what that costs.
        assert_int_equal(l.ledger.violations, l.ledger.unbalanced);
        pm_sample wrong = *sample;
        wrong.flux[2][1].energy *= 1 + 1e-9;
        assert_int_equal(pm_ledger_add_sample(&l.ledger, &wrong), PM_ELAW);
        assert_non_null(strstr(pm_error(), "tip"));
        close(&l);
    }
}

// The total energy, including what the boundary inputs received, changes by the error of the
// integrator alone. The state has the same order of error, so that sampling the boundary inputs
// adds none, whether they are smooth, have kinks, or jump at samples.
static void energy_with_the_outside_is_kept(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 6; ++seed) {
        double drift[3], given = 0, z[3][NZ], distance[2] = {0, 0};
        for (int i = 0; i < 3; ++i) {
            boundary_inputs l;
            open(&l, seed, "rk4", 0.02 / (1 << i), 1 << i, (pm_hold)(seed % 3));
            run(&l);
            drift[i] = l.ledger.energy - l.ledger.first_energy;
            given = l.ledger.outside_energy;
            memcpy(z[i], pm_monolithic_sample(l.assembly)->z, sizeof z[i]);
            close(&l);
        }
        for (int k = 0; k < NZ; ++k) {
            distance[0] = fmax(distance[0], fabs(z[1][k] - z[0][k]));
            distance[1] = fmax(distance[1], fabs(z[2][k] - z[1][k]));
        }
        // Of two halvings and of one.
        const double ratio[2] = {fabs(drift[0] / drift[2]), distance[0] / distance[1]};
        if (!(fabs(drift[2]) < 1e-4 * fabs(given) && ratio[0] > 100 && ratio[1] > 13 &&
              ratio[1] < 20)) {
            fail_msg("seed %d: %g J to the random_system; energy drifts by %g, %g, %g J, ratio %g; "
                     "states converge by %g, expected 16",
                     (int)seed, given, drift[0], drift[1], drift[2], ratio[0], ratio[1]);
        }
    }
}

// --- a boundary input in the place of a neighbour ---

// The pair, and its second subsystem alone with a boundary input in the place of the first.
static const char alone[] =
    "scene: alone\n"
    "time: {dt: 0.02, steps: 1, integrator: euler}\n"
    "subsystems: {b: {weights: b.h5, state: " STATE "}}\n"
    "boundary_inputs:\n"
    "  a:\n"
    "    q: {unit: m, value: [y0, y1], dE: [e0, e1], dS: [n0, n1]}\n"
    "    p: {unit: kg, value: [y2, y3], dE: [e2, e3], dS: [n2, n3]}\n"
    "    s: {unit: J, value: y4, dE: e4, dS: n4}\n"
    "ports:\n"
    "  joint: {law: bracket, between: [a, b], weights: joint.h5, expose: {a: " EXPOSE ", b: " EXPOSE
    "}}\n";
static const char *const shown[] = {"y0", "y1", "y2", "y3", "y4", "e0", "e1", "e2",
                                    "e3", "e4", "n0", "n1", "n2", "n3", "n4"};

static void copy_params(const pm_params *from, pm_params *to) {
    assert_int_equal(from->count, to->count);
    for (int i = 0; i < from->count; ++i) {
        const pm_param_entry *entry = &from->entry[i];
        memcpy(to->entry[i].value, entry->value,
               (size_t)(entry->rows * entry->cols) * sizeof *entry->value);
    }
}

// Every state of the dataset holds what subsystem a exposes at its end at z.
static pm_dataset *show(const random_system *pair) {
    pm_local_subsystems *a = NULL;
    pm_dataset *data = NULL;
    double y[PART_NZ], e[PART_NZ], eta[PART_NZ];
    assert_int_equal(pm_local_subsystems_open(&a, pair->system, 1, &(int){0}), PM_OK);
    pm_local_subsystems_set_state(a, pair->z);
    pm_local_subsystems_get_boundary(a, 0, y, e, eta, NULL, NULL);
    assert_int_equal(pm_dataset_new(&data, 1, NTIME, 3 * PART_NZ, 0.02, shown), PM_OK);
    for (int j = 0; j < NTIME; ++j) {
        double *row = pm_dataset_state(data, 0, j);
        memcpy(row, y, PART_NZ * sizeof *row);
        memcpy(row + PART_NZ, e, PART_NZ * sizeof *row);
        memcpy(row + 2 * PART_NZ, eta, PART_NZ * sizeof *row);
    }
    pm_local_subsystems_close(a);
    return data;
}

static void a_part_cannot_tell_a_boundary_input_from_a_neighbour(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= SEEDS; ++seed) {
        random_system pair, one;
        pm_arena arena = {0};
        pm_boundary_input boundary_input;
        pm_monolithic *assembly[2];
        random_system_of_text(&pair, seed, random_system_scene, random_system_part,
                              random_system_port);
        random_system_of_text(&one, seed, alone, random_system_part, random_system_port);
        pair.scene->physics.integrator = pm_integrator_find("euler");
        copy_params(&pair.system->part[1]->params, &one.system->part[0]->params);
        copy_params(&pair.system->port[0]->params, &one.system->port[0]->params);
        pm_dataset *data = show(&pair);
        assert_int_equal(pm_boundary_input_bind(&boundary_input, one.scene, data, 1, &arena),
                         PM_OK);
        pm_boundary_input_follow(&boundary_input, data, 0);
        assert_int_equal(pm_monolithic_open(&assembly[0], pair.system), PM_OK);
        assert_int_equal(pm_monolithic_open(&assembly[1], one.system), PM_OK);
        pm_monolithic_set_boundary_input(assembly[1], &boundary_input);
        pm_monolithic_set_state(assembly[0], pair.z);
        pm_monolithic_set_state(assembly[1], pair.z + PART_NZ);
        assert_int_equal(pm_monolithic_step(assembly[0]), PM_OK);
        assert_int_equal(pm_monolithic_step(assembly[1]), PM_OK);
        const pm_sample *expected = pm_monolithic_sample(assembly[0]);
        const pm_sample *sample = pm_monolithic_sample(assembly[1]);
        assert_memory_equal(sample->z, expected->z + PART_NZ, PART_NZ * sizeof *sample->z);
        assert_memory_equal(sample->flux[0], expected->flux[0], sizeof sample->flux[0]);
        pm_monolithic_close(assembly[0]);
        pm_monolithic_close(assembly[1]);
        pm_dataset_free(data);
        pm_arena_free(&arena);
        random_system_close(&pair);
        random_system_close(&one);
    }
}

// --- the trainer ---

// A window as data/samples.h lays it out: the states at the beginning and (here zero) after each
// of two steps, then the boundary inputs of both.
static void fill_window(const boundary_inputs *l, const pm_samples *samples, double *window) {
    const size_t nboundary_input = (size_t)samples->input_order * (size_t)samples->nboundary_input;
    memset(window, 0, (size_t)pm_samples_width(samples) * sizeof *window);
    memcpy(window, l->w.z, NZ * sizeof *window);
    for (int step = 0; step < samples->unroll; ++step) {
        memcpy(window + pm_samples_input(samples, step),
               pm_boundary_input_interval(&l->boundary_input, step),
               nboundary_input * sizeof *window);
    }
}

static void trainer_takes_the_same_steps(void **state) {
    (void)state;
    static const char *const integrator[] = {"euler", "heun", "rk4", "rk6", "discrete_gradient"};
    for (uint64_t seed = 1; seed <= SEEDS; ++seed) {
        boundary_inputs l;
        double scale[NZ], *trained;
        open(&l, seed, integrator[seed % 5], 0.02, 1, (pm_hold)(seed % 3));
        for (int i = 0; i < NZ; ++i) {
            scale[i] = 1;
        }
        const pm_loss loss = {
            .residual = PM_RESIDUAL_STEP,
            .integrator = pm_integrator_find(integrator[seed % 5]),
            .substeps = l.w.scene->physics.substeps,
        };
        const pm_samples samples = {.count = 1,
                                    .unroll = 2,
                                    .nz = NZ,
                                    .nboundary_input = l.w.scene->physics.nprescribed,
                                    .input_order = pm_loss_input_order(&loss),
                                    .scale = scale};
        // One step of euler sees a load at its beginning alone.
        assert_int_equal(samples.input_order, seed % 5 == 0 ? 1 : PM_BOUNDARY_INPUT_ORDER);
        pm_graph *g = NULL;
        pm_program *program = NULL;
        pm_loss_nodes nodes;
        require_for(&l, pm_graph_open(&g));
        require_for(&l, pm_loss_graph_build(g, l.w.system, &samples, &loss, &nodes));
        require_for(&l, pm_program_open(&program, g, 1, &nodes.residual, 1));
        fill_window(&l, &samples, pm_program_value(program, nodes.input));
        pm_program_run(program, 1);
        trained = pm_program_value(program, nodes.residual);
        for (int step = 0; step < 2; ++step) {
            require_for(&l, pm_monolithic_step(l.assembly));
            const double *served = pm_monolithic_sample(l.assembly)->z;
            for (int i = 0; i < NZ; ++i) {
                random_system_check(&l.w, "state", trained[step * NZ + i], served[i],
                                    STEP_TOLERANCE * (1 + fabs(served[i])));
            }
        }
        pm_program_close(program);
        pm_graph_close(g);
        close(&l);
    }
}

static void a_run_ends_with_what_it_follows(void **state) {
    (void)state;
    boundary_inputs l;
    open(&l, 1, "rk4", 0.02, 1, PM_HOLD_SMOOTH);
    run(&l);
    assert_int_equal(pm_monolithic_step(l.assembly), PM_EDATA);
    assert_non_null(strstr(pm_error(), "boundary input idle: the trajectory that it follows ends "
                                       "after 8 steps"));
    close(&l);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(both_laws_hold_at_boundary_inputs),
        cmocka_unit_test(energy_with_the_outside_is_kept),
        cmocka_unit_test(a_part_cannot_tell_a_boundary_input_from_a_neighbour),
        cmocka_unit_test(trainer_takes_the_same_steps),
        cmocka_unit_test(a_run_ends_with_what_it_follows),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
