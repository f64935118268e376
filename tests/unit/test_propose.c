// Proposals of training files: units, regressions on data, the proposed file, and the division of
// trajectories into training and validation.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "learn/split.h"
#include "propose/propose.h"
#include "propose/propose_view.h"

// --- units ---

static void assert_unit(const char *a, const char *b, bool same) {
    const pm_unit left = pm_unit_parse(a), right = pm_unit_parse(b);
    if (pm_unit_equal(&left, &right) != same) {
        fail_msg("\"%s\" and \"%s\": expected %s", a, b, same ? "one unit" : "two units");
    }
}

static void units_are_powers_of_base_units(void **state) {
    (void)state;
    assert_unit("J s", "kg m^2/s", true);
    assert_unit("C*Wb", "J s", true);
    assert_unit("N m s", "kg m2 s^-1", true);
    assert_unit("W/(K m)", "kg m/(s^3 K)", true);
    assert_unit("J/K", "J", false);
    assert_unit("rad", "1", true);
    assert_unit("1/s", "Hz", true);
    assert_unit("furlong", "furlong", false); // not known, so never equal
    assert_unit("m^x", "m", false);
}

// --- the choice of trajectories ---

static void every_fifth_is_kept_back(void **state) {
    (void)state;
    pm_arena arena = {0};
    pm_split split;
    assert_int_equal(pm_split_choose(&split, 12, NULL, NULL, &arena), PM_OK);
    assert_string_equal(split.validation, "4,9");
    assert_string_equal(split.training, "0:4,5:9,10:12");
    assert_int_equal(pm_split_choose(&split, 12, "2:8", NULL, &arena), PM_OK);
    assert_string_equal(split.validation, "6");
    assert_string_equal(split.training, "2:6,7");
    assert_int_equal(pm_split_choose(&split, 4, NULL, NULL, &arena), PM_OK);
    assert_int_equal(split.nvalidation, 0);
    assert_int_equal(pm_split_choose(&split, 12, "0:8", "8:12", &arena), PM_OK);
    assert_int_equal(split.ntraining, 8);
    assert_int_equal(split.nvalidation, 4);
    assert_int_equal(pm_split_choose(&split, 12, NULL, "none", &arena), PM_OK);
    assert_int_equal(split.ntraining, 12);
    assert_int_equal(pm_split_choose(&split, 12, "3", "3", &arena), PM_EUSAGE);
    assert_int_equal(pm_split_choose(&split, 12, NULL, "10:20", &arena), PM_EUSAGE);
    pm_arena_free(&arena);
}

static void a_dataset_is_sorted_by_the_choice(void **state) {
    (void)state;
    static const char *const column[] = {"x"};
    pm_arena arena = {0};
    pm_split split;
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 6, 2, 1, 0.1, column), PM_OK);
    for (int i = 0; i < 6; ++i) {
        *pm_dataset_state(d, i, 0) = i;
    }
    const uint64_t digest = pm_dataset_digest(d, 1);
    assert_int_equal(pm_split_choose(&split, 6, NULL, "1", &arena), PM_OK);
    assert_int_equal(pm_split_reorder(&split, d), PM_OK);
    static const double expected[] = {0, 2, 3, 4, 5, 1};
    for (int i = 0; i < 6; ++i) {
        assert_true(*pm_dataset_state(d, i, 0) == expected[i]);
    }
    assert_true(pm_dataset_digest(d, 5) == digest);
    pm_dataset_free(d);
    pm_arena_free(&arena);
}

// --- statistics of data, and a proposal ---

// Two masses on springs. The second spring joins them, and x2 is its extension. The names of
// variables carry no information; the units and the data do.
static const char scene_text[] = "scene: pair\n"
                                 "time: {dt: 0.05, steps: 10, integrator: rk4, substeps: 2}\n"
                                 "subsystems:\n"
                                 "  first:\n"
                                 "    weights: first.h5\n"
                                 "    state:\n"
                                 "      u: {unit: kg m/s, columns: [p1]}\n"
                                 "      v: {unit: m, columns: [x1]}\n"
                                 "      w: {unit: J/K, columns: [s1]}\n"
                                 "  second:\n"
                                 "    weights: second.h5\n"
                                 "    state:\n"
                                 "      v: {unit: m, columns: [x2]}\n"
                                 "      u: {unit: kg m/s, columns: [p2]}\n"
                                 "      w: {unit: J/K, columns: [s2]}\n"
                                 "ports:\n"
                                 "  joint:\n"
                                 "    law: bracket\n"
                                 "    between: [first, second]\n"
                                 "    expose: {first: [u, v, w], second: [u, v, w]}\n"
                                 "    weights: joint.h5\n";

