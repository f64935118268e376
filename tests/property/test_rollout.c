// Laws of rollouts: rotated states give rotated rollouts, every integrator has its order, and the
// step of the trainer equals that of the simulation.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "fit/normalization.h"
#include "graph/program.h"
#include "sim/monolithic.h"
#include "sim/step_graph.h"
#include "tests/support/random_system.h"
#include "tests/support/unit.h"

#define NZ 10
#define MAX_NZ 32
#define SYSTEMS 60
// The tolerance for equal sums in another order.
#define STEP_TOLERANCE 1e-13
#define STATES 40 // that the normalisation is made from

// Fixes scales and means from data as training does, with one scale for all components of a group.
static void normalise(random_system *w) {
    double z[STATES * 2 * NZ], scale[NZ];
    for (int i = 0; i < STATES * 2 * NZ; ++i) {
        z[i] = pm_rng_normal(&w->rng);
    }
    for (int i = 0; i < NZ; ++i) {
        scale[i] = 1;
    }
    const pm_samples samples = {
        .count = STATES, .unroll = 1, .nz = w->scene->physics.nz, .z = z, .scale = scale};
    assert_int_equal(pm_normalization_of_system(w->system, &samples, true), PM_OK);
}

// Computes the state after `steps` steps, if it is finite.
static pm_status try_roll_out(const random_system *w, const double *z0, int steps, double *z) {
    pm_monolithic *assembly = NULL;
    assert_int_equal(pm_monolithic_open(&assembly, w->system), PM_OK);
    pm_monolithic_set_state(assembly, z0);
    pm_status status = PM_OK;
    for (int i = 0; i < steps && status == PM_OK; ++i) {
        status = pm_monolithic_step(assembly);
    }
    memcpy(z, pm_monolithic_sample(assembly)->z, (size_t)w->scene->physics.nz * sizeof *z);
    pm_monolithic_close(assembly);
    return status;
}

static void roll_out(const random_system *w, const double *z0, int steps, double *z) {
    if (try_roll_out(w, z0, steps, z) != PM_OK) {
        random_system_fail(w, "%s", pm_error());
    }
}

static double distance(int n, const double *x, const double *y) {
    double sum = 0;
    for (int i = 0; i < n; ++i) {
        sum += (x[i] - y[i]) * (x[i] - y[i]);
    }
    return sqrt(sum);
}

// --- rotation ---

// Rotates q and p of both links, which begin at 0, 2, 5 and 7.
static void rotate(double angle, const double *z, double *rotated) {
    static const int vector[] = {0, 2, 5, 7};
    memcpy(rotated, z, NZ * sizeof *z);
    for (int i = 0; i < 4; ++i) {
        const double x = z[vector[i]], y = z[vector[i] + 1];
        rotated[vector[i]] = cos(angle) * x - sin(angle) * y;
        rotated[vector[i] + 1] = sin(angle) * x + cos(angle) * y;
    }
}

static void rotating_the_start_rotates_the_rollout(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 50; ++seed) {
        random_system w;
        double rotated[NZ], z[NZ], expected[NZ], from_rotated[NZ];
        random_system_of_text(&w, seed, random_system_scene, random_system_part,
                              random_system_port);
        normalise(&w);
        for (int i = 0; i < NZ; ++i) {
            w.z[i] *= 0.5; // random potentials may run away from further out
        }
        const double angle = 6 * pm_rng_uniform(&w.rng);
        rotate(angle, w.z, rotated);
        roll_out(&w, w.z, 10, z);
        rotate(angle, z, expected);
        roll_out(&w, rotated, 10, from_rotated);
        if (!(distance(NZ, z, w.z) > 1e-3)) {
            random_system_fail(&w, "the state hardly moved");
        }
        // Rounding, as the motion amplifies it.
        random_system_check(&w, "distance", distance(NZ, from_rotated, expected), 0,
                            1e-10 * (1 + distance(NZ, z, (const double[NZ]){0})));
        random_system_close(&w);
    }
}

// --- order of convergence ---

static void steps_of(random_system *w, const char *integrator, double dt) {
    w->scene->physics.integrator = pm_integrator_find(integrator);
    w->scene->physics.dt = dt;
    w->scene->physics.substeps = 1;
}

// Halving the step reduces the error of three systems by a factor of 2^order, twice in a row.
static void check_order(const pm_integrator *rk) {
    const double end = 0.16;
    double error[3] = {0, 0, 0};
    for (uint64_t seed = 1; seed <= 3; ++seed) {
        random_system w;
        double exact[NZ], z[NZ];
        random_system_of_text(&w, seed, random_system_scene, random_system_part,
                              random_system_port);
        normalise(&w);
        for (int i = 0; i < NZ; ++i) {
            w.z[i] *= 0.5;
        }
        steps_of(&w, "rk6", end / 1024);
        roll_out(&w, w.z, 1024, exact);
        for (int i = 0; i < 3; ++i) {
            const int steps = (rk->order == 4 ? 16 : 32) << i;
            steps_of(&w, rk->name, end / steps);
            roll_out(&w, w.z, steps, z);
            error[i] += distance(NZ, z, exact);
        }
        random_system_close(&w);
    }
    for (int i = 0; i < 2; ++i) {
        const double order = log2(error[i] / error[i + 1]);
        if (!(fabs(order - rk->order) < 0.25)) {
            fail_msg("order of %s after %d halvings: %.3g, errors %.3g and %.3g", rk->name, i + 1,
                     order, error[i], error[i + 1]);
        }
    }
}

