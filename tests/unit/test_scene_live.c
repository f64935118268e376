// Live inputs of a scene: the values that arrive during a run, and where messages carry them.
#include <math.h>

#include "scene/scene.h"
#include "tests/support/yaml_case.h"

static const char good[] =
    "scene: x\n"
    "time: {dt: 1, steps: 1, integrator: rk4, pace: 2}\n"
    "live_inputs:\n"
    "  FORCE: {values: [fx, fy], start: [1, 2], age: 0.5}\n"
    "  TABLE: {values: \"v_[0:2]\", wait: true, message: [byte flag, int32_t step,\n"
    "    \"float v[3]\"]}\n"
    "boundary_inputs:\n"
    "  hand: {q: {unit: m, dE: [fx, fy, v_0, v_1]}}\n"
    "subsystems:\n"
    "  a: {weights: a.h5, state: {q: {unit: m, size: 4}}}\n";

static void assert_place(pm_live_place place, pm_live_type type, int size, int offset) {
    assert_int_equal(place.type, type);
    assert_int_equal(place.size, size);
    assert_int_equal(place.offset, offset);
}

static void test_places(void **state) {
    (void)state;
    pm_scene *scene = NULL;
    if (pm_scene_parse(&scene, good, "t.yaml") != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_int_equal(scene->network.nlive_input, 2);
    assert_int_equal(scene->network.nlive, 4);
    assert_true(scene->run.pace == 2);
    const pm_scene_live_input *force = &scene->network.live_input[0],
                              *table = &scene->network.live_input[1];
    assert_true(force->own_type && force->starts && !force->waits && force->age == 0.5);
    assert_true(force->start[0] == 1 && force->start[1] == 2);
    assert_int_equal(force->least_size, 8 + 8 + 4 + 2 * 8);
    assert_place(force->place[1], PM_LIVE_DOUBLE, 8, 8 + 8 + 4 + 8);
    assert_true(!table->own_type && !table->starts && table->waits && isinf(table->age));
    assert_int_equal(table->first, 2);
    assert_int_equal(table->least_size, 8 + 1 + 4 + 3 * 4);
    assert_place(table->step, PM_LIVE_INTEGER, 4, 8 + 1);
    assert_place(table->place[1], PM_LIVE_FLOAT, 4, 8 + 1 + 4 + 4);
    assert_int_equal(pm_scene_find_live(scene, "v_1"), 3);
    assert_int_equal(pm_scene_find_live(scene, "v_2"), -1);
    pm_scene_free(scene);
}

static const yaml_case bad[] = {
    {"pace: 2", "pace: 0", "0", "pace: expected a number > 0"},
    {"FORCE:", "F-1:", "F-1", "expected a name of a letter"},
    {"{values: [fx, fy], start", "{start", "{", "FORCE: missing key \"values\""},
    {"age: 0.5", "ages: 0.5", "ages", "FORCE: unknown key \"ages\"; allowed: values, start"},
    {"start: [1, 2]", "start: [1]", "[1]", "start: expected 2 as under \"values\", found 1"},
    {"age: 0.5", "age: -1", "-1", "age: expected a number >= 0"},
    {"age: 0.5", "wait: true", "true", "has no `start`"},
    {"values: [fx, fy]", "values: [fx, fz]", "fz", "no boundary input names the value \"fz\""},
    {"\"v_[0:2]\"", "[fx, v_0]", "fx", "\"fx\" is the name of another live value already"},
    {"byte flag", "string flag", "string", "expected a field such as"},
    {"byte flag", "byte", "byte", "expected a field such as"},
    {"\"float v[3]\"", "\"float v[0]\"", "\"float", "expected a field such as"},
    {"\"float v[3]\"", "\"float v[3\"", "\"float", "expected a field such as"},
    {"[byte flag, int32_t step,\n    \"float v[3]\"]", "[int32_t step]", "[int32",
     "no field carries the value \"v_0\""},
    {"[byte flag, int32_t step", "[byte flag, int32_t number", "[byte",
     "`wait` needs a field \"int64_t step\""},
    {"scene: x\n", "scene: x\nkey_file: k\nlockstep: {window: 1}\n", "FORCE", "cannot have any"},
    {"scene: x\n", "scene: x\nlockstep: {window: 2}\n", "FORCE", "expected a lockstep window of 1"},
};

static void test_mistakes(void **state) {
    (void)state;
    int failures = 0;
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        char *text = yaml_case_text(good, &bad[i]);
        pm_scene *scene = NULL;
        const pm_status status = pm_scene_parse(&scene, text, "t.yaml");
        failures += !yaml_case_holds("t.yaml", good, &bad[i], status);
        pm_scene_free(scene);
        free(text);
    }
    assert_int_equal(failures, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_places),
                                       cmocka_unit_test(test_mistakes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