static pm_dataset *make_data(void) {
    static const char *const column[] = {"x1", "p1", "s1", "x2", "p2", "s2"};
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 5, 60, 6, 0.05, column), PM_OK);
    for (int i = 0; i < 5; ++i) {
        double z[6] = {0.3 + 0.1 * i, -0.2 * i, 0.01 * i, 0.2 - 0.1 * i, 0.3, 0.02};
        for (int j = 0; j < 60; ++j) {
            memcpy(pm_dataset_state(d, i, j), z, sizeof z);
            for (int k = 0; k < 500; ++k) { // masses of 2 and 0.5 kg
                const double h = 1e-4, spring = 3 * z[3] + z[3] * z[3] * z[3];
                const double v1 = z[1] / 2, v2 = z[4] / 0.5;
                z[1] += h * (-4 * z[0] + spring - 0.2 * v1);
                z[4] += h * (-spring - 0.1 * v2);
                z[0] += h * z[1] / 2;
                z[3] += h * (z[4] / 0.5 - z[1] / 2);
                z[2] += h * 0.2 * v1 * v1 / 300;
                z[5] += h * 0.1 * v2 * v2 / 300;
            }
        }
    }
    return d;
}

static void data_say_what_moves_with_what(void **state) {
    (void)state;
    pm_scene *scene = NULL;
    pm_dataset *d = make_data();
    pm_look look;
    pm_part_view part[2];
    pm_port_view port;
    assert_int_equal(pm_scene_parse(&scene, scene_text, "pair.yaml"), PM_OK);
    assert_int_equal(pm_look_make(&look, scene, d), PM_OK);
    pm_view_parts(&look, part);
    assert_int_equal(part[0].kind[0], PM_VIEW_MOMENTUM);
    assert_int_equal(part[0].kind[1], PM_VIEW_POSITION);
    assert_int_equal(part[0].kind[2], PM_VIEW_ENTROPY);
    assert_true(part[0].sign[1] == 1 && part[0].linear[1] && part[0].geometric[1]);
    assert_false(part[0].geometric[0]);
    pm_view_port(&look, part, 0, &port);
    int found = 0;
    for (int i = 0; i < port.count; ++i) { // first.u carries second.v: x2' = p2/m2 - p1/m1
        found += port.pair[i].a == 0 && port.pair[i].b == 0 && port.pair[i].momentum_first &&
                 port.pair[i].coefficient == 1;
    }
    assert_int_equal(found, 1);
    pm_look_free(&look);
    pm_dataset_free(d);
    pm_scene_free(scene);
}

static void assert_says(const char *text, const char *expected) {
    if (strstr(text, expected) == NULL) {
        fail_msg("expected \"%s\" in:\n%s", expected, text);
    }
}

static void a_proposal_names_them(void **state) {
    (void)state;
    char path[] = "/tmp/test_proposeXXXXXX";
    const int id = mkstemp(path);
    assert_true(id >= 0);
    pm_scene *scene = NULL;
    pm_dataset *d = make_data();
    assert_int_equal(pm_scene_parse(&scene, scene_text, "pair.yaml"), PM_OK);
    const pm_proposal p = {scene, d, "pair.yaml", "data.h5", PM_HARD};
    assert_int_equal(pm_propose(&p, path), PM_OK);
    FILE *file = fopen(path, "r");
    char text[16384];
    text[fread(text, 1, sizeof text - 1, file)] = '\0';
    fclose(file);
    remove(path);
    assert_says(text, "given: [[v, u, 1.0]]");
    assert_says(text, "given: [[a.u, b.v, 1.0]]");
    assert_says(text, "entropy: {given: [w]}");
    assert_says(text, "acts_on: [u, w], rank: 1");
    assert_says(text, "acts_on: [a.u, b.u, a.w, b.w], rank: 3");
    assert_says(text, "stages:");
    pm_dataset_free(d);
    pm_scene_free(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(units_are_powers_of_base_units),
        cmocka_unit_test(every_fifth_is_kept_back),
        cmocka_unit_test(a_dataset_is_sorted_by_the_choice),
        cmocka_unit_test(data_say_what_moves_with_what),
        cmocka_unit_test(a_proposal_names_them),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
