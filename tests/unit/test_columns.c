// Columns: a state comes from a dataset's row and goes back, through chains of relative positions.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "scene/columns.h"
#include "tests/support/unit.h"

#define NZ 9
#define NCOLUMN 11

// Three links in an order in which every base comes after its dependant: 0 is measured from 1, and
// 1 from 2. Each has q [2] and s.
static const char *const names[NCOLUMN] = {"t1",  "q2x", "q2y", "s0",  "s1", "q0y",
                                           "q0x", "x",   "q1x", "q1y", "s2"};
static const char *const mapped[3][3] = {
    {"q0x", "q0y", "s0"}, {"q1x", "q1y", "s1"}, {"q2x", "q2y", "s2"}};
static const char *const place[3] = {"f:1:10", "f:1:20", "f:1:30"};

static pm_group group[] = {{.name = "q", .unit = "m", .size = 2},
                           {"s", "J/K", 1, 2, PM_ROLE_ENTROPY, false}};
static const char *group_at[] = {"f:1:5", "f:1:6"};
static int relative_subsystem[3][2], relative_group[3][2];

static pm_scene_subsystem subsystem[3];
static pm_scene scene;
static pm_dataset dataset;
static pm_arena arena;

static int setup(void **state) {
    (void)state;
    for (int i = 0; i < 3; ++i) {
        subsystem[i] = (pm_scene_subsystem){.name = i == 0   ? "zero"
                                                    : i == 1 ? "one"
                                                             : "two",
                                            .at = "f:1:1",
                                            .group_at = group_at,
                                            .column_at = place,
                                            .layout = {.ngroup = 2, .nz = 3, .group = group},
                                            .column = mapped[i],
                                            .relative_subsystem = relative_subsystem[i],
                                            .relative_group = relative_group[i],
                                            .first = 3 * i};
        relative_subsystem[i][0] = i < 2 ? i + 1 : -1;
        relative_subsystem[i][1] = -1;
        relative_group[i][0] = relative_group[i][1] = 0;
    }
    scene = (pm_scene){.path = "scene.yaml",
                       .physics = {.nsubsystem = 3, .subsystem = subsystem, .nz = NZ}};
    dataset = (pm_dataset){.ncolumn = NCOLUMN, .column = names};
    return 0;
}

static int teardown(void **state) {
    (void)state;
    pm_arena_free(&arena);
    return 0;
}

static void assert_bind_fails(pm_status code, const char *words) {
    pm_columns columns = {.nz = -7};
    const pm_status status = pm_columns_bind(&columns, &scene, &dataset, &arena);
    if (status != code || strstr(pm_error(), words) == NULL) {
        fail_msg("status %d, expected %d; error \"%s\", expected \"%s\"", status, code, pm_error(),
                 words);
    }
    assert_int_equal(columns.nz, -7);
}

static void relative_positions_are_differences_of_columns(void **state) {
    (void)state;
    pm_columns columns;
    assert_int_equal(pm_columns_bind(&columns, &scene, &dataset, &arena), PM_OK);
    const double row[NCOLUMN] = {-1, 5, 50, 0.1, 0.2, 10, 1, -1, 3, 30, 0.3};
    const double expected[NZ] = {1 - 3, 10 - 30, 0.1, 3 - 5, 30 - 50, 0.2, 5, 50, 0.3};
    double z[NZ];
    pm_columns_to_state(&columns, row, z);
    assert_memory_equal(z, expected, sizeof z);
}

static void to_row_inverts_to_state_up_to_rounding(void **state) {
    (void)state;
    const double tolerance = 1e-15; // a few roundings of numbers below 4
    pm_columns columns;
    pm_rng rng;
    pm_rng_init(&rng, 11, 0);
    assert_int_equal(pm_columns_bind(&columns, &scene, &dataset, &arena), PM_OK);
    for (int trial = 0; trial < 100; ++trial) {
        double row[NCOLUMN], back[NCOLUMN], z[NZ], again[NZ];
        for (int k = 0; k < NCOLUMN; ++k) {
            row[k] = 2 * pm_rng_uniform(&rng) - 1;
            back[k] = row[k];
        }
        back[1] = back[5] = back[9] = NAN;
        pm_columns_to_state(&columns, row, z);
        pm_columns_to_row(&columns, z, back);
        pm_columns_to_state(&columns, back, again);
        for (int k = 0; k < NCOLUMN; ++k) {
            if (!(fabs(back[k] - row[k]) <= tolerance)) {
                fail_msg("seed 11, trial %d, column %d: %.17g, expected %.17g within %g", trial, k,
                         back[k], row[k], tolerance);
            }
        }
        for (int i = 0; i < NZ; ++i) {
            assert_true(fabs(again[i] - z[i]) <= tolerance);
        }
    }
}

