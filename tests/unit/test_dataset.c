// Datasets: a saved dataset loads unchanged, and every mistake in a file is described in one line.
#include <hdf5.h>
#include <math.h>
#include <stdlib.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "store/dataset.h"
#include "store/hdf5_io.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

static const char *const columns[] = {"q", "p", "s"};

// A dataset of 2 trajectories, 4 times, 3 columns with distinct values.
static pm_dataset *sample_dataset(void) {
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 2, 4, 3, 0.25, columns), PM_OK);
    for (int i = 0; i < 2 * 4 * 3; ++i) {
        d->z[i] = 1.0 / (i + 1);
    }
    assert_int_equal(pm_dataset_note(d, "title", "trial %d", 1), PM_OK);
    assert_int_equal(pm_dataset_note(d, "units", "m;kg m/s;J/K"), PM_OK);
    assert_int_equal(pm_dataset_note(d, "title", "trial %d", 2), PM_OK);
    return d;
}

static const char *saved(scratch *folder) {
    const char *path = scratch_path(folder, "data.h5");
    pm_dataset *d = sample_dataset();
    assert_int_equal(pm_dataset_save(d, path), PM_OK);
    pm_dataset_free(d);
    return path;
}

static void assert_load_fails(const char *path, pm_status code, const char *words) {
    pm_dataset *d = NULL;
    const pm_status status = pm_dataset_load(&d, path);
    if (status != code || strstr(pm_error(), words) == NULL || strstr(pm_error(), path) == NULL) {
        fail_msg("status %d, expected %d; error \"%s\", expected path and \"%s\"", status, code,
                 pm_error(), words);
    }
    assert_null(d);
    assert_null(strchr(pm_error(), '\n'));
}

static void the_first_states_of_each_trajectory_remain(void **state) {
    (void)state;
    pm_dataset *d = sample_dataset(), *whole = sample_dataset();
    assert_int_equal(pm_dataset_with_rates(d), PM_OK);
    for (int i = 0; i < 2 * 4 * 3; ++i) {
        d->zdot[i] = -d->z[i];
    }
    pm_dataset_shorten(d, 3);
    assert_int_equal(d->ntime, 3);
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 3; ++j) {
            for (int k = 0; k < 3; ++k) {
                const double expected = pm_dataset_state(whole, i, j)[k];
                assert_true(pm_dataset_state(d, i, j)[k] == expected);
                assert_true(pm_dataset_rate(d, i, j)[k] == -expected);
            }
        }
    }
    pm_dataset_free(d);
    pm_dataset_free(whole);
}

static void pieces_have_their_samples_times_and_notes(void **state) {
    (void)state;
    static const pm_piece piece[] = {{1, 0, 3}, {0, 2, 4}};
    pm_dataset *whole = sample_dataset(), *d = NULL;
    assert_int_equal(pm_dataset_note(whole, "title", "whole"), PM_OK);
    assert_int_equal(pm_dataset_cut(&d, whole, 2, piece), PM_OK);
    assert_int_equal(d->ntrajectory, 2);
    assert_int_equal(d->ntime, 3);
    assert_string_equal(pm_dataset_find_note(d, "title"), "whole");
    for (int i = 0; i < 2; ++i) {
        const int length = piece[i].end - piece[i].first;
        assert_int_equal(pm_dataset_length(d, i), length);
        for (int j = 0; j < length; ++j) {
            const int from = piece[i].trajectory, at = piece[i].first + j;
            assert_true(pm_dataset_time(d, i, j) == pm_dataset_time(whole, from, at));
            assert_memory_equal(pm_dataset_state(d, i, j), pm_dataset_state(whole, from, at),
                                3 * sizeof(double));
        }
    }
    pm_dataset_free(d);
    pm_dataset_free(whole);
}

static void save_and_load_return_the_same(void **state) {
    const char *path = saved(*state);
    pm_dataset *d = NULL, *expected = sample_dataset();
    assert_int_equal(pm_dataset_load(&d, path), PM_OK);
    assert_int_equal(d->ntrajectory, 2);
    assert_int_equal(d->ntime, 4);
    assert_int_equal(d->ncolumn, 3);
    assert_true(d->dt == 0.25);
    assert_memory_equal(d->t, expected->t, 4 * sizeof *d->t);
    assert_memory_equal(d->z, expected->z, 2 * 4 * 3 * sizeof *d->z);
    assert_true(pm_dataset_state(d, 1, 2)[1] == 1.0 / 20);
    for (int i = 0; i < 3; ++i) {
        assert_string_equal(d->column[i], columns[i]);
    }
    assert_int_equal(d->nnote, 2);
    assert_string_equal(d->note[0].name, "title");
    assert_string_equal(d->note[0].text, "trial 2");
    assert_string_equal(d->note[1].text, "m;kg m/s;J/K");
    assert_int_equal(scratch_files(*state, 0), 1);
    pm_dataset_free(expected);
    pm_dataset_free(d);
}

