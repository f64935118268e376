// Compares the simulated beam with the public data of the method's authors. The data are not part
// of this repository; without them the test is skipped.
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "bodies/field/field.h"
#include "bodies/truth/beam.h"
#include "bodies/truth/beam_solve.h"
#include "tests/support/unit.h"

#define PUBLIC_DATA "../shared/data/beam.h5"
#define SKIPPED 77 // the exit code that ctest reports as skipped

static const pm_beam_material elastic = {.C10 = 1.5e5, .C01 = 5e3, .D1 = 1e-7};

typedef struct bar {
    pm_arena arena;
    pm_beam_mesh mesh;
    pm_beam *beam;
    double *f;
} bar;

static void free_bar(bar *b) {
    pm_beam_free(b->beam);
    pm_arena_free(&b->arena);
}

// The node of the public mesh at our node's place.
static int match(const pm_field *public, const double *x) {
    for (int i = 0; i < public->nnode; ++i) {
        const double *y = public->position + 3 * i;
        if (fabs(x[0] - y[0]) + fabs(x[1] - y[1]) + fabs(x[2] - y[2]) < 1e-3) {
            return i;
        }
    }
    fail_msg("no node at %g %g %g", x[0], x[1], x[2]);
    return -1;
}

typedef struct difference {
    double displacement, displacement_scale, stress, stress_scale; // sums of squares
} difference;

static void add_differences(const bar *b, const pm_field *public, const int *node, const double *z,
                            difference *sum) {
    const pm_beam_state *now = pm_beam_now(b->beam);
    for (int i = 0; i < b->mesh.nnode; ++i) {
        const double *other = z + public->nvariable * node[i];
        for (int d = 0; d < 3; ++d) {
            const double u = other[d] - b->mesh.position[i][d];
            sum->displacement += pow(now->q[3 * i + d] - other[d], 2);
            sum->displacement_scale += u * u;
        }
        for (int m = 0; m < PM_SYMMETRIC && !b->mesh.clamped[i]; ++m) {
            sum->stress += pow(now->sigma[PM_SYMMETRIC * i + m] - other[6 + m], 2);
            sum->stress_scale += other[6 + m] * other[6 + m];
        }
    }
}

// Trajectory `trajectory` in 4 steps instead of 20: it has no memory.
static void compare_public(const pm_field *public, const int *node, bar *b, int trajectory) {
    difference sum = {0};
    pm_beam_reset(b->beam);
    for (int j = 5; j < public->ntime; j += 5) {
        const double *f = pm_field_force(public, trajectory, j);
        for (int i = 0; i < b->mesh.nnode; ++i) {
            memcpy(b->f + 3 * i, f + 3 * node[i], 3 * sizeof *f);
        }
        if (pm_beam_step(b->beam, 5 * public->dt, b->f, NULL) != PM_OK) {
            fail_msg("%s", pm_error());
        }
        add_differences(b, public, node, pm_field_state(public, trajectory, j), &sum);
    }
    const double u = sqrt(sum.displacement / sum.displacement_scale);
    const double s = sqrt(sum.stress / sum.stress_scale);
    printf("public trajectory %d: displacement %.2f %%, stress of free nodes %.2f %%\n", trajectory,
           100 * u, 100 * s);
    assert_true(u < 0.02);
    assert_true(s < 0.05);
}

static void follows_the_public_data(void **state) {
    (void)state;
    const int count[3] = {20, 5, 5};
    const double size[3] = {40, 10, 10};
    pm_field *public = NULL;
    bar b = {.beam = NULL};
    assert_int_equal(pm_field_load(&public, PUBLIC_DATA), PM_OK);
    assert_int_equal(pm_beam_mesh_make(&b.mesh, count, size, &b.arena), PM_OK);
    assert_int_equal(pm_beam_new(&b.beam, &b.mesh, &elastic, 0), PM_OK);
    assert_int_equal(public->nnode, b.mesh.nnode);
    b.f = pm_arena_array(&b.arena, (size_t)b.mesh.nnode, 3 * sizeof *b.f);
    int *node = pm_arena_array(&b.arena, (size_t)b.mesh.nnode, sizeof *node);
    for (int i = 0; i < b.mesh.nnode; ++i) {
        node[i] = match(public, b.mesh.position[i]);
    }
    for (int i = 0; i < public->ntrajectory; i += public->ntrajectory / 4 + 3) {
        compare_public(public, node, &b, i);
    }
    pm_field_free(public);
    free_bar(&b);
}

int main(void) {
    if (access(PUBLIC_DATA, R_OK) != 0) {
        printf("skipped: there is no " PUBLIC_DATA "\n");
        return SKIPPED;
    }
    const struct CMUnitTest tests[] = {cmocka_unit_test(follows_the_public_data)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
