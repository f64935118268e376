// Fields of a body as the mesh and the nodal values of a solid
// (trainer/bodies/solid/solid_nodes.h), and back; meshes in files (store/solid_mesh.h).
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bodies/solid/solid_nodes.h"
#include "tests/support/unit.h"

#define NODES 12 // of two bricks along x
#define STATES 3
#define VARIABLES "qx qy qz vx vy vz sxx syy szz sxy sxz syz"

// Makes a field of two trajectories, whose nodes at x = 0 move by rounding errors alone.
static pm_field *make_field(void) {
    static const int corner[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                     {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
    const pm_field_shape shape = {
        .ntrajectory = 2, .ntime = STATES, .nnode = NODES, .nvariable = 12, .nelement = 2};
    pm_field *field = NULL;
    assert_int_equal(pm_field_new(&field, shape, 0.5, VARIABLES), PM_OK);
    for (int i = 0; i < NODES; ++i) {
        const int at[3] = {i % 3, i / 3 % 2, i / 6};
        for (int k = 0; k < 3; ++k) {
            field->position[3 * i + k] = at[k];
        }
    }
    for (int i = 0; i < 16; ++i) {
        const int *c = corner[i % 8];
        field->hexahedron[i] = i / 8 + c[0] + 3 * c[1] + 6 * c[2];
    }
    for (int i = 0; i < 2 * STATES; ++i) {
        double *z = pm_field_state(field, i / STATES, i % STATES);
        double *f = pm_field_force(field, i / STATES, i % STATES);
        for (int k = 0; k < NODES; ++k) {
            for (int c = 0; c < 3; ++c) {
                const double u = k % 3 == 0 ? 1e-20 : 0.01 * (i + 1) * (c + 1);
                z[12 * k + c] = field->position[3 * k + c] + u;
                f[3 * k + c] = 100 * i + 3 * k + c;
            }
            for (int c = 0; c < 6; ++c) {
                z[12 * k + 6 + c] = 1000 * i + 10 * k + c;
            }
        }
        field->energy[i * PM_FIELD_ENERGIES + 1] = 30 * i;
    }
    return field;
}

static void nodes_that_move_by_rounding_are_clamped(void **state) {
    (void)state;
    pm_field *field = make_field();
    pm_arena arena = {0};
    pm_solid_data data;
    // Rounding errors survive at clamped nodes whose positions are zero.
    assert_true(pm_field_state(field, 0, 0)[0] != 0);
    assert_int_equal(pm_solid_data_open(&data, field, &arena), PM_OK);
    for (int i = 0; i < NODES; ++i) {
        assert_int_equal(data.mesh.clamped[i], i % 3 == 0);
    }
    pm_arena_free(&arena);
    pm_field_free(field);
}

static void fields_become_nodal_values_and_fields_again(void **state) {
    (void)state;
    pm_field *field = make_field(), *back = NULL;
    pm_arena arena = {0};
    pm_solid_data data;
    pm_dataset *nodes = NULL;
    assert_int_equal(pm_solid_data_open(&data, field, &arena), PM_OK);
    data.trajectory[0] = 1;
    data.count = 1;
    assert_int_equal(pm_solid_nodes_dataset(&nodes, &data, STATES, 300), PM_OK);
    assert_int_equal(nodes->ncolumn, 12 * NODES + 1);
    const double *row = pm_dataset_state(nodes, 0, 2);
    assert_float_equal(row[3 * 1 + 2], 0.18, 1e-6); // u of node 1 along z
    assert_float_equal(row[3 * NODES + 6 * 5 + 4], 5054, 1e-3);
    assert_float_equal(row[9 * NODES + 3 * 5 + 1], 516, 1e-3);
    assert_float_equal(row[12 * NODES], 0.5, 1e-6); // 150 J at 300 K
    assert_true(pm_solid_nodes_fit(nodes, NULL, field));
    assert_int_equal(pm_solid_nodes_fields(&back, nodes, NULL, field, (const int[]){1}), PM_OK);
    const double *z = pm_field_state(back, 0, 2), *truth = pm_field_state(field, 1, 2);
    for (int i = 0; i < 12 * NODES; ++i) {
        const double expected = i % 12 >= 3 && i % 12 < 6 ? NAN : truth[i];
        assert_true(isnan(expected) || fabs(z[i] - expected) < 1e-6 * (1 + fabs(expected)));
    }
    assert_float_equal(z[12 * 1 + 3], 0.02, 1e-6); // 0.01 m within 0.5 s
    assert_memory_equal(pm_field_force(back, 0, 2), pm_field_force(field, 1, 2),
                        3 * NODES * sizeof(double));
    pm_field_free(back);
    pm_dataset_free(nodes);
    pm_arena_free(&arena);
    pm_field_free(field);
}

static void a_mesh_in_a_file_is_the_same(void **state) {
    (void)state;
    char path[] = "/tmp/test_solid_nodes_XXXXXX";
    pm_field *field = make_field();
    pm_arena arena = {0};
    pm_solid_data data;
    pm_solid_mesh loaded;
    const int file = mkstemp(path);
    assert_true(file >= 0);
    close(file);
    int contact[2] = {1, 4};
    assert_int_equal(pm_solid_data_open(&data, field, &arena), PM_OK);
    data.mesh.ncontact = 2;
    data.mesh.contact = contact;
    assert_int_equal(pm_solid_mesh_save(&data.mesh, path), PM_OK);
    assert_int_equal(pm_solid_mesh_load(&loaded, path, &arena), PM_OK);
    assert_int_equal(loaded.ncontact, 2);
    assert_int_equal(pm_solid_mesh_digest(&loaded, 1), pm_solid_mesh_digest(&data.mesh, 1));
    contact[1] = -1; // not a node
    assert_int_equal(pm_solid_mesh_save(&data.mesh, path), PM_OK);
    assert_int_equal(pm_solid_mesh_load(&loaded, path, &arena), PM_EDATA);
    contact[1] = 4;
    int *brick = (int *)data.mesh.brick;
    brick[3] = 99; // not a node
    assert_int_equal(pm_solid_mesh_save(&data.mesh, path), PM_OK);
    assert_int_equal(pm_solid_mesh_load(&loaded, path, &arena), PM_EDATA);
    remove(path);
    pm_arena_free(&arena);
    pm_field_free(field);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nodes_that_move_by_rounding_are_clamped),
        cmocka_unit_test(fields_become_nodal_values_and_fields_again),
        cmocka_unit_test(a_mesh_in_a_file_is_the_same),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