static void columns_that_are_not_mapped_stay_untouched(void **state) {
    (void)state;
    pm_columns columns;
    assert_int_equal(pm_columns_bind(&columns, &scene, &dataset, &arena), PM_OK);
    double row[NCOLUMN], z[NZ] = {0};
    for (int k = 0; k < NCOLUMN; ++k) {
        row[k] = 42;
    }
    pm_columns_to_row(&columns, z, row);
    for (int k = 0; k < NCOLUMN; ++k) {
        assert_true(row[k] == (k == 0 || k == 7 ? 42 : 0));
    }
}

static void groups_of_one_name_are_pooled(void **state) {
    (void)state;
    pm_columns columns;
    assert_int_equal(pm_columns_bind(&columns, &scene, &dataset, &arena), PM_OK);
    assert_int_equal(columns.ngroup, 2);
    assert_string_equal(columns.group_name[0], "q");
    assert_string_equal(columns.group_name[1], "s");
    for (int i = 0; i < NZ; ++i) {
        assert_int_equal(columns.group[i], i % 3 == 2);
    }
}

static void a_missing_column_is_named_with_those_there_are(void **state) {
    (void)state;
    static const char *const wrong[3] = {"q1x", "q1z", "s1"};
    subsystem[1].column = wrong;
    assert_bind_fails(PM_EDATA, "f:1:20: subsystem one: column \"q1z\" is not in the dataset, "
                                "which has: t1 q2x q2y s0 s1 q0y q0x x q1x q1y s2");
}

static void a_long_list_of_columns_is_cut_short(void **state) {
    (void)state;
    const char *many[500];
    for (int k = 0; k < 500; ++k) {
        many[k] = "a_rather_long_name";
    }
    dataset = (pm_dataset){.ncolumn = 500, .column = many};
    assert_bind_fails(PM_EDATA, "which has: a_rather_long_name a_rather_long_name");
}

static void bad_maps_are_refused(void **state) {
    (void)state;
    subsystem[2].column = NULL;
    assert_bind_fails(PM_ECONFIG, "f:1:1: subsystem two maps no columns");
    subsystem[2].column = mapped[1];
    assert_bind_fails(PM_ECONFIG, "f:1:10: subsystem two: column \"q1x\" is mapped twice");
    subsystem[2].column = mapped[2];
    subsystem[0].relative_group[0] = 1;
    assert_bind_fails(PM_ECONFIG,
                      "f:1:5: group zero.q has 2 components, but is measured from one.s");
    subsystem[0].relative_group[0] = 0;
    subsystem[2].relative_subsystem[0] = 0;
    assert_bind_fails(PM_ECONFIG, "column \"q0x\" is measured from itself");
}

static void units_must_be_those_of_the_scene(void **state) {
    (void)state;
    static const struct {
        const char *units, *words;
    } c[] = {
        {"J/K;m;m;J/K;J/K;m;m;1;m;m;J/K", NULL},
        {"J/K;m;mm;J/K;J/K;m;m;1;m;m;J/K",
         "f:1:5: group two.q has the unit \"m\", and the dataset's column \"q2y\" has \"mm\""},
        {"J/K;m;m;J/K;J/K;m;m;mm;m;m;J/K", NULL}, // of a column that is not mapped
        {";m;;J/K;J/K;m;m;1;m;m;J/K", NULL},      // an empty unit is not known
        {"J/K;m", "names 2 units of 11 columns"},
        {"", "names 1 units of 11 columns"},
    };
    for (size_t i = 0; i < sizeof c / sizeof *c; ++i) {
        const pm_note note = {"units", c[i].units};
        dataset.nnote = 1;
        dataset.note = &note;
        if (c[i].words != NULL) {
            assert_bind_fails(PM_EDATA, c[i].words);
        } else {
            pm_columns columns;
            assert_int_equal(pm_columns_bind(&columns, &scene, &dataset, &arena), PM_OK);
        }
    }
}

