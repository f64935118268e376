// Weights files: a model that was saved loads with the same bits, and a file whose content was
// changed, cut or exchanged is refused.
#include <hdf5.h>
#include <math.h>

#include "model/training_range.h"
#include "scene/weights.h"
#include "tests/support/model_text.h"
#include "tests/support/scratch.h"

static const char part_text[] =
    "energy:\n"
    "  - {features: ['|p|^2'], skip: linear}\n"
    "  - {features: ['ln|q|', s], hidden: [5, 4], activation: tanh, skip: quadratic}\n"
    "entropy: {given: s}\n"
    "reversible: {given: [[q, p, 1.0]]}\n";

static const char port_text[] = "law: bracket\n"
                                "irreversible:\n"
                                "  learned: {acts_on: [a.s, b.s], features: [a.s, b.s], "
                                "hidden: [3], activation: softplus}\n";

static const pm_layout layout = {.ngroup = 3,
                                 .nz = 5,
                                 .group = (pm_group[]){{"q", "m", 2, 0, PM_ROLE_OTHER, false},
                                                       {"p", "kg m/s", 2, 2, PM_ROLE_OTHER, false},
                                                       {"s", "J/K", 1, 4, PM_ROLE_ENTROPY, false}}};
static const pm_layout exposed = {
    .ngroup = 1, .nz = 1, .group = (pm_group[]){{"s", "J/K", 1, 0, PM_ROLE_ENTROPY, false}}};

static const pm_provenance provenance = {.command = "portmet-train fit train.yaml",
                                         .data = "data.h5 0123456789abcdef",
                                         .integrator = "rk4",
                                         .step = 0.0375,
                                         .verdict = "fair: rollouts have 7 % of that error",
                                         .system = "two bodies",
                                         .seed = UINT64_MAX - 1,
                                         .loss = 1.25e-7,
                                         .seconds = 12.5};

static scratch folder;
static pm_arena arena;
static pm_part part;
static pm_port_model port;

