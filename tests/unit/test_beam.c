// Compares material, element, solver and loads of the simulated beam with exact solutions.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "bodies/truth/beam.h"
#include "bodies/truth/beam_solve.h"
#include "tests/support/unit.h"

static const pm_beam_material elastic = {.C10 = 1.5e5, .C01 = 5e3, .D1 = 1e-7};
static const pm_beam_material viscous = {
    .C10 = 1.5e5, .C01 = 5e3, .D1 = 1e-7, .nbranch = 2, .g = {0.3, 0.49}, .tau = {0.2, 0.5}};

// A rotation about (1, 2, 3) by `angle`, by Rodrigues' formula.
static void rotation(double angle, double R[9]) {
    const double n[3] = {1 / sqrt(14), 2 / sqrt(14), 3 / sqrt(14)};
    for (int i = 0; i < 9; ++i) {
        const int r = i / 3, c = i % 3;
        const double skew = r == c ? 0 : ((c - r + 3) % 3 == 1 ? -1 : 1) * n[3 - r - c];
        R[i] = cos(angle) * (r == c) + sin(angle) * skew + (1 - cos(angle)) * n[r] * n[c];
    }
}

static void multiply(const double *A, const double *B, double *AB) {
    for (int i = 0; i < 9; ++i) {
        AB[i] = 0;
        for (int k = 0; k < 3; ++k) {
            AB[i] += A[i / 3 * 3 + k] * B[3 * k + i % 3];
        }
    }
}

// --- the material ---

// At a held stretch the stress of every branch decays as its term of the Prony series.
static void relaxation_follows_the_series(void **state) {
    (void)state;
    const double x = 1.6, F[9] = {x, 0, 0, 0, 1 / sqrt(x), 0, 0, 0, 1 / sqrt(x)};
    const double spring = 2 * (viscous.C10 * (x * x - 1 / x) + viscous.C01 * (x - 1 / (x * x)));
    const double branch = 2 * (viscous.C10 + viscous.C01) * (x * x - 1 / x);
    pm_beam_memory before, after;
    pm_beam_response response;
    pm_beam_memory_init(&before);
    pm_beam_material_respond(&viscous, 1e-12, F, 1, &before, &after, &response);
    for (int k = 1; k <= 30; ++k) {
        double expected = (1 - 0.3 - 0.49) * spring;
        before = after;
        pm_beam_material_respond(&viscous, 0.05, F, 1, &before, &after, &response);
        for (int i = 0; i < 2; ++i) {
            expected += viscous.g[i] * exp(-0.05 * k / viscous.tau[i]) * branch;
        }
        assert_near("tension", response.stress[PM_XX] - response.stress[PM_YY], expected,
                    1e-9 * branch);
        assert_true(response.dissipated >= 0);
    }
}

// A rotation of a strained and partly relaxed body rotates its stress and changes no energy.
static void rotation_turns_the_stress(void **state) {
    (void)state;
    const double F[9] = {1.2, 0.3, 0.1, 0, 0.9, -0.2, 0.1, 0, 1}, J = pm_tensor_det3(F);
    double R[9], RF[9], expected[PM_SYMMETRIC];
    pm_beam_memory start, strained, after;
    pm_beam_response before, turned;
    pm_beam_memory_init(&start);
    pm_beam_material_respond(&viscous, 0.1, F, J, &start, &strained, &before);
    pm_beam_material_respond(&viscous, 0.2, F, J, &strained, &after, &before);
    rotation(0.8, R);
    multiply(R, F, RF);
    pm_beam_material_respond(&viscous, 0.2, RF, J, &strained, &after, &turned);
    pm_tensor_push(R, before.stress, expected);
    for (int i = 0; i < PM_SYMMETRIC; ++i) {
        assert_near("stress", turned.stress[i], expected[i], 1e-9);
    }
    assert_near("energy", turned.energy, before.energy, 1e-9);
    assert_near("dissipated", turned.dissipated, before.dissipated, 1e-8);
}

// --- elements ---

// Deforms 2x2x2 distorted bricks by `F`, and computes the forces at the inner node and the stresses
// of the elements.
static void respond_patch(const double F[9], double *inner, double stress[8][PM_SYMMETRIC]) {
    pm_arena arena = {0};
    pm_beam_mesh mesh;
    pm_beam_memory memory[PM_BEAM_POINTS], after[PM_BEAM_POINTS];
    const int count[3] = {2, 2, 2};
    const double size[3] = {2, 3, 4}, shift[3] = {0.2, -0.3, 0.25};
    assert_int_equal(pm_beam_mesh_make(&mesh, count, size, &arena), PM_OK);
    const int centre = pm_beam_mesh_node(&mesh, 1, 1, 1);
    memset(inner, 0, 3 * sizeof *inner);
    for (int d = 0; d < 3; ++d) {
        mesh.position[centre][d] += shift[d];
    }
    for (int e = 0; e < 8; ++e) {
        double x[PM_BEAM_FREEDOMS], q[PM_BEAM_FREEDOMS];
        pm_beam_element element;
        pm_beam_element_response response;
        for (int i = 0; i < PM_BEAM_FREEDOMS; ++i) {
            const double *at = mesh.position[mesh.hexahedron[e][i / 3]];
            const double *row = F + 3 * (i % 3);
            x[i] = at[i % 3];
            q[i] = row[0] * at[0] + row[1] * at[1] + row[2] * at[2];
        }
        for (int p = 0; p < PM_BEAM_POINTS; ++p) {
            pm_beam_memory_init(&memory[p]);
        }
        pm_beam_element_init(&element, x);
        assert_true(pm_beam_element_respond(&element, &viscous, 0.1, q, memory, after, &response));
        memcpy(stress[e], response.stress, sizeof response.stress);
        for (int i = 0; i < PM_BEAM_FREEDOMS; ++i) {
            inner[i % 3] += mesh.hexahedron[e][i / 3] == centre ? response.force[i] : 0;
        }
    }
    pm_arena_free(&arena);
}

