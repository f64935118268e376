// Compares beams in contact with derivatives of their energy, laws of mechanics and known
// solutions.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "bodies/truth/beam.h"
#include "bodies/truth/beam_contact.h"
#include "bodies/truth/beam_solve.h"
#include "tests/support/unit.h"

static const pm_beam_material elastic = {.C10 = 1.5e5, .C01 = 5e3, .D1 = 1e-7};

// Two bars of 16 x 4 x 4 m, the second above the first, parallel to it or across its outer half.
typedef struct pair {
    pm_arena arena;
    pm_beam_mesh mesh;
    pm_beam_contact contact;
    pm_beam *beam;
    double *q, *f; // [nnode][3]
} pair;

static void make_pair(pair *p, bool crossed, double gap, double stiffness) {
    const int count[3] = {8, 2, 2};
    const double size[3] = {16, 4, 4};
    const pm_placement placement[2] = {
        {.axis = {0, 1, 2}, .sign = {1, 1, 1}},
        {.origin = {crossed ? 14.05 : 0, crossed ? -9.95 : 0, 4 + gap},
         .axis = {crossed, !crossed, 2},
         .sign = {1, crossed ? -1 : 1, 1}}};
    *p = (pair){.beam = NULL};
    assert_int_equal(pm_beam_mesh_place(&p->mesh, count, size, 2, placement, &p->arena), PM_OK);
    assert_int_equal(pm_beam_contact_make(&p->contact, &p->mesh, stiffness, &p->arena), PM_OK);
    assert_int_equal(pm_beam_new(&p->beam, &p->mesh, &elastic, stiffness), PM_OK);
    p->f = pm_arena_array(&p->arena, (size_t)p->mesh.nnode, 3 * sizeof *p->f);
    p->q = pm_arena_array(&p->arena, (size_t)p->mesh.nnode, 3 * sizeof *p->q);
    memcpy(p->q, p->mesh.position, (size_t)p->mesh.nnode * sizeof *p->mesh.position);
}

static void free_pair(pair *p) {
    pm_beam_free(p->beam);
    pm_arena_free(&p->arena);
}

// --- the law of contact ---

static bool respond(const pair *p, int i, pm_beam_contact_force *force) {
    return pm_beam_contact_respond(&p->contact, &p->contact.candidate[i], p->q, true, force);
}

// In blocks that overlap uniformly every node gets its share of a uniform pressure.
static void even_pressure_is_carried_evenly(void **state) {
    (void)state;
    const double stiffness = 1e6, depth = 0.01, pressure = stiffness * depth;
    pair p;
    pm_beam_contact_force force;
    make_pair(&p, false, 0, stiffness);
    const int half = p.mesh.nnode / 2;
    for (int i = half; i < p.mesh.nnode; ++i) {
        p.q[3 * i + 2] -= depth;
    }
    for (int i = 0; i < p.contact.ncandidate; ++i) {
        assert_true(respond(&p, i, &force));
        assert_near("depth", force.depth, depth, 1e-14);
        for (int k = 0; k < 3 * force.nnode; ++k) {
            p.f[3 * force.node[k / 3] + k % 3] += force.force[k / 3][k % 3];
        }
    }
    for (int i = 0; i < p.mesh.nnode; ++i) {
        const double *x = p.mesh.position[i];
        const double area = (x[0] == 0 || x[0] == 16 ? 1 : 2) * (x[1] == 0 || x[1] == 4 ? 1 : 2);
        const double sign = i < half ? -1 : 1;
        assert_near("force", p.f[3 * i + 2], x[2] == 4 ? sign * pressure * area : 0, 1e-8);
        assert_near("force", fabs(p.f[3 * i]) + fabs(p.f[3 * i + 1]), 0, 1e-8);
    }
    free_pair(&p);
}

// Bends crossed bars into each other, and displaces their nodes at random.
static void bend(pair *p, pm_rng *rng) {
    for (int i = 0; i < p->mesh.nnode; ++i) {
        const bool upper = i >= p->mesh.nnode / 2;
        const double *X = p->mesh.position[i];
        const double along = upper ? X[1] + 9.95 : X[0];
        p->q[3 * i + 2] = X[2] + (upper ? -1 : 1) * 0.0004 * along * along;
        for (int d = 0; d < 3; ++d) {
            p->q[3 * i + d] += 0.003 * pm_rng_normal(rng);
        }
    }
}