static int setup(void **state) {
    (void)state;
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_rng rng;
    scratch_open(&folder);
    pm_rng_init(&rng, 5, 0);
    part = (pm_part){.layout = layout};
    port = (pm_port_model){.layout = {exposed, exposed}};
    if (pm_yaml_parse(&document, part_text, "part", &root) != PM_OK ||
        pm_part_spec_read(root, (pm_yaml){0}, &arena, &part.spec) != PM_OK ||
        pm_part_declare(&part) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    pm_yaml_close(document);
    if (pm_yaml_parse(&document, port_text, "port", &root) != PM_OK ||
        pm_port_spec_read(root, (pm_yaml){0}, &arena, &port.spec) != PM_OK ||
        pm_port_declare(&port) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    pm_yaml_close(document);
    pm_params_randomise(&part.params, &rng);
    pm_params_randomise(&port.params, &rng);
    return 0;
}

static int teardown(void **state) {
    (void)state;
    pm_part_free(&part);
    pm_port_free(&port);
    pm_arena_free(&arena);
    scratch_close(&folder);
    return 0;
}

static const char *saved(void) {
    const char *path = scratch_path(&folder, "weights.h5");
    (void)remove(path); // what a test has changed may be of another kind
    if (pm_weights_save(path, pm_component_of_part(&part), &provenance) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return path;
}

static void assert_load_fails(const char *path, const char *words) {
    pm_part loaded = {.layout = {.nz = -7}};
    pm_provenance p = {.seed = 3};
    const pm_status status = pm_weights_load(path, &arena, pm_component_of_part(&loaded), &p);
    if (status != PM_EWEIGHTS || strstr(pm_error(), words) == NULL ||
        strstr(pm_error(), path) == NULL || strchr(pm_error(), '\n') != NULL) {
        fail_msg("status %d, expected %d; error \"%s\", expected path and \"%s\"", status,
                 PM_EWEIGHTS, pm_error(), words);
    }
    assert_int_equal(loaded.layout.nz, -7);
    assert_int_equal(p.seed, 3);
    assert_null(loaded.params.entry);
}

static void a_subsystem_comes_back_bit_by_bit(void **state) {
    (void)state;
    const char *path = saved();
    pm_part loaded = {0};
    pm_provenance p;
    if (pm_weights_load(path, &arena, pm_component_of_part(&loaded), &p) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_true(part.params.count > 4);
    assert_true(pm_layout_equal(&loaded.layout, &layout));
    assert_int_equal(loaded.layout.nz, 5);
    assert_int_equal(loaded.layout.group[2].first, 4);
    assert_int_equal(loaded.spec.energy.nterm, 2);
    assert_same_params(&loaded.params, &part.params);
    assert_string_equal(p.path, path);
    assert_string_equal(p.command, provenance.command);
    assert_string_equal(p.data, provenance.data);
    assert_string_equal(p.integrator, provenance.integrator);
    assert_string_equal(p.verdict, provenance.verdict);
    assert_string_equal(p.system, provenance.system);
    assert_true(p.step == provenance.step);
    assert_true(p.seed == provenance.seed);
    assert_true(p.loss == provenance.loss && p.seconds == provenance.seconds);
    assert_true(p.digest != 0);
    assert_int_equal(scratch_files(&folder, 0), 1);
    pm_part_free(&loaded);
}

static void a_training_range_comes_back(void **state) {
    (void)state;
    static const double states[][5] = {{3, 4, 0, 1, -2}, {0, 1, 6, 8, 0.5}};
    static const double outside[] = {0, 20, 1, 0, 0};
    pm_part loaded = {0};
    pm_provenance found;
    const char *path = scratch_path(&folder, "range.h5");
    assert_int_equal(pm_training_range_declare(&part), PM_OK);
    pm_training_range_widen(&part, states[0]);
    pm_training_range_widen(&part, states[1]);
    assert_int_equal(pm_weights_save(path, pm_component_of_part(&part), &provenance), PM_OK);
    assert_int_equal(pm_weights_load(path, &arena, pm_component_of_part(&loaded), &found), PM_OK);
    assert_null(pm_training_range_departure(pm_training_range_of(&loaded), states[0]).group);
    const pm_departure d = pm_training_range_departure(pm_training_range_of(&loaded), outside);
    assert_string_equal(d.group->name, "q");
    assert_true(d.value == 20 && d.low == 1 && d.high == 5 && d.widths == 15. / 4);
    pm_part_free(&loaded);
}

static void a_port_comes_back_bit_by_bit(void **state) {
    (void)state;
    const char *path = scratch_path(&folder, "port.h5");
    pm_port_model loaded = {0};
    pm_provenance p;
    assert_int_equal(pm_weights_save(path, pm_component_of_port(&port), &provenance), PM_OK);
    if (pm_weights_load(path, &arena, pm_component_of_port(&loaded), &p) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_true(pm_layout_equal(&loaded.layout[0], &exposed));
    assert_true(pm_layout_equal(&loaded.layout[1], &exposed));
    assert_ptr_equal(loaded.law, port.law);
    assert_true(port.params.count > 2);
    assert_same_params(&loaded.params, &port.params);
    pm_port_free(&loaded);
    assert_load_fails(path, "weights of a \"port\", expected those of a subsystem");
}

static uint64_t saved_digest(void) {
    pm_part loaded = {0};
    pm_provenance p;
    assert_int_equal(pm_weights_load(saved(), &arena, pm_component_of_part(&loaded), &p), PM_OK);
    pm_part_free(&loaded);
    return p.digest;
}

static void the_digest_depends_on_content_only(void **state) {
    (void)state;
    const uint64_t digest = saved_digest();
    assert_true(saved_digest() == digest);
    part.params.entry[1].value[0] = nextafter(part.params.entry[1].value[0], INFINITY);
    const uint64_t nudged = saved_digest();
    assert_true(nudged != digest);
    pm_group group[3];
    memcpy(group, part.layout.group, sizeof group);
    group[1].unit = "N s";
    part.layout.group = group;
    assert_true(saved_digest() != nudged);
    part.layout = layout;
}

static void files_that_are_not_weights_are_refused(void **state) {
    (void)state;
    assert_load_fails(scratch_path(&folder, "none.h5"), "No such file");
    assert_load_fails(folder.folder, "directory");
    const char *path = scratch_path(&folder, "text.h5");
    scratch_write(path, "energy: 1\n", 10);
    assert_load_fails(path, "not an HDF5 file");
    H5Fclose(H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
    assert_load_fails(path, "attribute format of / is missing");
}

static void every_truncation_is_noticed(void **state) {
    (void)state;
    const char *path = saved(), *cut = scratch_path(&folder, "cut.h5");
    size_t size;
    char *bytes = scratch_read(path, &size);
    for (size_t length = 0; length < size; length += 1 + size / 61) {
        scratch_write(cut, bytes, length);
        assert_load_fails(cut, length < 8 ? "not an HDF5" : "damaged, or not written by portmet");
    }
    free(bytes);
}

// Returns the offset of the numbers of a parameter in the file.
static size_t offset_of(const char *path, const char *name) {
    const hid_t file = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT);
    const hid_t id = H5Dopen2(file, name, H5P_DEFAULT);
    const haddr_t offset = H5Dget_offset(id);
    H5Dclose(id);
    H5Fclose(file);
    return (size_t)offset;
}

static void every_changed_byte_of_a_value_is_noticed(void **state) {
    (void)state;
    const char *path = saved(), *changed = scratch_path(&folder, "changed.h5");
    char name[128];
    size_t size;
    char *bytes = scratch_read(path, &size);
    for (int i = 0; i < part.params.count; ++i) {
        snprintf(name, sizeof name, "/parameters/%s", part.params.entry[i].name);
        const size_t offset = offset_of(path, name);
        for (size_t k = offset; k < offset + 8; ++k) {
            bytes[k] ^= 1;
            scratch_write(changed, bytes, size);
            assert_load_fails(changed, "digest of the content is");
            bytes[k] ^= 1;
        }
    }
    free(bytes);
}

// Runs `change` on the open file of freshly saved weights and returns its path.
static const char *with_change(void (*change)(hid_t file)) {
    const char *path = saved();
    const hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    change(file);
    H5Fclose(file);
    return path;
}

static void set_version(hid_t file) {
    const int version = 2;
    const hid_t id = H5Aopen(file, "version", H5P_DEFAULT);
    H5Awrite(id, H5T_NATIVE_INT, &version);
    H5Aclose(id);
}

static void set_text(hid_t file, const char *object, const char *name, const char *text) {
    const hid_t space = H5Screate(H5S_SCALAR), type = H5Tcopy(H5T_C_S1);
    H5Tset_size(type, strlen(text) + 1);
    H5Adelete_by_name(file, object, name, H5P_DEFAULT);
    const hid_t id =
        H5Acreate_by_name(file, object, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    H5Awrite(id, type, text);
    H5Aclose(id);
    H5Tclose(type);
    H5Sclose(space);
}

static void set_step(hid_t file) {
    const double step = -0.0;
    const hid_t id = H5Aopen(file, "step", H5P_DEFAULT);
    H5Awrite(id, H5T_NATIVE_DOUBLE, &step);
    H5Aclose(id);
}

static void set_format(hid_t file) {
    set_text(file, "/", "format", "somebody's weights");
}

static void set_broken_model(hid_t file) {
    set_text(file, "/", "model", "energy: [");
}

static void set_other_model(hid_t file) {
    set_text(file, "/", "model", "energy: {features: [height], skip: linear}\n");
}

static void set_escape(hid_t file) {
    set_text(file, "/", "command", "\033[2J");
}

static void set_group_name(hid_t file) {
    set_text(file, "/layout", "names", "q/../p");
}

// Overwrites an attribute of /layout. A text consists of three names of one letter each.
static void write_layout(hid_t file, const char *name, const void *value) {
    const hid_t group = H5Gopen2(file, "/layout", H5P_DEFAULT);
    const hid_t id = H5Aopen(group, name, H5P_DEFAULT);
    const hid_t type = H5Aget_type(id);
    assert_true(H5Awrite(id, type, value) >= 0);
    H5Tclose(type);
    H5Aclose(id);
    H5Gclose(group);
}

static void repeat_group(hid_t file) {
    write_layout(file, "names", "q\0q\0s");
}

static void misname_group(hid_t file) {
    write_layout(file, "names", "q\0/\0s");
}

static void set_size(hid_t file) {
    const uint64_t size[3] = {2, UINT64_MAX, 1};
    write_layout(file, "sizes", size);
}

static void drop_parameter(hid_t file) {
    char name[128];
    snprintf(name, sizeof name, "/parameters/%s", part.params.entry[2].name);
    H5Ldelete(file, name, H5P_DEFAULT);
}

static void add_parameter(hid_t file) {
    const hid_t space = H5Screate(H5S_SCALAR);
    const double one = 1;
    const hid_t id = H5Dcreate2(file, "/parameters/zeta", H5T_IEEE_F64LE, space, H5P_DEFAULT,
                                H5P_DEFAULT, H5P_DEFAULT);
    H5Dwrite(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, &one);
    H5Dclose(id);
    H5Sclose(space);
}

// Replaces the widest parameter by one of another type or shape, holding `value` rounded.
static void replace(hid_t file, hid_t type, int extra_rows) {
    const pm_param_entry *entry = &part.params.entry[0];
    for (int i = 0; i < part.params.count; ++i) {
        const pm_param_entry *other = &part.params.entry[i];
        entry = other->rows * other->cols > entry->rows * entry->cols ? other : entry;
    }
    char name[128];
    double value[256] = {0};
    snprintf(name, sizeof name, "/parameters/%s", entry->name);
    assert_true(entry->rows * entry->cols <= 200);
    memcpy(value, entry->value, (size_t)(entry->rows * entry->cols) * sizeof *value);
    const hsize_t size[2] = {(hsize_t)(entry->rows + extra_rows), (hsize_t)entry->cols};
    const hid_t space = H5Screate_simple(2, size, NULL);
    H5Ldelete(file, name, H5P_DEFAULT);
    const hid_t id = H5Dcreate2(file, name, type, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    H5Dwrite(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value);
    H5Dclose(id);
    H5Sclose(space);
}

static void add_row(hid_t file) {
    replace(file, H5T_IEEE_F64LE, 1);
}

static void make_integer(hid_t file) {
    replace(file, H5T_STD_I32LE, 0);
}

static void make_single(hid_t file) {
    replace(file, H5T_IEEE_F32LE, 0);
}

static void put_nan(hid_t file) {
    char name[128];
    double value[256];
    snprintf(name, sizeof name, "/parameters/%s", part.params.entry[1].name);
    const hid_t id = H5Dopen2(file, name, H5P_DEFAULT);
    H5Dread(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value);
    value[0] = NAN;
    H5Dwrite(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value);
    H5Dclose(id);
}

static void changed_content_is_refused(void **state) {
    (void)state;
    char words[256];
    assert_load_fails(with_change(set_version), "version of the format is 2, expected 1");
    assert_load_fails(with_change(set_step), "step is -0 s, expected a time > 0");
    assert_load_fails(with_change(set_format), "format is \"somebody's weights\"");
    assert_load_fails(with_change(set_broken_model), "model: ");
    assert_load_fails(with_change(set_other_model), "height");
    assert_load_fails(with_change(set_escape), "attribute command of /: text is unreadable");
    assert_load_fails(with_change(set_group_name),
                      "/layout has 1 names, 3 units, 3 sizes and 0 co-energies");
    assert_load_fails(with_change(repeat_group), "group \"q\" is not a name, or there twice");
    assert_load_fails(with_change(misname_group), "group \"/\" is not a name");
    assert_load_fails(with_change(set_size), "group p has 18446744073709551615 components");
    snprintf(words, sizeof words, "dataset /parameters/%s is missing", part.params.entry[2].name);
    assert_load_fails(with_change(drop_parameter), words);
    assert_load_fails(with_change(add_parameter), "parameter zeta is not one of this model");
    assert_load_fails(with_change(add_row), "dimension 1 is ");
    assert_load_fails(with_change(make_integer), "expected float64 or float32");
    snprintf(words, sizeof words, "parameter %s [0][0] is nan", part.params.entry[1].name);
    assert_load_fails(with_change(put_nan), words);
}

static void single_precision_is_accepted_where_the_digest_is_of_it(void **state) {
    (void)state;
    assert_load_fails(with_change(make_single), "digest of the content is");
    for (int i = 0; i < part.params.count; ++i) {
        pm_param_entry *entry = &part.params.entry[i];
        for (int k = 0; k < entry->rows * entry->cols; ++k) {
            entry->value[k] = (double)(float)entry->value[k];
        }
    }
    pm_part loaded = {0};
    pm_provenance p;
    assert_int_equal(
        pm_weights_load(with_change(make_single), &arena, pm_component_of_part(&loaded), &p),
        PM_OK);
    assert_same_params(&loaded.params, &part.params);
    pm_part_free(&loaded);
}

static void what_cannot_be_loaded_is_not_saved(void **state) {
    (void)state;
    part.params.entry[1].value[0] = NAN;
    const char *path = scratch_path(&folder, "weights.h5");
    assert_int_equal(pm_weights_save(path, pm_component_of_part(&part), &provenance), PM_EWEIGHTS);
    part.params.entry[1].value[0] = 1;
    assert_int_equal(
        pm_weights_save("/nonexistent/weights.h5", pm_component_of_part(&part), &provenance),
        PM_EFILE);
    assert_int_equal(scratch_files(&folder, 0), 0);
}

int main(void) {
    H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_subsystem_comes_back_bit_by_bit, setup, teardown),
        cmocka_unit_test_setup_teardown(a_training_range_comes_back, setup, teardown),
        cmocka_unit_test_setup_teardown(a_port_comes_back_bit_by_bit, setup, teardown),
        cmocka_unit_test_setup_teardown(the_digest_depends_on_content_only, setup, teardown),
        cmocka_unit_test_setup_teardown(files_that_are_not_weights_are_refused, setup, teardown),
        cmocka_unit_test_setup_teardown(every_truncation_is_noticed, setup, teardown),
        cmocka_unit_test_setup_teardown(every_changed_byte_of_a_value_is_noticed, setup, teardown),
        cmocka_unit_test_setup_teardown(changed_content_is_refused, setup, teardown),
        cmocka_unit_test_setup_teardown(single_precision_is_accepted_where_the_digest_is_of_it,
                                        setup, teardown),
        cmocka_unit_test_setup_teardown(what_cannot_be_loaded_is_not_saved, setup, teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
