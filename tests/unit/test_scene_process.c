// The processes of a scene: which subsystems share a process, and the errors in a section
// `processes`.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "scene/scene.h"
#include "tests/support/unit.h"

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
    assert_int_equal(scene->network.nprocess, 4);
    for (int i = 0; i < 4; ++i) {
        assert_string_equal(scene->network.process[i].name, names[i]);
        assert_int_equal(scene->network.process[i].count, counts[i]);
        assert_int_equal(pm_scene_find_process(scene, names[i]), i);
    }
    for (int i = 0; i < 5; ++i) {
        assert_int_equal(scene->physics.subsystem[i].process, process[i]);
    }
    assert_int_equal(scene->network.process[1].subsystem[0], 1);
    assert_int_equal(scene->network.process[1].subsystem[1], 3);
    assert_int_equal(pm_scene_find_process(scene, "b"), -1);
    assert_int_equal(pm_scene_merge_processes(scene), PM_OK);
    assert_int_equal(scene->network.nprocess, 1);
    assert_int_equal(scene->network.process[0].count, 5);
    assert_int_equal(scene->physics.subsystem[4].process, 0);
    pm_scene_free(scene);
}

// A chain of 24 links.
#define LINKS(keys) "  " keys ": {weights: a.h5, state: {x: {unit: m, size: 3}}}\n"
#define CHAIN CHAIN_OF(LINKS("\"link[0:24]\""))
#define CHAIN_OF(links)                                                          \
    "scene: x\n"                                                                 \
    "time: {dt: 1, steps: 1, integrator: euler}\n"                               \
    "subsystems:\n" links "ports:\n"                                             \
    "  \"joint[0:23]\": {law: bracket, between: [\"link[i]\", \"link[i+1]\"],\n" \
    "    weights: b.h5, expose: {\"link[i]\": x, \"link[i+1]\": x}}\n"

// The number of ports between two processes.
static int joins(const pm_scene *scene) {
    int count = 0;
    for (int i = 0; i < scene->physics.nport; ++i) {
        count += pm_port_crosses_processes(scene, &scene->physics.port[i]);
    }
    return count;
}

// METIS cuts a chain into four nearly equal pieces, and each time alike. A program that was built
// without it says so.
static void a_chain_is_cut(void **state) {
    (void)state;
    pm_scene *scene = NULL, *again = NULL;
    const pm_status status = pm_scene_parse(&scene, CHAIN "processes: {auto: 4}\n", "t.yaml");
    if (status != PM_OK) {
        assert_int_equal(status, PM_ECONFIG);
        assert_non_null(strstr(pm_error(), "t.yaml:8:19: auto: this program was built without"));
        return;
    }
    assert_int_equal(scene->network.nprocess, 4);
    assert_int_equal(joins(scene), 3);
    for (int i = 0; i < 4; ++i) {
        assert_in_range(scene->network.process[i].count, 5, 7);
        assert_memory_equal(scene->network.process[i].name, "auto", 4);
    }
    assert_int_equal(pm_scene_parse(&again, CHAIN "processes: {auto: 4}\n", "t.yaml"), PM_OK);
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        assert_int_equal(again->physics.subsystem[i].process, scene->physics.subsystem[i].process);
    }
    pm_scene_free(again);
    pm_scene_free(scene);
    // Six links that cost as much as the other 18 get half of the processes: the cost is 45 each,
    // and 15 each of the others but the last one.
    static const char heavy[] =
        CHAIN_OF("  \"link[0:6]\": {weights: a.h5, state: {x: {unit: m, size: 3}, y: {unit: m, "
                 "size: 30}}}\n" LINKS("\"link[6:24]\"")) "processes: {auto: 4}\n";
    assert_int_equal(pm_scene_parse(&scene, heavy, "t.yaml"), PM_OK);
    assert_int_equal(scene->network.nprocess, 4);
    assert_int_equal(joins(scene), 3);
    int links = 0;
    for (int i = 0; i < 4; ++i) {
        int sum = 0;
        for (int k = 0; k < scene->network.process[i].count; ++k) {
            sum += scene->network.process[i].subsystem[k] < 6 ? 45 : 15;
        }
        assert_in_range(sum, 120, 150);
        links += scene->network.process[i].count;
    }
    assert_int_equal(links, 24);
    pm_scene_free(scene);
    assert_int_equal(pm_scene_parse(&scene, CHAIN "processes: {auto: 1}\n", "t.yaml"), PM_OK);
    assert_int_equal(scene->network.nprocess, 1);
    pm_scene_free(scene);
    assert_int_equal(pm_scene_parse(&scene, FIVE "processes: {auto: [a, b]}\n", "t.yaml"), PM_OK);
    assert_int_equal(scene->network.nprocess, 4);
    pm_scene_free(scene);
}

// Every process has a link, even if one link costs more than a whole process should.
static void every_process_gets_a_link(void **state) {
    (void)state;
    static const char *const counts[] = {"3", "4", "7", "8", "12", "23", "24"};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; ++i) {
        for (int size = 1; size < 4000; size *= 2) {
            char text[1024];
            snprintf(
                text, sizeof text,
                CHAIN_OF(LINKS("\"link[0:5]\"") "  link5: {weights: a.h5, state: {x: {unit: m, "
                                                "size: 3}, y: {unit: m, size: %d}}}\n" LINKS(
                                                    "\"link[6:24]\"")) "processes: {auto: %s}\n",
                size, counts[i]);
            pm_scene *scene = NULL;
            if (pm_scene_parse(&scene, text, "t.yaml") == PM_ECONFIG) {
                skip(); // built without METIS
            }
            assert_int_equal(scene->network.nprocess, strtol(counts[i], NULL, 10));
            pm_scene_free(scene);
        }
    }
}

static void test_bad_processes(void **state) {
    (void)state;
    static const struct {
        const char *section, *error;
    } cases[] = {
        {"[a, b]\n", "t.yaml:9:12: processes: expected a mapping"},
        {"{auto: 6}\n", "t.yaml:9:19: auto: "},
        {"{auto: 0}\n", "t.yaml:9:19: auto: "},
        {"{auto: 2, p: [a]}\n", "expected no other process beside a number of processes"},
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
        cmocka_unit_test(a_chain_is_cut),
        cmocka_unit_test(every_process_gets_a_link),
        cmocka_unit_test(test_bad_processes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