// Tests every integrator in the table by its listed name.
static void integrators_converge_at_their_order(void **state) {
    (void)state;
    char names[256];
    snprintf(names, sizeof names, "%s", pm_integrator_names());
    for (char *rest = names, *name; (name = strtok_r(rest, ", ", &rest)) != NULL;) {
        const pm_integrator *rk = pm_integrator_find(name);
        assert_non_null(rk);
        check_order(rk);
    }
}

// --- the trainer's step ---

// Runs the step graph on one state.
static void graph_step(const random_system *w, const double *z0, double *z) {
    const pm_scene *scene = w->scene;
    pm_graph *g = NULL;
    pm_program *program = NULL;
    pm_state_nodes nodes[2];
    pm_node k[2 * PM_MAX_STAGES], part[2], degeneracy = PM_NO_NODE;
    pm_node last[1];
    int responding[NZ];
    const pm_step_work work = {nodes, k, last, responding, PM_NO_NODE};
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node input = pm_input(g, true, 1, scene->physics.nz);
    for (int i = 0; i < 2; ++i) {
        part[i] = pm_slice(g, input, scene->physics.subsystem[i].first,
                           scene->physics.subsystem[i].layout.nz);
    }
    pm_build_step(g, w->system, scene->physics.integrator,
                  scene->physics.dt / scene->physics.substeps, scene->physics.substeps, part,
                  PM_NO_NODE, &degeneracy, &work);
    const pm_node output = pm_concat(g, 2, part);
    assert_int_equal(pm_program_open(&program, g, 1, &output, 1), PM_OK);
    memcpy(pm_program_value(program, input), z0, (size_t)scene->physics.nz * sizeof *z0);
    pm_program_run(program, 1);
    memcpy(z, pm_program_value(program, output), (size_t)scene->physics.nz * sizeof *z);
    pm_program_close(program);
    pm_graph_close(g);
}

// The laws of random_system_port act on momenta and temperatures, so that the exchange needs
// prediction. The step is so short that the trainer's fixed number of iterations converges.
static void trainer_iterates_the_same_step(void **state) {
    (void)state;
    for (uint64_t seed = 1; seed <= 10; ++seed) {
        random_system w;
        double served[NZ], trained[NZ];
        random_system_of_text(&w, seed, random_system_scene, random_system_part,
                              random_system_port);
        normalise(&w);
        steps_of(&w, "discrete_gradient", 0.001);
        w.scene->physics.substeps = 2;
        roll_out(&w, w.z, 1, served);
        graph_step(&w, w.z, trained);
        for (int i = 0; i < NZ; ++i) {
            const double size = fabs(served[i]) + fabs(served[i] - w.z[i]) + 1;
            random_system_check(&w, "z after a step", trained[i], served[i], STEP_TOLERANCE * size);
        }
        random_system_close(&w);
    }
}

static void trainer_takes_the_same_step(void **state) {
    (void)state;
    static const char *const integrator[] = {"euler", "heun", "rk4", "rk6"};
    int finite = 0;
    for (uint64_t seed = 1; seed <= SYSTEMS; ++seed) {
        random_system w;
        double served[MAX_NZ], trained[MAX_NZ];
        random_system_random(&w, seed, seed % 2 == 0 ? PM_HARD : PM_SOFT);
        w.scene->physics.integrator = pm_integrator_find(integrator[seed % 4]);
        w.scene->physics.substeps = 1 + (int)(seed % 3);
        const bool ran_away = try_roll_out(&w, w.z, 1, served) != PM_OK;
        finite += ran_away ? 0 : 1;
        graph_step(&w, w.z, trained);
        for (int i = 0; i < w.scene->physics.nz && !ran_away; ++i) {
            const double size = fabs(served[i]) + fabs(served[i] - w.z[i]) + 1;
            random_system_check(&w, "z after a step", trained[i], served[i], STEP_TOLERANCE * size);
        }
        random_system_close(&w);
    }
    if (finite < SYSTEMS * 3 / 4) {
        fail_msg("only %d of %d steps were finite", finite, SYSTEMS);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rotating_the_start_rotates_the_rollout),
        cmocka_unit_test(integrators_converge_at_their_order),
        cmocka_unit_test(trainer_takes_the_same_step),
        cmocka_unit_test(trainer_iterates_the_same_step),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