// Force = -d(energy)/dq, stiffness = -d(force)/dq by central differences.
static void check_derivatives(pair *p, int candidate) {
    const double step = 1e-6;
    static pm_beam_contact_force here, less, more;
    assert_true(respond(p, candidate, &here));
    const int n = 3 * here.nnode;
    for (int k = 0; k < n; ++k) {
        double *q = &p->q[3 * here.node[k / 3] + k % 3];
        const double at = *q;
        *q = at - step;
        assert_true(respond(p, candidate, &less));
        *q = at + step;
        assert_true(respond(p, candidate, &more));
        *q = at;
        assert_near("force", here.force[k / 3][k % 3], (less.energy - more.energy) / (2 * step),
                    1e-7 * p->contact.stiffness * here.depth);
        for (int m = 0; m < n && here.depth < 0.015; ++m) {
            const double difference = less.force[m / 3][m % 3] - more.force[m / 3][m % 3];
            assert_near("stiffness", here.stiffness[n * m + k], difference / (2 * step),
                        1e-5 * p->contact.stiffness);
        }
    }
}

static void forces_and_stiffness_are_derivatives(void **state) {
    (void)state;
    int touching = 0, beyond = 0;
    pm_rng rng;
    pm_rng_init(&rng, 5, 0);
    for (int trial = 0; trial < 3; ++trial) {
        pair p;
        static pm_beam_contact_force force;
        make_pair(&p, true, 0.1, 1e6);
        bend(&p, &rng);
        for (int i = 0; i < p.contact.ncandidate; ++i) {
            if (respond(&p, i, &force)) {
                ++touching;
                beyond += force.nnode > 17;
                check_derivatives(&p, i);
            }
        }
        free_pair(&p);
    }
    assert_true(touching >= 20);
    assert_true(beyond >= 2);
}

// When a node of the lower bar is pushed sideways over the edge x = 14.05 of the upper one, the
// energy falls to zero without a jump.
static void edges_let_go_smoothly(void **state) {
    (void)state;
    const double step = 1e-4, depth = 0.05, stiffness = 1e6;
    pair p;
    static pm_beam_contact_force force;
    make_pair(&p, true, 0, stiffness);
    double *x = p.q + 3 * (size_t)p.contact.candidate[0].node, before = NAN, steepest = 0;
    for (int k = -3000; k <= 3000; ++k) {
        x[0] = 14.05 + k * step;
        x[1] = 2;
        x[2] = 4 + depth;
        const double energy = respond(&p, 0, &force) ? force.energy : 0;
        assert_true(k > -3000 ? energy <= before * (1 + 1e-9) : energy > 0);
        steepest = k > -3000 ? fmax(steepest, before - energy) : 0;
        before = energy;
    }
    assert_near("energy", before, 0, 0);
    // Over the width of the bend, sqrt(2 0.2 depth), the energy falls at most at twice the mean
    // rate.
    const double whole = stiffness / 2 * p.contact.candidate[0].area * depth * depth / 2;
    assert_true(steepest < 2 * whole * step / sqrt(0.4 * depth));
    free_pair(&p);
}

// --- equilibrium ---

// Makes the load on the upper bar: f N on each node of the last row of its upper side.
static void set_load(pair *p, const double force[3]) {
    const int half = p->mesh.nnode / 2;
    memset(p->f, 0, 3 * (size_t)p->mesh.nnode * sizeof *p->f);
    for (int j = 0; j <= 2; ++j) {
        memcpy(p->f + 3 * (half + pm_beam_mesh_node(&p->mesh, 8, j, 2)), force, 3 * sizeof *force);
    }
}