static void rates_come_back(void **state) {
    const char *path = scratch_path(*state, "rates.h5");
    pm_dataset *d = NULL, *made = sample_dataset();
    assert_int_equal(pm_dataset_with_rates(made), PM_OK);
    pm_dataset_rate(made, 1, 2)[1] = 5;
    assert_int_equal(pm_dataset_save(made, path), PM_OK);
    assert_int_equal(pm_dataset_load(&d, path), PM_OK);
    assert_true(pm_dataset_rate(d, 1, 2)[1] == 5 && pm_dataset_rate(d, 0, 0)[0] == 0);
    pm_dataset_rate(made, 1, 2)[1] = NAN;
    assert_int_equal(pm_dataset_save(made, path), PM_EDATA);
    assert_non_null(strstr(pm_error(), "zdot of trajectory 1, time 2"));
    pm_dataset_free(made);
    pm_dataset_free(d);
}

static void files_that_are_not_datasets_are_refused(void **state) {
    scratch *folder = *state;
    assert_load_fails(scratch_path(folder, "none.h5"), PM_EFILE, "No such file");
    assert_load_fails(folder->folder, PM_EFILE, "directory");
    const char *path = scratch_path(folder, "text.h5");
    scratch_write(path, "q p s\n1 2 3\n", 12);
    assert_load_fails(path, PM_EFILE, "not an HDF5 file");
    scratch_write(path, "", 0);
    assert_load_fails(path, PM_EFILE, "not an HDF5 file");
    path = scratch_path(folder, "pipe.h5");
    assert_int_equal(mkfifo(path, 0600), 0);
    assert_load_fails(path, PM_EFILE, "not a regular file");
}

static void every_truncation_is_noticed(void **state) {
    const char *path = saved(*state);
    const char *cut = scratch_path(*state, "cut.h5");
    size_t size;
    char *bytes = scratch_read(path, &size);
    for (size_t length = 0; length < size; length += 1 + size / 61) {
        scratch_write(cut, bytes, length);
        assert_load_fails(cut, PM_EFILE, length < 8 ? "not an HDF5" : "cannot open it as HDF5");
    }
    free(bytes);
}

// Replaces dataset `name` by one of `type` and `rank` extents, without values.
static void replace(const char *path, const char *name, hid_t type, int rank, const hsize_t *size) {
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    H5Ldelete(file, name, H5P_DEFAULT);
    if (rank >= 0) {
        const hid_t space = H5Screate_simple(rank, size, NULL);
        const hid_t list = H5Pcreate(H5P_DATASET_CREATE);
        if (rank > 0 && size[0] > 1000) {
            // Huge extents without storage.
            H5Pset_chunk(list, rank, (hsize_t[]){1, 1, 1});
        }
        H5Dclose(H5Dcreate2(file, name, type, space, H5P_DEFAULT, list, H5P_DEFAULT));
        H5Pclose(list);
        H5Sclose(space);
    }
    H5Fclose(file);
}

#if PM_HDF5_TRY_LIMITS_MEMORY
// A file of a few kilobytes that holds more numbers than the process can have memory. The child's
// exit status says what went wrong.
static void load_with_little_memory(const char *path) {
    const struct rlimit limit = {.rlim_cur = 500000000, .rlim_max = 500000000};
    pm_dataset *dataset = NULL;
    if (setrlimit(RLIMIT_AS, &limit) != 0) {
        _exit(2);
    }
    const bool refused = pm_dataset_load(&dataset, path) == PM_ENOMEM;
    _exit(refused && strstr(pm_error(), "dataset /z takes 800 MB of memory, and 500 MB") != NULL
              ? 0
              : 1);
}

static void more_numbers_than_memory_are_refused(void **state) {
    const char *path = saved(*state);
    replace(path, "/z", H5T_NATIVE_DOUBLE, 3, (hsize_t[]){10000, 10000, 1});
    size_t size;
    free(scratch_read(path, &size));
    assert_true(size < 20000);
    const pid_t child = fork();
    if (child == 0) {
        load_with_little_memory(path);
    }
    int ending;
    assert_int_equal(waitpid(child, &ending, 0), child);
    assert_int_equal(ending, 0);
}
#endif

