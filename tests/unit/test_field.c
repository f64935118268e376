// Fields on a mesh: a saved field loads unchanged, a file may leave out the forces of the first
// time, and mistakes in a file are described.
#include <hdf5.h>
#include <math.h>

#include "bodies/field/field.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

enum { NTRAJECTORY = 2, NTIME = 3, NNODE = 4, NVARIABLE = 5 };

static pm_field *made(bool contact) {
    const pm_field_shape shape = {NTRAJECTORY, NTIME, NNODE, NVARIABLE, 1, contact};
    pm_field *d = NULL;
    assert_int_equal(pm_field_new(&d, shape, 0.5, "qx qy vx vy s"), PM_OK);
    for (int i = 0; i < NTRAJECTORY * NTIME * NNODE * NVARIABLE; ++i) {
        d->z[i] = 1.0 / (i + 1);
    }
    for (int i = 0; i < NTRAJECTORY * NTIME * NNODE * 3; ++i) {
        d->f[i] = i;
    }
    for (int i = 0; i < NNODE * 3; ++i) {
        d->position[i] = -i;
    }
    for (int i = 0; i < NTRAJECTORY * NTIME * NNODE * 3 && contact; ++i) {
        d->contact[i] = 2 * i;
    }
    return d;
}

// Saved with a note, and freed.
static const char *save(scratch *folder, pm_field *d, const char *name, const char *text) {
    const char *path = scratch_path(folder, "field.h5");
    const char *const notes[][2] = {{name, text}};
    assert_int_equal(pm_field_save(d, path, 1, notes), PM_OK);
    pm_field_free(d);
    return path;
}

static const char *saved_with(scratch *folder, bool contact) {
    return save(folder, made(contact), "title", "trial");
}

static const char *saved(scratch *folder) {
    return saved_with(folder, false);
}

static void a_placed_body_stays_in_its_place(void **state) {
    pm_field *d = made(false), *back = NULL;
    d->placed = true;
    d->placement = (pm_placement){{36, -26, 0.1}, {1, 0, 2}, {1, -1, 1}};
    assert_int_equal(pm_field_load(&back, save(*state, d, "title", "trial")), PM_OK);
    assert_true(back->placed && back->placement.origin[2] == 0.1);
    assert_true(back->placement.axis[0] == 1 && back->placement.axis[1] == 0);
    assert_true(back->placement.sign[1] == -1 && back->placement.sign[2] == 1);
    pm_field_free(back);
}

static void saved_comes_back(void **state) {
    pm_field *d = NULL;
    assert_int_equal(pm_field_load(&d, saved(*state)), PM_OK);
    assert_int_equal(d->ntrajectory, NTRAJECTORY);
    assert_string_equal(d->variable, "qx qy vx vy s");
    assert_true(d->dt == 0.5 && d->t[2] == 1);
    assert_true(pm_field_state(d, 1, 2)[NVARIABLE * 3 + 4] == 1.0 / 120);
    assert_true(pm_field_force(d, 1, 0)[1] == NTIME * NNODE * 3 + 1);
    assert_true(d->position[11] == -11);
    assert_null(d->contact);
    assert_false(d->placed);
    assert_true(d->placement.axis[2] == 2 && d->placement.sign[1] == 1);
    pm_field_free(d);
}

// Energies that nobody knows are not zero.
static void what_is_not_known_is_left_out(void **state) {
    pm_field *d = made(false);
    d->energy = d->clamped = NULL;
    const char *path = save(*state, d, "title", "trial");
    assert_int_equal(pm_field_load(&d, path), PM_OK);
    assert_null(d->energy);
    pm_field_free(d);
}

// The sum over the nodes is what a plot wants.
static void forces_of_contact_come_back(void **state) {
    const char *path = saved_with(*state, true);
    double total[NTRAJECTORY * NTIME * 3];
    pm_field *d = NULL;
    assert_int_equal(pm_field_load(&d, path), PM_OK);
    for (int i = 0; i < NTRAJECTORY * NTIME * NNODE * 3; ++i) {
        assert_true(d->contact[i] == 2 * i);
    }
    assert_ptr_equal(pm_field_contact(d, 1, 2), d->contact + 5 * NNODE * 3);
    pm_field_free(d);
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    const hid_t id = H5Dopen2(file, "/contact_force_total", H5P_DEFAULT);
    assert_true(H5Dread(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, total) >= 0);
    assert_true(total[3 * 5 + 1] == 2 * (4 * (5 * NNODE * 3 + 1) + 3 * (0 + 1 + 2 + 3)));
    H5Dclose(id);
    H5Fclose(file);
}

