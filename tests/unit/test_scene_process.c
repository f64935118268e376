// The processes of a scene: which subsystems share a process, and the errors in a section
// `processes`.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "scene/scene.h"

#define NAME48 "abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuv"

#define PART(name) "  " name ": {weights: a.h5, state: {x: {unit: m, size: 1}}}\n"
#define FIVE                                       \
    "scene: x\n"                                   \
    "time: {dt: 1, steps: 1, integrator: euler}\n" \
    "subsystems:\n" PART("a") PART("b") PART("c") PART("d") PART("e")

// Which subsystems share a process.
static void test_processes(void **state) {
    (void)state;
    static const char text[] = FIVE "processes:\n"
                                    "  last: [e]\n"
                                    "  some: [d, b]\n";
    static const char *const names[] = {"a", "some", "c", "last"};
    static const int counts[] = {1, 2, 1, 1}, process[] = {0, 1, 2, 1, 3};
    pm_scene *scene = NULL;
    assert_int_equal(pm_scene_parse(&scene, text, "t.yaml"), PM_OK);
    assert_int_equal(scene->nprocess, 4);
    for (int i = 0; i < 4; ++i) {
        assert_string_equal(scene->process[i].name, names[i]);
        assert_int_equal(scene->process[i].count, counts[i]);
        assert_int_equal(pm_scene_find_process(scene, names[i]), i);
    }
    for (int i = 0; i < 5; ++i) {
        assert_int_equal(scene->subsystem[i].process, process[i]);
    }
    assert_int_equal(scene->process[1].subsystem[0], 1);
    assert_int_equal(scene->process[1].subsystem[1], 3);
    assert_int_equal(pm_scene_find_process(scene, "b"), -1);
    assert_int_equal(pm_scene_join_processes(scene), PM_OK);
    assert_int_equal(scene->nprocess, 1);
    assert_int_equal(scene->process[0].count, 5);
    assert_int_equal(scene->subsystem[4].process, 0);
    pm_scene_free(scene);
}

static void test_bad_processes(void **state) {
    (void)state;
    static const struct {
        const char *section, *error;
    } cases[] = {
        {"[a, b]\n", "t.yaml:9:12: processes: expected a mapping"},
        {"{p: []}\n", "expected at least one subsystem"},
        {"{p: [a, f]}\n", "there is no subsystem \"f\"; subsystems: a, b, c, d, e"},
        {"{p: [a, b], r: [c, b]}\n", "subsystem \"b\" has a process already"},
        {"{p: [a, a]}\n", "subsystem \"a\" has a process already"},
        {"{c: [a, b]}\n", "a subsystem is called \"c\" that this process does not serve"},
        {"{p-q: [a]}\n", "expected a name"},
        {"{" NAME48 "_too_long: [a]}\n", "expected a name"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        char text[1024];
        snprintf(text, sizeof text, FIVE "processes: %s", cases[i].section);
        pm_scene *scene = NULL;
        assert_int_equal(pm_scene_parse(&scene, text, "t.yaml"), PM_ECONFIG);
        if (strstr(pm_error(), cases[i].error) == NULL) {
            fail_msg("%s: %s", cases[i].section, pm_error());
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_processes),
        cmocka_unit_test(test_bad_processes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
