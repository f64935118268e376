// XDMF descriptions of field files: they are well-formed, and refer only to data within the extents
// of the field file.
#include <hdf5.h>

#include "bodies/command/fields.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

enum { NTRAJECTORY = 2, NTIME = 3, NNODE = 8, DEPTH = 16, LONGEST = 64 };

#define WHOLE "qx qy qz vx vy vz sxx syy szz sxy sxz syz"

// Saves a field of one brick under `name`; the text of its XDMF, which the caller frees.
static char *text_of(scratch *folder, const char *name, const char *variable, int nvariable,
                     bool contact) {
    char path[256];
    pm_field *d = NULL;
    const pm_field_shape shape = {NTRAJECTORY, NTIME, NNODE, nvariable, 1, contact};
    assert_int_equal(pm_field_new(&d, shape, 0.5, variable), PM_OK);
    for (int i = 0; i < 8; ++i) {
        d->hexahedron[i] = i;
    }
    snprintf(path, sizeof path, "%s.h5", scratch_path(folder, name));
    assert_int_equal(pm_field_save(d, path, 0, NULL), PM_OK);
    assert_int_equal(pm_xdmf_save(d, path), PM_OK);
    pm_field_free(d);
    snprintf(path, sizeof path, "%s.xdmf", scratch_path(folder, name));
    size_t size;
    char *text = scratch_read(path, &size);
    text[size] = '\0';
    return text;
}

static int count(const char *text, const char *word) {
    int n = 0;
    for (const char *at = text; (at = strstr(at, word)) != NULL; ++at) {
        ++n;
    }
    return n;
}

// --- form ---

// The tag at `at`: its end, and its name.
static const char *read_tag(const char *at, char name[LONGEST]) {
    const size_t length = strcspn(at + 1, " />\n");
    const char *end = strchr(at, '>');
    assert_true(end != NULL && length < LONGEST);
    assert_int_equal(memchr(at + 1, '<', (size_t)(end - at - 1)) != NULL, false);
    memcpy(name, at + 1, length);
    name[length] = '\0';
    return end;
}

// Every tag is closed by its own.
static void assert_well_formed(const char *text) {
    char open[DEPTH][LONGEST], name[LONGEST];
    int depth = 0;
    for (const char *at = strstr(text, "?>"); (at = strchr(at, '<')) != NULL;) {
        if (strncmp(at, "<!--", 4) == 0) {
            at = strstr(at, "-->");
            assert_non_null(at);
            continue;
        }
        if (at[1] == '/') {
            at = strchr(at, '>');
            assert_true(depth > 0 && at != NULL);
            const char *expected = open[--depth];
            assert_memory_equal(at - strlen(expected), expected, strlen(expected));
            continue;
        }
        at = read_tag(at, name);
        if (at[-1] != '/') {
            assert_true(depth < DEPTH);
            memcpy(open[depth++], name, sizeof name);
        }
    }
    assert_int_equal(depth, 0);
}

// --- content ---

// The dataset that `at`, the dimensions of its data item, belong to, has these.
static void assert_extents(hid_t file, const char *at, hsize_t extent[4]) {
    char name[LONGEST];
    const int rank = sscanf(at, "%llu %llu %llu %llu", (unsigned long long *)&extent[0],
                            (unsigned long long *)&extent[1], (unsigned long long *)&extent[2],
                            (unsigned long long *)&extent[3]);
    assert_int_equal(sscanf(strstr(at, ":/"), ":%63[^<]", name), 1);
    const hid_t id = H5Dopen2(file, name, H5P_DEFAULT), space = H5Dget_space(id);
    hsize_t found[4];
    assert_int_equal(H5Sget_simple_extent_ndims(space), rank);
    H5Sget_simple_extent_dims(space, found, NULL);
    assert_memory_equal(found, extent, (size_t)rank * sizeof *extent);
    H5Sclose(space);
    H5Dclose(id);
}

