// The check before the HDF5 library: files of this program pass, and damage that crashes the
// library does not.
#include <hdf5.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "store/dataset.h"
#include "store/hdf5_check.h"
#include "store/hdf5_io.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

static scratch folder;

static int setup(void **state) {
    (void)state;
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    scratch_open(&folder);
    return 0;
}

static int teardown(void **state) {
    (void)state;
    scratch_close(&folder);
    return 0;
}

// A small dataset as bytes; the caller frees.
static unsigned char *dataset_bytes(size_t *size) {
    static const char *const column[] = {"q", "p"};
    const char *path = scratch_path(&folder, "data.h5");
    pm_dataset *dataset = NULL;
    assert_int_equal(pm_dataset_new(&dataset, 2, 3, 2, 0.5, column), PM_OK);
    assert_int_equal(pm_dataset_note(dataset, "source", "a test"), PM_OK);
    assert_int_equal(pm_dataset_save(dataset, path), PM_OK);
    pm_dataset_free(dataset);
    return (unsigned char *)scratch_read(path, size);
}

static void assert_objects(const void *bytes, size_t size, const char *words) {
    const char *objection = pm_hdf5_check(bytes, size);
    if (objection == NULL || strstr(objection, words) == NULL) {
        fail_msg("\"%s\" instead of \"%s\"", objection == NULL ? "" : objection, words);
    }
}

// What passes, the library reads or refuses; it crashes on none.
static void test_every_byte_may_be_damaged(void **context) {
    (void)context;
    static const unsigned char turned[] = {0x01, 0x80, 0xff};
    const char *path = scratch_path(&folder, "changed.h5");
    size_t size;
    unsigned char *bytes = dataset_bytes(&size);
    int passed = 0, stopped = 0;
    assert_null(pm_hdf5_check(bytes, size));
    for (size_t i = 0; i < size; ++i) {
        const unsigned char mask = turned[i % 3];
        bytes[i] ^= mask;
        if (pm_hdf5_check(bytes, size) != NULL) {
            ++stopped;
        } else {
            pm_dataset *dataset = NULL;
            scratch_write(path, bytes, size);
            (void)pm_dataset_load(&dataset, path);
            pm_dataset_free(dataset);
            ++passed;
        }
        bytes[i] ^= mask;
    }
    assert_true(passed > 100 && stopped > 500);
    free(bytes);
}

static void test_every_truncation_is_seen(void **context) {
    (void)context;
    size_t size;
    unsigned char *bytes = dataset_bytes(&size);
    for (size_t length = 0; length < size; ++length) {
        // Exactly as long as the file, so that a look beyond its end is seen.
        unsigned char *cut = malloc(length + (length == 0));
        memcpy(cut, bytes, length);
        assert_non_null(pm_hdf5_check(cut, length));
        free(cut);
    }
    bytes = realloc(bytes, size + 10);
    assert_null(pm_hdf5_check(bytes, size + 10)); // more is harmless
    free(bytes);
}

// A member of the root group that is the root group: a walk in circles.
static void test_circles_end(void **context) {
    (void)context;
    size_t size;
    unsigned char *bytes = dataset_bytes(&size);
    unsigned char *symbols = memmem(bytes, size, "SNOD", 4);
    assert_non_null(symbols);
    memcpy(symbols + 8 + 8, bytes + 56 + 8, 8); // the first symbol's object
    assert_objects(bytes, size, "");
    memcpy(symbols + 8 + 8, symbols + 8 + 40 + 8, 8); // two names for one object
    assert_objects(bytes, size, "overlap");
    free(bytes);
}

static hid_t new_file(hid_t access) {
    return H5Fcreate(scratch_path(&folder, "foreign.h5"), H5F_ACC_TRUNC, H5P_DEFAULT, access);
}

static void assert_foreign(hid_t file, const char *words) {
    assert_true(file >= 0 && H5Fclose(file) >= 0);
    size_t size;
    char *bytes = scratch_read(scratch_path(&folder, "foreign.h5"), &size);
    assert_objects(bytes, size, words);
    free(bytes);
    assert_false(pm_hdf5_is_own(scratch_path(&folder, "foreign.h5")));
}

