// A scene names the parts that a recording keeps. Without such names, the parts for which one key
// of the scene stands share their series.
#include <hdf5.h>
#include <math.h>

#include "scene/recording.h"
#include "store/hdf5_io.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

#define SCENE                                                                         \
    "scene: three\ntime: {dt: 1, steps: 4, integrator: euler}\n"                      \
    "subsystems:\n  \"part[0:3]\": {weights: a.h5, state: {x: {unit: m, size: 1}}}\n" \
    "ports:\n  \"joint[0:2]\": {law: bracket, weights: j.h5,\n"                       \
    "    between: [\"part[i]\", \"part[i+1]\"],\n"                                    \
    "    expose: {\"part[i]\": x, \"part[i+1]\": x}}\n"

static const char some[] = SCENE "record: {parts: part2}\n";
static const char all[] = SCENE;

static bool has(hid_t file, const char *name) {
    return H5Lexists(file, name, H5P_DEFAULT) > 0;
}

static void only_chosen_parts_are_kept(void **state) {
    const char *path = scratch_path(*state, "some.h5");
    pm_scene *scene = NULL;
    pm_recording *recording = NULL;
    pm_sample *sample = NULL;
    double z[4] = {0};
    assert_int_equal(pm_scene_parse(&scene, some, "t.yaml"), PM_OK);
    assert_int_equal(pm_sample_new(&sample, scene), PM_OK);
    assert_int_equal(pm_recording_open(&recording, path, scene), PM_OK);
    for (int step = 0; step < 4; ++step) {
        sample->step = step;
        sample->z[2] = 10 + step;
        assert_int_equal(pm_recording_append(recording, sample), PM_OK);
    }
    assert_int_equal(pm_recording_close(recording), PM_OK);
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    assert_false(has(file, "/subsystems/part0") || has(file, "/subsystems/part1"));
    assert_false(has(file, "/ports/joint0"));
    assert_true(has(file, "/ports/joint1") && has(file, "/ledger/energy"));
    const hid_t id = H5Dopen2(file, "/subsystems/part2/z", H5P_DEFAULT);
    assert_true(id >= 0);
    assert_true(H5Dread(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, z) >= 0);
    assert_true(z[0] == 10 && z[3] == 13);
    H5Dclose(id);
    H5Fclose(file);
    pm_sample_free(sample);
    pm_scene_free(scene);
}

// Reads a dataset of these extents [3]; the last ones may be 0, if there are fewer.
static void read_series(hid_t file, const char *name, const hsize_t *extent, double *value) {
    hsize_t found[3] = {0};
    const hid_t id = H5Dopen2(file, name, H5P_DEFAULT);
    assert_true(id >= 0);
    const hid_t space = H5Dget_space(id);
    assert_int_equal(H5Sget_simple_extent_ndims(space), extent[2] > 0 ? 3 : 2);
    H5Sget_simple_extent_dims(space, found, NULL);
    assert_memory_equal(found, extent, sizeof found);
    assert_true(H5Dread(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) >= 0);
    H5Sclose(space);
    H5Dclose(id);
}

static void fill(pm_sample *sample, int step) {
    sample->step = step;
    for (int i = 0; i < 3; ++i) {
        sample->z[i] = 10 * step + i;
        sample->energy[i] = 100 * step + i;
    }
    sample->flux[1][0].entropy = step;
    sample->flux[1][1].entropy = -step;
}

static void parts_of_a_range_share_their_series(void **state) {
    const char *path = scratch_path(*state, "all.h5");
    pm_scene *scene = NULL;
    pm_recording *recording = NULL;
    pm_sample *sample = NULL;
    double z[4 * 3], energy[4 * 3], a[4 * 2], b[4 * 2], row[3];
    assert_int_equal(pm_scene_parse(&scene, all, "t.yaml"), PM_OK);
    assert_int_equal(pm_sample_new(&sample, scene), PM_OK);
    assert_int_equal(pm_recording_open(&recording, path, scene), PM_OK);
    for (int step = 0; step < 4; ++step) {
        if (step == 2) { // a run that goes on with its recording
            fill(sample, 77);
            assert_int_equal(pm_recording_append(recording, sample), PM_OK);
            assert_int_equal(pm_recording_close(recording), PM_OK);
            assert_int_equal(pm_recording_reopen(&recording, path, scene, 2), PM_OK);
        }
        fill(sample, step);
        assert_int_equal(pm_recording_append(recording, sample), PM_OK);
    }
    assert_int_equal(pm_recording_close(recording), PM_OK);
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    assert_false(has(file, "/subsystems/part0") || has(file, "/ports/joint0"));
    read_series(file, "/subsystems/part[0:3]/z", (hsize_t[]){4, 3, 1}, z);
    read_series(file, "/subsystems/part[0:3]/E", (hsize_t[]){4, 3, 0}, energy);
    read_series(file, "/ports/joint[0:2]/entropy_flux_a", (hsize_t[]){4, 2, 0}, a);
    read_series(file, "/ports/joint[0:2]/entropy_flux_b", (hsize_t[]){4, 2, 0}, b);
    H5Fclose(file);
    for (int step = 0; step < 4; ++step) {
        for (int i = 0; i < 3; ++i) {
            assert_true(z[3 * step + i] == 10 * step + i);
            assert_true(energy[3 * step + i] == 100 * step + i);
        }
        // Before the first step nothing has flowed.
        assert_true(step == 0
                        ? isnan(a[0]) && isnan(a[1]) && isnan(b[1])
                        : a[2 * step] == 0 && a[2 * step + 1] == step && b[2 * step + 1] == -step);
    }
    pm_hdf5 *reader = NULL;
    assert_int_equal(pm_hdf5_open(&reader, path, PM_HDF5_ANY, PM_EFILE), PM_OK);
    assert_int_equal(pm_hdf5_read_row(reader, "/subsystems/part[0:3]/E", 3, 3, row), PM_OK);
    assert_true(row[0] == 300 && row[2] == 302);
    assert_int_equal(pm_hdf5_read_row(reader, "/subsystems/part[0:3]/E", 4, 3, row), PM_EFILE);
    assert_int_equal(pm_hdf5_read_row(reader, "/subsystems/part[0:3]/E", 3, 2, row), PM_EFILE);
    pm_hdf5_close(reader);
    pm_sample_free(sample);
    pm_scene_free(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(only_chosen_parts_are_kept, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(parts_of_a_range_share_their_series, scratch_setup,
                                        scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