static void wrong_shapes_and_types_are_refused(void **state) {
    const char *path = saved(*state);
    replace(path, "z", H5T_IEEE_F64LE, 2, (hsize_t[]){4, 3});
    assert_load_fails(path, PM_EDATA, "/z: expected 3 dimensions");
    replace(path, "z", H5T_IEEE_F64LE, 3, (hsize_t[]){2, 0, 3});
    assert_load_fails(path, PM_EDATA, "/z: expected 3 dimensions");
    replace(path, "z", H5T_IEEE_F64LE, 3, (hsize_t[]){1 << 30, 1 << 30, 1 << 30});
    assert_load_fails(path, PM_EDATA, "/z: expected 3 dimensions");
    replace(path, "z", H5T_C_S1, 3, (hsize_t[]){2, 4, 3});
    assert_load_fails(path, PM_EDATA, "/z: expected float64");
    replace(path, "z", H5T_IEEE_F64LE, 3, (hsize_t[]){2, 4, 2});
    assert_load_fails(path, PM_EDATA, "names 3 columns, z has 2");
    replace(path, "z", H5T_IEEE_F32BE, 3, (hsize_t[]){2, 4, 3});
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_load(&d, path), PM_OK);
    pm_dataset_free(d);
    replace(path, "t", H5T_IEEE_F64LE, 1, (hsize_t[]){5});
    assert_load_fails(path, PM_EDATA, "/t: dimension 1 is 5, expected 4");
    replace(path, "t", H5T_IEEE_F64LE, 1, (hsize_t[]){4});
    assert_load_fails(path, PM_EDATA, "t[1] is 0, expected t[0] + 1 dt = 0.25");
    replace(path, "dt", H5T_IEEE_F64LE, 0, NULL);
    assert_load_fails(path, PM_EDATA, "dt is 0, expected a number > 0");
    replace(path, "dt", 0, -1, NULL);
    assert_load_fails(path, PM_EDATA, "/dt is missing");
}

static void the_layout_attribute_is_required_and_must_be_text(void **state) {
    const char *path = saved(*state);
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    H5Adelete(file, "state_layout");
    H5Fflush(file, H5F_SCOPE_LOCAL);
    const hid_t space = H5Screate(H5S_SCALAR);
    H5Fclose(file);
    assert_load_fails(path, PM_EDATA, "attribute state_layout of / is missing");

    const hid_t again = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    H5Aclose(H5Acreate2(again, "state_layout", H5T_STD_I32LE, space, H5P_DEFAULT, H5P_DEFAULT));
    H5Fclose(again);
    assert_load_fails(path, PM_EDATA, "attribute state_layout of /: expected text");

    // Text of fixed length, not terminated, is as good as text of variable length.
    const hid_t last = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    H5Adelete(last, "state_layout");
    const hid_t type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, 5);
    H5Tset_strpad(type, H5T_STR_NULLPAD);
    const hid_t id = H5Acreate2(last, "state_layout", type, space, H5P_DEFAULT, H5P_DEFAULT);
    H5Awrite(id, type, "x y z");
    H5Aclose(id);
    H5Tclose(type);
    H5Sclose(space);
    H5Fclose(last);
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_load(&d, path), PM_OK);
    assert_string_equal(d->column[2], "z");
    pm_dataset_free(d);
}

static void links_into_other_files_are_not_followed(void **state) {
    const char *path = saved(*state);
    const char *other = scratch_path(*state, "other.h5");
    pm_dataset *d = sample_dataset();
    assert_int_equal(pm_dataset_save(d, other), PM_OK);
    pm_dataset_free(d);
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    H5Ldelete(file, "z", H5P_DEFAULT);
    H5Lcreate_external(other, "/z", file, "z", H5P_DEFAULT, H5P_DEFAULT);
    H5Fclose(file);
    assert_load_fails(path, PM_EDATA, "/z is missing");
}

static void write_value(const char *path, size_t index, double value) {
    double z[2 * 4 * 3];
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t id = H5Dopen2(file, "z", H5P_DEFAULT);
    H5Dread(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, z);
    z[index] = value;
    H5Dwrite(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, z);
    H5Dclose(id);
    H5Fclose(file);
}

static void values_that_are_not_finite_are_named(void **state) {
    const char *path = saved(*state);
    write_value(path, (1 * 4 + 2) * 3 + 1, NAN);
    assert_load_fails(path, PM_EDATA, "trajectory 1, time 2, column \"p\" is nan");
    write_value(path, (1 * 4 + 2) * 3 + 1, 0);
    write_value(path, 23, -INFINITY);
    assert_load_fails(path, PM_EDATA, "trajectory 1, time 3, column \"s\" is -inf");
}

