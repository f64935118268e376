// A scene names the parts that a recording keeps.
#include <hdf5.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "scene/recording.h"
#include "tests/support/scratch.h"

static const char text[] =
    "scene: three\ntime: {dt: 1, steps: 4, integrator: euler}\n"
    "subsystems:\n  \"part[0:3]\": {weights: a.h5, state: {x: {unit: m, size: 1}}}\n"
    "ports:\n  \"joint[0:2]\": {law: bracket, between: [\"part[i]\", \"part[i+1]\"], weights: "
    "j.h5,\n"
    "    expose: {\"part[i]\": x, \"part[i+1]\": x}}\n"
    "record: {parts: part2}\n";

static bool has(hid_t file, const char *name) {
    return H5Lexists(file, name, H5P_DEFAULT) > 0;
}

static void only_chosen_parts_are_kept(void **state) {
    const char *path = scratch_path(*state, "some.h5");
    pm_scene *scene = NULL;
    pm_recording *recording = NULL;
    pm_sample *sample = NULL;
    double z[4] = {0};
    assert_int_equal(pm_scene_parse(&scene, text, "t.yaml"), PM_OK);
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(only_chosen_parts_are_kept, scratch_setup,
                                        scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