// Uniform strain is an equilibrium, and gives the same stress in all elements, whatever their
// shape.
static void patch_test(void **state) {
    (void)state;
    const double F[9] = {1.1, 0.2, 0, -0.1, 0.95, 0.05, 0, 0.1, 1.02};
    double inner[3], stress[8][PM_SYMMETRIC];
    respond_patch(F, inner, stress);
    for (int d = 0; d < 3; ++d) {
        assert_near("inner force", inner[d], 0, 1e-7);
    }
    for (int e = 1; e < 8; ++e) {
        for (int m = 0; m < PM_SYMMETRIC; ++m) {
            assert_near("stress", stress[e][m], stress[0][m], 1e-7);
        }
    }
    assert_true(fabs(stress[0][PM_XY]) > 1e3);
}

static void rigid_rotation_is_free_of_stress(void **state) {
    (void)state;
    double R[9], inner[3], stress[8][PM_SYMMETRIC];
    rotation(1.3, R);
    respond_patch(R, inner, stress);
    for (int e = 0; e < 8; ++e) {
        for (int m = 0; m < PM_SYMMETRIC; ++m) {
            assert_near("stress", stress[e][m], 0, 1e-7);
        }
    }
}

// --- the solver ---

typedef struct bar {
    pm_arena arena;
    pm_beam_mesh mesh;
    pm_beam *beam;
    double *f;
} bar;

static void make_bar(bar *b, const pm_beam_material *material) {
    const int count[3] = {8, 2, 2};
    const double size[3] = {16, 4, 4};
    *b = (bar){.beam = NULL};
    assert_int_equal(pm_beam_mesh_make(&b->mesh, count, size, &b->arena), PM_OK);
    assert_int_equal(pm_beam_new(&b->beam, &b->mesh, material, 0), PM_OK);
    b->f = pm_arena_array(&b->arena, (size_t)b->mesh.nnode, 3 * sizeof *b->f);
}

static void free_bar(bar *b) {
    pm_beam_free(b->beam);
    pm_arena_free(&b->arena);
}