static void what_cannot_be_loaded_is_not_saved(void **state) {
    const char *path = saved(*state);
    pm_dataset *d = sample_dataset();
    d->z[7] = NAN;
    assert_int_equal(pm_dataset_save(d, path), PM_EDATA);
    d->z[7] = 0;
    assert_int_equal(pm_dataset_save(d, "/nonexistent/folder/data.h5"), PM_EFILE);
    assert_non_null(strstr(pm_error(), "/nonexistent/folder/data.h5"));
    pm_dataset_free(d);

    // The file saved before is whole, and nothing lies beside it.
    assert_int_equal(pm_dataset_load(&d, path), PM_OK);
    assert_true(d->z[7] == 1.0 / 8);
    pm_dataset_free(d);
    assert_int_equal(scratch_files(*state, 0), 1);
}

static void a_failed_rename_leaves_nothing_behind(void **state) {
    scratch *folder = *state;
    const char *path = scratch_path(folder, "taken.h5");
    assert_int_equal(mkdir(path, 0700), 0);
    pm_dataset *d = sample_dataset();
    assert_int_equal(pm_dataset_save(d, path), PM_EFILE);
    assert_non_null(strstr(pm_error(), "taken.h5: this is not a regular file"));
    assert_int_equal(scratch_files(folder, 0), 1);
    assert_int_equal(rmdir(path), 0);
    pm_dataset_free(d);
}

static void repeated_columns_are_refused(void **state) {
    static const char *const twice[] = {"q", "p", "q"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 1, 1, 3, 1.0, twice), PM_OK);
    assert_int_equal(pm_dataset_save(d, scratch_path(*state, "twice.h5")), PM_EDATA);
    assert_non_null(strstr(pm_error(), "\"q\" twice"));
    pm_dataset_free(d);
}

// More than one attribute holds, unless ranges are folded.
static void many_columns_come_back(void **state) {
    enum { COUNT = 15000 };
    const char *path = scratch_path(*state, "many.h5");
    pm_dataset *d = NULL;
    pm_arena arena = {0};
    static const char *name[COUNT];
    for (int i = 0; i < COUNT; ++i) {
        name[i] = i == 7 ? "alone" : pm_arena_printf(&arena, "upper_lower_slope_%d", i);
    }
    assert_int_equal(pm_dataset_new(&d, 1, 2, COUNT, 1.0, name), PM_OK);
    assert_int_equal(pm_dataset_save(d, path), PM_OK);
    pm_dataset_free(d);
    assert_int_equal(pm_dataset_load(&d, path), PM_OK);
    for (int i = 0; i < COUNT; ++i) {
        assert_string_equal(d->column[i], name[i]);
    }
    pm_dataset_free(d);
    pm_arena_free(&arena);
}

static void set_layout(const char *path, const char *layout) {
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    const hid_t space = H5Screate(H5S_SCALAR), type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, strlen(layout) + 1);
    H5Adelete(file, "state_layout");
    const hid_t id = H5Acreate2(file, "state_layout", type, space, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(H5Awrite(id, type, layout) >= 0);
    H5Aclose(id);
    H5Tclose(type);
    H5Sclose(space);
    H5Fclose(file);
}

static void a_layout_may_hold_ranges(void **state) {
    const char *path = saved(*state);
    pm_dataset *d = NULL;
    set_layout(path, "s q[4:6]");
    assert_int_equal(pm_dataset_load(&d, path), PM_OK);
    assert_string_equal(d->column[0], "s");
    assert_string_equal(d->column[2], "q5");
    pm_dataset_free(d);
    set_layout(path, "s q[0:1000000000]");
    assert_load_fails(path, PM_EDATA, "state_layout names 1000000001 columns, z has 3");
    set_layout(path, "s q[5:5]");
    assert_load_fails(path, PM_EDATA, "state_layout: expected a range PREFIX[A:B]");
}

int main(void) {
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_first_states_of_each_trajectory_remain),
        cmocka_unit_test(pieces_have_their_samples_times_and_notes),
        cmocka_unit_test_setup_teardown(save_and_load_return_the_same, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(rates_come_back, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(files_that_are_not_datasets_are_refused, scratch_setup,
                                        scratch_teardown),
#if PM_HDF5_TRY_LIMITS_MEMORY
        cmocka_unit_test_setup_teardown(more_numbers_than_memory_are_refused, scratch_setup,
                                        scratch_teardown),
#endif
        cmocka_unit_test_setup_teardown(every_truncation_is_noticed, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(wrong_shapes_and_types_are_refused, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(the_layout_attribute_is_required_and_must_be_text,
                                        scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(links_into_other_files_are_not_followed, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(values_that_are_not_finite_are_named, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(what_cannot_be_loaded_is_not_saved, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(a_failed_rename_leaves_nothing_behind, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test_setup_teardown(many_columns_come_back, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(a_layout_may_hold_ranges, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(repeated_columns_are_refused, scratch_setup,
                                        scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