static void put_dataset(hid_t file, hid_t type, hid_t creation) {
    const hsize_t extent[2] = {8, 8};
    const int value[64] = {1};
    const hid_t space = H5Screate_simple(2, extent, NULL);
    const hid_t id = H5Dcreate2(file, "d", type, space, H5P_DEFAULT, creation, H5P_DEFAULT);
    H5Dwrite(id, H5T_NATIVE_INT, H5S_ALL, H5S_ALL, H5P_DEFAULT, value);
    H5Dclose(id);
    H5Sclose(space);
}

static void test_other_features_are_foreign(void **context) {
    (void)context;
    const hsize_t chunk[2] = {4, 4};
    const hid_t chunked = H5Pcreate(H5P_DATASET_CREATE), latest = H5Pcreate(H5P_FILE_ACCESS);
    H5Pset_chunk(chunked, 2, chunk);
    H5Pset_libver_bounds(latest, H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);
    assert_foreign(new_file(latest), "does not begin as files of portmet do");

    hid_t file = new_file(H5P_DEFAULT);
    put_dataset(file, H5T_STD_I32LE, chunked);
    assert_foreign(file, "not contiguous");

    file = new_file(H5P_DEFAULT);
    put_dataset(file, H5T_STD_I32BE, H5P_DEFAULT);
    assert_foreign(file, "plain numbers");

    file = new_file(H5P_DEFAULT);
    H5Lcreate_soft("/x", file, "soft", H5P_DEFAULT, H5P_DEFAULT);
    assert_foreign(file, "links");

    file = new_file(H5P_DEFAULT);
    const hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR);
    H5Tset_size(type, H5T_VARIABLE);
    H5Aclose(H5Acreate2(file, "text", type, space, H5P_DEFAULT, H5P_DEFAULT));
    H5Tclose(type);
    H5Sclose(space);
    assert_foreign(file, "an attribute is not of plain numbers or text");
    H5Pclose(chunked);
    H5Pclose(latest);
}

static void end_by(const void *signal_number) {
    const int number = *(const int *)signal_number;
    if (number != 0) {
        raise(number);
        _exit(3);
    }
}

static void reserve(const void *size) {
    if (mmap(NULL, *(const size_t *)size, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE,
             -1, 0) == MAP_FAILED) {
        abort();
    }
}

// Where the check does not pass a file, a child tries it, and only the end of the child tells.
static void test_children_tell_how_they_ended(void **context) {
    (void)context;
    const char *path = scratch_path(&folder, "missing.h5");
    const int none = 0, killed = SIGKILL, ignored = SIGCHLD;
    assert_int_equal(pm_hdf5_try(path, end_by, &none), PM_OK);
    assert_int_equal(pm_hdf5_try(path, end_by, &killed), PM_EFILE);
    assert_non_null(strstr(pm_error(), "the HDF5 library crashes on it (Killed)"));
    assert_int_equal(pm_hdf5_try(path, end_by, &ignored), PM_EFILE);
    assert_null(strstr(pm_error(), "("));
    const size_t most = (size_t)sysconf(_SC_PHYS_PAGES) * (size_t)sysconf(_SC_PAGESIZE);
    const size_t less = most / 8, more = 4 * most;
    assert_int_equal(pm_hdf5_try(path, reserve, &less), PM_OK);
#if PM_HDF5_TRY_LIMITS_MEMORY
    assert_int_equal(pm_hdf5_try(path, reserve, &more), PM_EFILE);
#else
    (void)more;
#endif
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_every_byte_may_be_damaged, setup, teardown),
        cmocka_unit_test_setup_teardown(test_every_truncation_is_seen, setup, teardown),
        cmocka_unit_test_setup_teardown(test_circles_end, setup, teardown),
        cmocka_unit_test_setup_teardown(test_other_features_are_foreign, setup, teardown),
        cmocka_unit_test_setup_teardown(test_children_tell_how_they_ended, setup, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