static pm_beam_convergence step(pair *p, double h) {
    pm_beam_convergence convergence;
    if (pm_beam_step(p->beam, h, p->f, &convergence) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return convergence;
}

// Two blocks that are pressed together from outside are mirror images of each other: away from the
// clamp the stress normal to the contact is the pressure, and uniform.
static void pressed_blocks_carry_the_pressure(void **state) {
    (void)state;
    double pressure = 2;
    pair p;
    make_pair(&p, false, 0, 1e7);
    for (int k = 0; k < 4; ++k) {
        pressure *= k > 0 ? 10 : 1;
        for (int i = 0; i < p.mesh.nnode; ++i) {
            const double *x = p.mesh.position[i];
            const double area = (x[0] == 16 ? 1 : 2) * (x[1] == 0 || x[1] == 4 ? 1 : 2);
            p.f[3 * i + 2] = pressure * area * ((x[2] == 0) - (x[2] == 8));
        }
        step(&p, 1);
    }
    const pm_beam_state *now = pm_beam_now(p.beam);
    assert_near("depth", now->depth, pressure / 1e7, 0.1 * pressure / 1e7);
    for (int i = 0; i < p.mesh.nnode; ++i) {
        const double *sigma = now->sigma + PM_SYMMETRIC * i;
        if (p.mesh.position[i][0] >= 10) {
            assert_near("pressure", sigma[PM_ZZ], -pressure, 0.01 * pressure);
            assert_near("shear", sigma[PM_XZ], 0, 0.01 * pressure);
        }
    }
    free_pair(&p);
}

static void forces_are_equal_and_opposite(void **state) {
    (void)state;
    pair p;
    double force[3] = {0}, moment[3] = {0}, size = 0;
    make_pair(&p, true, 0.2, 1e7);
    set_load(&p, (const double[]){500, 300, -3e3});
    step(&p, 1);
    const pm_beam_state *now = pm_beam_now(p.beam);
    for (int i = 0; i < p.mesh.nnode; ++i) {
        const double *x = now->q + 3 * i, *f = now->contact + 3 * i;
        for (int d = 0; d < 3; ++d) {
            const int a = (d + 1) % 3, b = (d + 2) % 3;
            force[d] += f[d];
            moment[d] += x[a] * f[b] - x[b] * f[a];
            size += fabs(f[d]);
        }
    }
    assert_true(size > 1e3);
    for (int d = 0; d < 3; ++d) {
        assert_near("force", force[d], 0, 1e-14 * size);
        assert_near("moment", moment[d], 0, 1e-13 * size);
    }
    free_pair(&p);
}

static int touching_nodes(const pair *p) {
    int count = 0;
    for (int i = 0; i < p->mesh.nnode; ++i) {
        count += pm_beam_now(p->beam)->contact[3 * i + 2] != 0;
    }
    return count;
}

// Near the end each iteration squares the residual, but for rounding.
static void newton_converges_quadratically(void **state) {
    (void)state;
    const double near = 50, rounding = 1e-6, factor = 5e-3; // N, N, 1/N
    int compared = 0;
    pair p;
    make_pair(&p, true, 0.2, 1e7);
    for (int k = 1; k <= 8; ++k) {
        set_load(&p, (const double[]){100.0 * k, 0, -400.0 * k});
        const pm_beam_convergence c = step(&p, 1);
        for (int i = 0; i + 1 < c.niteration && touching_nodes(&p) > 0; ++i) {
            const double now = c.residual[i], next = c.residual[i + 1];
            if (now < near && next > rounding) {
                assert_near("residual", next, 0, factor * now * now);
                ++compared;
            }
        }
    }
    assert_true(compared >= 4);
    free_pair(&p);
}

// Presses elastic bars together and releases them along another path, and returns the remaining
// work over its largest value.
static double lost_work(int nstep) {
    pair p;
    int most = 0;
    double largest = 0;
    make_pair(&p, true, 0.2, 1e7);
    for (int k = 1; k <= 2 * nstep; ++k) {
        const double part = k <= nstep ? (double)k / nstep : pow(2 - (double)k / nstep, 2);
        set_load(&p, (const double[]){400 * part, 0, -3e3 * part});
        step(&p, 1);
        most = touching_nodes(&p) > most ? touching_nodes(&p) : most;
        largest = fmax(largest, pm_beam_now(p.beam)->energy[1].work);
    }
    assert_true(most >= 4);
    const pm_beam_state *now = pm_beam_now(p.beam);
    double work = 0;
    for (int b = 0; b < 2; ++b) {
        assert_near("stored", now->energy[b].stored, 0, 1e-6);
        work += now->energy[b].work;
    }
    for (int i = 0; i < 3 * p.mesh.nnode; ++i) {
        assert_near("position", now->q[i], p.mesh.position[i / 3][i % 3], 1e-9);
    }
    free_pair(&p);
    return fabs(work) / largest;
}

// The bars return to their places and give all the work back, but for the error of the trapezoidal
// rule.
static void opening_and_closing_gains_nothing(void **state) {
    (void)state;
    const double coarse = lost_work(16), fine = lost_work(64);
    assert_true(coarse < 1e-2);
    assert_in_range(lround(coarse / fine), 10, 30);
}

// Full steps of Newton's method would jump back and forth between the sides.
static void a_hard_blow_finds_an_equilibrium(void **state) {
    (void)state;
    pair p;
    make_pair(&p, true, 0.2, 1e8);
    set_load(&p, (const double[]){0, 0, -3.2e4});
    step(&p, 1);
    assert_true(touching_nodes(&p) > 0);
    free_pair(&p);
}

// --- the simulator ---

#define BOX                                                                                  \
    "{size: [8, 4, 2], elements: [4, 2, 1], material: {C10: 1.5e5, C01: 5.0e3, D1: 1.0e-7, " \
    "g: [0.5], tau: [0.2]}, substeps: 2, patches: {face: -y, force: [1.0e3, 2.0e3], "        \
    "length: [2, 4], width: [1, 2], tilt: 0.5, ramp: [0.1, 0.2], hold: [0.1, 0.2], "         \
    "unload: [0.1, 0.2]}"
enum { MOST = 2 };

// Simulates three states of trajectory 7 into the fields of its bodies.
static void simulate(const char *text, pm_field *field[MOST], int *nbody) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_arena arena = {0};
    pm_truth_model model = {.title = NULL};
    assert_int_equal(pm_yaml_parse(&document, text, "test", &root), PM_OK);
    if (pm_beam_read(root, &arena, &model) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    const pm_beam_system *system = model.ode.data;
    const pm_beam_mesh *mesh = &system->mesh;
    *nbody = mesh->nbody;
    const pm_field_shape shape = {1,
                                  3,
                                  mesh->nnode / mesh->nbody,
                                  PM_BODY_NVARIABLE,
                                  mesh->nelement / mesh->nbody,
                                  system->name != NULL};
    for (int b = 0; b < mesh->nbody; ++b) {
        assert_int_equal(pm_field_new(&field[b], shape, 0.1, PM_BODY_VARIABLES), PM_OK);
        pm_beam_describe(system, b, field[b]);
    }
    assert_int_equal(pm_beam_run(system, 3, 7, field, 0), PM_OK);
    pm_arena_free(&arena);
    pm_yaml_close(document);
}

static void assert_same(const char *what, const double *value, const double *expected, int count,
                        double tolerance) {
    for (int i = 0; i < count; ++i) {
        assert_near(what, value[i], expected[i], tolerance);
    }
}

// A beam out of reach of the other one moves, in its own frame, as if it were alone, however it is
// placed, and the other one stays at rest.
static void placed_beams_keep_their_own_frame(void **state) {
    (void)state;
    pm_field *alone[MOST], *placed[MOST];
    int nbody;
    simulate(BOX "}", alone, &nbody);
    assert_int_equal(nbody, 1);
    simulate(BOX ", beams: {a: {origin: [1, 2, 3], axes: [+z, -y, +x]}, "
                 "b: {origin: [50, 2, 3], axes: [-y, +z, -x]}}, contact: 1.0e7, loaded: b}",
             placed, &nbody);
    assert_int_equal(nbody, 2);
    const pm_field *one = alone[0], *rest = placed[0], *moved = placed[1];
    const int nnode = one->nnode, nz = nnode * one->nvariable;
    assert_same("mesh", moved->position, one->position, 3 * nnode, 1e-12);
    assert_same("mesh", rest->position, one->position, 3 * nnode, 1e-12);
    assert_same("force", moved->f, one->f, 9 * nnode, 1e-12);
    assert_same("energy", moved->energy, one->energy, 9, 1e-6);
    assert_true(one->energy[8] > 1);
    for (int j = 0; j < 3; ++j) {
        for (int i = 0; i < nz; ++i) {
            assert_near("state", moved->z[j * nz + i], one->z[j * nz + i],
                        i % one->nvariable < 6 ? 1e-9 : 1e-3);
            assert_near("at rest", rest->z[j * nz + i], one->z[i], 1e-5);
        }
    }
    pm_field_free(alone[0]);
    pm_field_free(placed[0]);
    pm_field_free(placed[1]);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(even_pressure_is_carried_evenly),
        cmocka_unit_test(forces_and_stiffness_are_derivatives),
        cmocka_unit_test(edges_let_go_smoothly),
        cmocka_unit_test(pressed_blocks_carry_the_pressure),
        cmocka_unit_test(forces_are_equal_and_opposite),
        cmocka_unit_test(newton_converges_quadratically),
        cmocka_unit_test(opening_and_closing_gains_nothing),
        cmocka_unit_test(a_hard_blow_finds_an_equilibrium),
        cmocka_unit_test(placed_beams_keep_their_own_frame),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