// All selections lie within their datasets, and are as large as they say.
static int check_slabs(const char *text, const char *path) {
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    int n = 0;
    for (const char *at = text; (at = strstr(at, "\"HyperSlab\" Dimensions=\"")) != NULL; ++n) {
        unsigned rows, cols, s[12];
        hsize_t extent[4];
        assert_int_equal(sscanf(at, "\"HyperSlab\" Dimensions=\"%u %u\"", &rows, &cols), 2);
        at = strstr(at, "\"XML\">") + strlen("\"XML\">");
        assert_int_equal(sscanf(at, "%u %u %u %u %u %u %u %u %u %u %u %u", &s[0], &s[1], &s[2],
                                &s[3], &s[4], &s[5], &s[6], &s[7], &s[8], &s[9], &s[10], &s[11]),
                         12);
        at = strstr(at, "Dimensions=\"") + strlen("Dimensions=\"");
        assert_extents(file, at, extent);
        assert_true(s[10] == rows && s[11] == cols && s[8] == 1 && s[9] == 1);
        for (int d = 0; d < 4; ++d) {
            assert_int_equal(s[4 + d], 1);
            assert_in_range(s[d] + s[8 + d], 1, extent[d]);
        }
    }
    H5Fclose(file);
    return n;
}

static void selections_lie_within_the_file(void **state) {
    char *text = text_of(*state, "whole", WHOLE, 12, true);
    assert_well_formed(text);
    assert_int_equal(count(text, "CollectionType=\"Temporal\""), NTRAJECTORY);
    assert_int_equal(count(text, "<Time Value="), NTRAJECTORY * NTIME);
    assert_int_equal(count(text, "<Time Value=\"0.5\"/>"), NTRAJECTORY);
    // Positions, displacement, velocity, stress twice by component, force, contact force.
    assert_int_equal(check_slabs(text, scratch_path(*state, "whole.h5")),
                     NTRAJECTORY * NTIME * (3 + 6 + 6 + 2));
    // The last of all: the contact force at the last time. Tensors are xx xy xz yy yz zz.
    assert_non_null(strstr(text, ">1 2 0 0 1 1 1 1 1 1 8 3</DataItem><DataItem Format=\"HDF\" "
                                 "NumberType=\"Float\" Precision=\"8\" Dimensions=\"2 3 8 3\">"
                                 "whole.h5:/contact_force</DataItem>"));
    const char *tensor = strstr(text, "Tensor6");
    static const char *const columns[] = {"0 6 ", "0 9 ", "0 10 ", "0 7 ", "0 11 ", "0 8 "};
    for (int i = 0; i < 6; ++i) {
        tensor = strstr(tensor, "\"XML\">0 0 ") + strlen("\"XML\">0 0 ");
        assert_memory_equal(tensor, columns[i], strlen(columns[i]));
    }
    free(text);
}

// Without positions the body is drawn undeformed.
static void what_is_missing_is_left_out(void **state) {
    char *text = text_of(*state, "a&b", "T vx vy vz", 4, false);
    assert_well_formed(text);
    assert_int_equal(check_slabs(text, scratch_path(*state, "a&b.h5")), NTRAJECTORY * NTIME * 2);
    assert_int_equal(count(text, "a&amp;b.h5:/node_position_reference"), NTRAJECTORY * NTIME);
    assert_null(strstr(text, "stress"));
    assert_non_null(strstr(text, ">0 0 0 1 1 1 1 1 1 1 8 3</DataItem>"));
    free(text);
    pm_field *d = NULL;
    const pm_field_shape shape = {1, 1, 1, 1, 0, false};
    assert_int_equal(pm_field_new(&d, shape, 1, "T"), PM_OK);
    assert_int_equal(pm_xdmf_save(d, scratch_path(*state, "none.h5")), PM_EDATA);
    d->nelement = 1;
    assert_int_equal(pm_xdmf_save(d, scratch_path(*state, "absent/none.h5")), PM_EFILE);
    pm_field_free(d);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(selections_lie_within_the_file),
        cmocka_unit_test(what_is_missing_is_left_out),
    };
    return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