// Replaces /f by one of `ntime` times that counts from 1, written in single precision.
static void replace_forces(const char *path, hsize_t ntime) {
    const hsize_t size[4] = {NTRAJECTORY, ntime, NNODE, 3};
    double value[NTRAJECTORY * NTIME * NNODE * 3];
    for (int i = 0; i < NTRAJECTORY * NTIME * NNODE * 3; ++i) {
        value[i] = i + 1;
    }
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(H5Ldelete(file, "/f", H5P_DEFAULT) >= 0);
    const hid_t space = H5Screate_simple(4, size, NULL);
    const hid_t id =
        H5Dcreate2(file, "/f", H5T_IEEE_F32LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(H5Dwrite(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) >= 0);
    H5Dclose(id);
    H5Sclose(space);
    H5Fclose(file);
}

static void missing_first_forces_are_zero(void **state) {
    const char *path = saved(*state);
    pm_field *d = NULL;
    replace_forces(path, NTIME - 1);
    assert_int_equal(pm_field_load(&d, path), PM_OK);
    for (int i = 0; i < NTRAJECTORY; ++i) {
        for (int k = 0; k < NNODE * 3; ++k) {
            assert_true(pm_field_force(d, i, 0)[k] == 0);
            assert_true(pm_field_force(d, i, 2)[k] == (2 * i + 1) * NNODE * 3 + k + 1);
        }
    }
    pm_field_free(d);
}

static void assert_load_fails(const char *path, const char *words) {
    pm_field *d = NULL;
    assert_int_equal(pm_field_load(&d, path), PM_EDATA);
    assert_null(d);
    if (strstr(pm_error(), words) == NULL) {
        fail_msg("error \"%s\", expected \"%s\"", pm_error(), words);
    }
}

static void placements_come_back(void **state) {
    pm_field *d = NULL;
    const char *text = "origin: [36, -26, 11.5], axes: [+y, -x, +z]";
    assert_int_equal(pm_field_load(&d, save(*state, made(false), "placement", text)), PM_OK);
    assert_true(d->placed);
    double global[3], own[3];
    pm_placement_point(&d->placement, (const double[]){1, 2, 3}, global);
    assert_true(global[0] == 34 && global[1] == -25 && global[2] == 14.5);
    pm_placement_rotate(&d->placement, (const double[]){1, 2, 3}, global);
    assert_true(global[0] == -2 && global[1] == 1 && global[2] == 3);
    pm_placement_rotate_back(&d->placement, global, own);
    assert_true(own[0] == 1 && own[1] == 2 && own[2] == 3);
    pm_field_free(d);
    static const char *const bad[][2] = {
        {"origin: [36, -26], axes: [+y, -x, +z]", "origin: expected three numbers, found 2"},
        {"origin: [1, 2, 3]", "missing key \"axes\""},
        {"origin: [1, 2, 3], axes: [+y, -y, +z]", "axes: expected three axes such as"},
        {"origin: [1, 2, 3], axes: [+y, +z]", "axes: expected three axes such as"},
        {"origin: [1, 2, 3], axes: [+y, +x, +z]", "different and right-handed"},
        {"origin: [1, 2, 3], axes: [+z, +x, -y]", "different and right-handed"},
        {"origin: [1, 2, 3], axes: up", "axes: expected a list"},
        {"origin: [1, 2, 3], axes: [+y, -x, up]", "axes: expected one of +x, -x"},
        {"here", "placement:1:"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        assert_load_fails(save(*state, made(false), "placement", bad[i][0]), bad[i][1]);
    }
}

static void meshes_come_back(void **state) {
    pm_field *d = made(false);
    for (int i = 0; i < 8; ++i) {
        d->hexahedron[i] = 7 - i > 3 ? 0 : 7 - i;
    }
    d->energy[4] = 0.5;
    const char *path = save(*state, d, "title", "trial");
    assert_int_equal(pm_field_load(&d, path), PM_OK);
    assert_true(d->nelement == 1 && d->hexahedron[4] == 3 && d->energy[4] == 0.5);
    pm_field_free(d);
    d = made(false);
    d->hexahedron[2] = NNODE;
    assert_load_fails(save(*state, d, "title", "trial"),
                      "hexahedron 0 names node 4, expected 0 to 3");
}

static void columns_are_found(void **state) {
    (void)state;
    const pm_field d = {.variable = "qx qy vx vy s sx"};
    assert_int_equal(pm_field_columns(&d, "qx qy"), 0);
    assert_int_equal(pm_field_columns(&d, "vx vy s"), 2);
    assert_int_equal(pm_field_columns(&d, "sx"), 5);
    assert_int_equal(pm_field_columns(&d, "x"), -1);
    assert_int_equal(pm_field_columns(&d, "qx vx"), -1);
}

static void faults_are_told(void **state) {
    const char *path = saved(*state);
    const double nan_value = NAN;
    replace_forces(path, 1);
    assert_load_fails(path, "dataset /f: dimension 2 is 1, expected 3");
    pm_field *d = made(false);
    d->dt = 0;
    assert_load_fails(save(*state, d, "title", "trial"), "dt is 0, expected a number > 0");
    d = made(false);
    d->t[2] = 0.5;
    assert_load_fails(save(*state, d, "title", "trial"), "t[2] is 0.5, expected t[0] + 2 dt = 1");
    path = saved(*state);
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t id = H5Dopen2(file, "/z", H5P_DEFAULT);
    const hsize_t at[4] = {1, 0, 0, 0}, one[4] = {1, 1, 1, 1};
    const hid_t space = H5Dget_space(id), memory = H5Screate_simple(4, one, NULL);
    H5Sselect_hyperslab(space, H5S_SELECT_SET, at, NULL, one, NULL);
    assert_true(H5Dwrite(id, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, &nan_value) >= 0);
    H5Sclose(memory);
    H5Sclose(space);
    H5Dclose(id);
    H5Fclose(file);
    assert_load_fails(path, "value 60 of z is");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(saved_comes_back, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(a_placed_body_stays_in_its_place, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(what_is_not_known_is_left_out, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(forces_of_contact_come_back, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(missing_first_forces_are_zero, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(placements_come_back, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(meshes_come_back, scratch_setup, scratch_teardown),
        cmocka_unit_test(columns_are_found),
        cmocka_unit_test_setup_teardown(faults_are_told, scratch_setup, scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