static pm_beam_convergence step_to(bar *b, const pm_beam_load *load, double t, double h) {
    pm_beam_convergence convergence;
    pm_beam_load_at(load, &b->mesh, t, b->f);
    if (pm_beam_step(b->beam, h, b->f, &convergence) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return convergence;
}

// Near the end each iteration squares the residual, but for rounding. This holds only if the
// tangent is consistent with the step.
static void newton_converges_quadratically(void **state) {
    (void)state;
    const pm_beam_material *materials[] = {&elastic, &viscous};
    const double near = 50, rounding = 1e-6, factor = 5e-5; // N, N, 1/N
    for (int m = 0; m < 2; ++m) {
        bar b;
        pm_beam_load load;
        int compared = 0;
        make_bar(&b, materials[m]);
        pm_beam_load_row(&load, &b.mesh, 0, 0, 6e3, 1);
        step_to(&b, &load, 0.4, 0.4);
        const pm_beam_convergence c = step_to(&b, &load, 0.8, 0.4);
        for (int k = 0; k + 1 < c.niteration; ++k) {
            const double now = c.residual[k], next = c.residual[k + 1];
            if (now < near && next > rounding) {
                assert_near("residual", next, 0, factor * now * now);
                ++compared;
            }
        }
        assert_true(compared >= 1);
        free_bar(&b);
    }
}

// Returns |stored + dissipated - work| over the work, after ramp, hold and unload in steps of h s.
static double imbalance(double h) {
    bar b;
    const pm_beam_load load = {.nnode = 1,
                               .node = {8},
                               .force = {2e3, -4e3, 6e3},
                               .time = {0, 0.2, 0.6, 0.8},
                               .fraction = {0, 1, 1, 0}};
    make_bar(&b, &viscous);
    double largest = 0, lack = 0;
    for (int k = 1; k <= lround(1.2 / h); ++k) {
        const double before = pm_beam_now(b.beam)->energy->dissipated;
        step_to(&b, &load, k * h, h);
        const pm_beam_energy *now = pm_beam_now(b.beam)->energy;
        assert_true(now->dissipated > before);
        largest = fmax(largest, now->work);
        lack = fmax(lack, fabs(now->stored + now->dissipated - now->work));
    }
    free_bar(&b);
    return lack / largest;
}

// The work of the loads is the stored and the dissipated energy, to second order in the step.
static void energy_is_balanced(void **state) {
    (void)state;
    const double coarse = imbalance(0.05), fine = imbalance(0.025);
    assert_true(coarse < 2e-2);
    assert_in_range(lround(10 * coarse / fine), 30, 50);
}

static void row_of_the_top_face(void **state) {
    (void)state;
    bar b;
    pm_beam_load load;
    make_bar(&b, &elastic);
    pm_beam_load_row(&load, &b.mesh, 1, 3, 7, 2);
    pm_beam_load_at(&load, &b.mesh, 0.5, b.f);
    for (int i = 0; i < b.mesh.nnode; ++i) {
        const bool loaded = b.mesh.position[i][0] == 10 && b.mesh.position[i][2] == 4;
        assert_near("force", b.f[3 * i + 2], loaded ? -7 * 0.25 : 0, 1e-15);
        assert_near("force", b.f[3 * i] + b.f[3 * i + 1], 0, 0);
    }
    free_bar(&b);
}

// The surface of a box: its faces point outwards and have its area, and those near the clamp are
// not drawn.
static void surface_of_a_box(void **state) {
    (void)state;
    bar b;
    pm_arena arena = {0};
    pm_beam_skin skin;
    pm_rng rng;
    make_bar(&b, &elastic);
    assert_int_equal(pm_beam_skin_make(&skin, &b.mesh, &arena), PM_OK);
    const int *n = b.mesh.count;
    const double *l = b.mesh.size;
    double area = 0, volume = 0;
    assert_int_equal(skin.nface, 2 * (n[0] * n[1] + n[1] * n[2] + n[2] * n[0]));
    assert_int_equal(skin.nnode, b.mesh.nnode - (n[0] - 1) * (n[1] - 1) * (n[2] - 1));
    for (int i = 0; i < skin.nface; ++i) {
        const pm_beam_face *face = &skin.face[i];
        area += face->area;
        for (int d = 0; d < 3; ++d) {
            volume += face->area * face->outward[d] * face->centre[d] / 3; // by Gauss's theorem
        }
    }
    assert_near("area", area, 2 * (l[0] * l[1] + l[1] * l[2] + l[2] * l[0]), 1e-12 * area);
    assert_near("volume", volume, l[0] * l[1] * l[2], 1e-12 * volume);
    for (int i = 0; i < skin.nnode; ++i) {
        const double up[3] = {0, 0, 1};
        assert_true(pm_beam_skin_faces(&skin, i, up) == (b.mesh.position[skin.node[i]][2] == l[2]));
    }
    pm_rng_init(&rng, 1, 0);
    for (int k = 0; k < 200; ++k) {
        assert_true(pm_beam_skin_draw(&skin, 0.4, &rng)->centre[0] >= 0.39 * l[0]);
    }
    pm_arena_free(&arena);
    free_bar(&b);
}

// A patch on a surface of any shape: equal forces on free nodes of one side, which press inwards.
static void patch_on_a_surface(void **state) {
    (void)state;
    bar b;
    pm_arena arena = {0};
    pm_beam_skin skin;
    make_bar(&b, &elastic);
    assert_int_equal(pm_beam_skin_make(&skin, &b.mesh, &arena), PM_OK);
    const pm_beam_patches patches = {.force = {8, 8},
                                     .length = {4, 5},
                                     .width = {2, 3},
                                     .face = -1,
                                     .ramp = {1, 1},
                                     .hold = {1, 1},
                                     .unload = {1, 1}};
    for (int k = 0; k < 50; ++k) {
        pm_rng rng;
        pm_beam_load load;
        pm_rng_init(&rng, 7, (uint64_t)k);
        pm_beam_load_skin(&load, &b.mesh, &skin, &patches, &rng);
        assert_true(load.nnode > 0);
        int axis = -1; // normal to the side; the force has this component alone, since tilt is 0
        for (int d = 0; d < 3; ++d) {
            axis = fabs(load.force[d]) * load.nnode > 1 ? d : axis;
        }
        assert_near("total force", fabs(load.force[axis]) * load.nnode, 8, 1e-12);
        for (int i = 0; i < load.nnode; ++i) {
            const double *x = b.mesh.position[load.node[i]];
            assert_false(b.mesh.clamped[load.node[i]]);
            assert_near("side", x[axis], load.force[axis] < 0 ? b.mesh.size[axis] : 0, 1e-12);
        }
    }
    pm_arena_free(&arena);
    free_bar(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(relaxation_follows_the_series),
        cmocka_unit_test(rotation_turns_the_stress),
        cmocka_unit_test(patch_test),
        cmocka_unit_test(rigid_rotation_is_free_of_stress),
        cmocka_unit_test(newton_converges_quadratically),
        cmocka_unit_test(energy_is_balanced),
        cmocka_unit_test(row_of_the_top_face),
        cmocka_unit_test(surface_of_a_box),
        cmocka_unit_test(patch_on_a_surface),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