static void units_become_those_of_the_scene_and_come_back(void **state) {
    (void)state;
    pm_dataset *d = NULL;
    pm_scene_prescribed value[3] = {{.column = "x", .at = "f:1:40"}, {.number = 1}, {.number = 0}};
    pm_group volume = {.name = "v", .unit = "m^3", .size = 1};
    pm_scene_boundary_input input = {
        .name = "inflow", .layout = {.ngroup = 1, .nz = 1, .group = &volume}, .value = value};
    scene.physics.nboundary_input = 1;
    scene.physics.boundary_input = &input;
    assert_int_equal(pm_dataset_new(&d, 1, 2, NCOLUMN, 1, names), PM_OK);
    assert_int_equal(pm_dataset_with_rates(d), PM_OK);
    for (int k = 0; k < 2 * NCOLUMN; ++k) {
        d->z[k] = k % NCOLUMN;
        d->zdot[k] = 1;
    }
    d->z[NCOLUMN + 1] = NAN;
    pm_dataset *other = NULL; // whose numbers the scene predicts
    assert_int_equal(pm_dataset_new(&other, 1, 2, NCOLUMN, 1, names), PM_OK);
    assert_int_equal(pm_dataset_note(d, "units", "1;mm;mm;kJ/K;J/K;m;m;L;m;metre;J/K"), PM_OK);
    assert_int_equal(pm_columns_convert(&scene, d), PM_OK);
    assert_string_equal(pm_dataset_find_note(d, "units"), "1;m;m;J/K;J/K;m;m;m^3;m;metre;J/K");
    const double expected[NCOLUMN] = {0, 1e-3, 2e-3, 3e3, 4, 5, 6, 7e-3, 8, 9, 10};
    for (int k = 0; k < NCOLUMN; ++k) {
        assert_true(fabs(d->z[k] - expected[k]) <= 1e-15 * expected[k]);
        assert_true(fabs(pm_dataset_unchanged(d, k, d->z[k]) - k) <= 1e-14 * k);
    }
    assert_true(isnan(d->z[NCOLUMN + 1]) && d->zdot[3] == 1e3 && d->zdot[NCOLUMN + 3] == 1e3);
    // A unit that is not known must be that of the scene.
    dataset = *d;
    assert_bind_fails(PM_EDATA, "has \"metre\", which cannot be converted");
    memcpy(other->z, d->z, 2 * NCOLUMN * sizeof *d->z);
    assert_int_equal(pm_dataset_restore_units(other, d), PM_OK);
    assert_string_equal(pm_dataset_find_note(other, "units"), "1;mm;mm;kJ/K;J/K;m;m;L;m;metre;J/K");
    for (int k = 0; k < NCOLUMN; ++k) {
        assert_true(fabs(other->z[k] - k) <= 1e-14 * k);
    }
    // A boundary input follows no column of another quantity.
    pm_dataset_free(d);
    assert_int_equal(pm_dataset_new(&d, 1, 2, NCOLUMN, 1, names), PM_OK);
    assert_int_equal(pm_dataset_note(d, "units", ";;;;;;;kPa;;;"), PM_OK);
    assert_int_equal(pm_columns_convert(&scene, d), PM_EDATA);
    assert_non_null(strstr(pm_error(), "f:1:40: the column \"x\" is in kPa, expected m^3"));
    // A column has one unit: here a volume and, elsewhere, litres.
    pm_dataset_free(d);
    pm_group litres = {.name = "v", .unit = "L", .size = 1};
    pm_scene_boundary_input both[2] = {input, input};
    both[1].layout.group = &litres;
    scene.physics.nboundary_input = 2;
    scene.physics.boundary_input = both;
    assert_int_equal(pm_dataset_new(&d, 1, 2, NCOLUMN, 1, names), PM_OK);
    assert_int_equal(pm_dataset_note(d, "units", ";;;;;;;mL;;;"), PM_OK);
    assert_int_equal(pm_columns_convert(&scene, d), PM_ECONFIG);
    assert_non_null(
        strstr(pm_error(), "f:1:40: the column \"x\" is used in L, and elsewhere in m^3"));
    pm_dataset_free(other);
    pm_dataset_free(d);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(relative_positions_are_differences_of_columns, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(to_row_inverts_to_state_up_to_rounding, setup, teardown),
        cmocka_unit_test_setup_teardown(columns_that_are_not_mapped_stay_untouched, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(groups_of_one_name_are_pooled, setup, teardown),
        cmocka_unit_test_setup_teardown(a_missing_column_is_named_with_those_there_are, setup,
                                        teardown),
        cmocka_unit_test_setup_teardown(a_long_list_of_columns_is_cut_short, setup, teardown),
        cmocka_unit_test_setup_teardown(bad_maps_are_refused, setup, teardown),
        cmocka_unit_test_setup_teardown(units_must_be_those_of_the_scene, setup, teardown),
        cmocka_unit_test_setup_teardown(units_become_those_of_the_scene_and_come_back, setup,
                                        teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
