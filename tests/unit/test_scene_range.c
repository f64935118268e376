// Ranges of a scene: one key stands for many subsystems or ports, whose neighbours are named by
// their indices.
#include <stdio.h>

#include "scene/scene.h"
#include "store/hdf5_io.h"
#include "tests/support/scratch.h"
#include "tests/support/yaml_case.h"

#define HEAD "scene: many\ntime: {dt: 1, steps: 1, integrator: euler}\n"
#define STATE "state: {x: {unit: m, size: 2}, s: {unit: J/K, size: 1}}"

static const char chain[] = HEAD
    "subsystems:\n"
    "  link0: {weights: a.h5, " STATE ", initial: {x: [1, 2], s: 3}}\n"
    "  \"link[1:5]\":\n"
    "    weights: b.h5\n"
    "    state: {x: {unit: m, size: 2, relative_to: \"link[i-1].x\"}, s: {unit: J/K, size: 1}}\n"
    "    initial: {x: [4, 5], s: 6}\n"
    "ports:\n"
    "  \"joint[0:4]\": {law: bracket, between: [\"link[i]\", \"link[i+1]\"], weights: j.h5,\n"
    "    expose: {\"link[i]\": [x, s], \"link[i+1]\": [s]}}\n"
    "record: {parts: [link0, \"link[3:5]\"], every: 10}\n"
    "processes: {left: [\"link[0:2]\", link3], right: [link2, link4]}\n";

static const char grid[] = HEAD
    "subsystems:\n"
    "  \"cell[0:3][0:4]\": {weights: a.h5, state: {x: {unit: m, columns: \"x[i][j]_[0:2]\"}}}\n"
    "ports:\n"
    "  \"right[0:3][0:3]\": {law: bracket, between: [\"cell[i][j]\", \"cell[i][j+1]\"],\n"
    "    weights: j.h5, expose: {\"cell[i][j]\": x, \"cell[i][j+1]\": x}}\n"
    "  \"down[0:2][0:4]\": {law: bracket, between: [\"cell[i][j]\", \"cell[i+1][j]\"],\n"
    "    weights: j.h5, expose: {\"cell[i][j]\": x, \"cell[i+1][j]\": x}}\n";

static pm_scene *parsed(const char *text) {
    pm_scene *scene = NULL;
    if (pm_scene_parse(&scene, text, "t.yaml") != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return scene;
}

static void a_range_makes_a_chain(void **state) {
    (void)state;
    pm_scene *scene = parsed(chain);
    assert_int_equal(scene->physics.nsubsystem, 5);
    assert_int_equal(scene->physics.nport, 4);
    assert_int_equal(scene->physics.nz, 15);
    for (int i = 0; i < 5; ++i) {
        char name[16];
        const pm_scene_subsystem *link = &scene->physics.subsystem[i];
        snprintf(name, sizeof name, "link%d", i);
        assert_string_equal(link->name, name);
        assert_int_equal(pm_scene_find_subsystem(scene, name), i);
        assert_int_equal(link->first, 3 * i);
        assert_int_equal(link->relative_subsystem[0], i - 1);
        assert_true(link->initial[0] == (i == 0 ? 1 : 4));
        assert_string_equal(scene->network.process[link->process].name,
                            i % 2 == 1 || i == 0 ? "left" : "right");
    }
    assert_int_equal(pm_scene_find_subsystem(scene, "link5"), -1);
    assert_int_equal(pm_scene_find_port(scene, "joint3"), 3);
    for (int i = 0; i < 4; ++i) {
        const pm_scene_port *port = &scene->physics.port[i];
        assert_int_equal(port->subsystem[0], i);
        assert_int_equal(port->subsystem[1], i + 1);
        assert_int_equal(port->layout[0].nz, 3);
        assert_int_equal(port->component[1][0], 2);
        // Each inner link has the end b of the port before it, then the end a of the next one.
        assert_int_equal(scene->physics.end_at[scene->physics.first_end[i + 1]], 2 * i + 1);
    }
    assert_int_equal(scene->physics.first_end[5], 8);
    assert_int_equal(scene->run.record_every, 10);
    for (int i = 0; i < 5; ++i) {
        assert_true(pm_scene_records(scene, i) == (i == 0 || i >= 3));
        assert_true(i == 4 || pm_scene_records_port(scene, i) == (i != 1));
    }
    pm_scene_free(scene);
}

static void two_ranges_make_a_grid(void **state) {
    (void)state;
    pm_scene *scene = parsed(grid);
    assert_int_equal(scene->physics.nsubsystem, 12);
    assert_int_equal(scene->physics.nport, 9 + 8);
    assert_string_equal(scene->physics.subsystem[7].name, "cell1_3");
    assert_string_equal(scene->physics.subsystem[7].column[1], "x1_3_1");
    const pm_scene_port *down = &scene->physics.port[pm_scene_find_port(scene, "down1_2")];
    assert_int_equal(down->subsystem[0], 6);
    assert_int_equal(down->subsystem[1], 10);
    pm_scene_free(scene);
}

static void mistakes_name_their_place(void **state) {
    (void)state;
    static const struct {
        const char *from, *to, *expected;
    } cases[] = {
        {"link[1:5]", "link[5:1]", "t.yaml:5:3: subsystems: expected a range NAME[A:B]"},
        {"link[1:5]", "link[1:5]x", "expected a range NAME[A:B]"},
        {"link[1:5]", "link[0:5]", "the name \"link0\" occurs twice"},
        {"link[1:5]", "link[1:2000000]", "more than 1000000"},
        {"joint[0:4]", "joint[0:5]", "there is no subsystem or boundary input \"link5\""},
        {"\"link[i]\", \"link[i+1]\"]", "\"link[i-1]\", \"link[i+1]\"]",
         "[i-1] in \"link[i-1]\" is -1, expected an index >= 0"},
        {"link[3:5]", "link[3:6]", "there is no subsystem \"link5\""},
        {"\"link[i-1].x\"", "\"link[i].x\"", "a cycle"},
        {"[\"link[0:2]\", link3]", "[\"link[0:9]\"]", "there is no subsystem \"link5\""},
        {"[\"link[0:2]\", link3]", "[\"link[0:3]\"]", "\"link2\" has a process already"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        char text[2048];
        const char *at = strstr(chain, cases[i].from);
        assert_non_null(at);
        snprintf(text, sizeof text, "%.*s%s%s", (int)(at - chain), chain, cases[i].to,
                 at + strlen(cases[i].from));
        pm_scene *scene = NULL;
        assert_int_equal(pm_scene_parse(&scene, text, "t.yaml"), PM_ECONFIG);
        if (strstr(pm_error(), cases[i].expected) == NULL) {
            fail_msg("case %zu: \"%s\" does not say \"%s\"", i, pm_error(), cases[i].expected);
        }
    }
}

static void many_parts_are_read(void **state) {
    (void)state;
    static const char text[] =
        HEAD "subsystems:\n"
             "  link0: {weights: a.h5, " STATE "}\n"
             "  \"link[1:100000]\":\n"
             "    weights: b.h5\n"
             "    state: {x: {unit: m, size: 2, relative_to: \"link[i-1].x\"}, s: {unit: J/K, "
             "size: 1}}\n"
             "ports:\n"
             "  \"joint[0:99999]\": {law: bracket, between: [\"link[i]\", \"link[i+1]\"],\n"
             "    weights: j.h5, expose: {\"link[i]\": x, \"link[i+1]\": x}}\n";
    pm_scene *scene = parsed(text);
    assert_int_equal(scene->physics.nsubsystem, 100000);
    assert_int_equal(scene->physics.nport, 99999);
    assert_string_equal(scene->physics.subsystem[99999].name, "link99999");
    assert_int_equal(scene->physics.subsystem[99999].relative_subsystem[0], 99998);
    // What all members of a range have in common is stored once.
    assert_ptr_equal(scene->physics.subsystem[99999].layout.group,
                     scene->physics.subsystem[1].layout.group);
    assert_ptr_equal(scene->physics.port[99998].layout[1].group,
                     scene->physics.port[1].layout[1].group);
    assert_ptr_not_equal(scene->physics.subsystem[0].layout.group,
                         scene->physics.subsystem[1].layout.group);
    pm_scene_free(scene);
}

// --- ports from a table ---

static const char network[] =
    HEAD "subsystems:\n"
         "  \"node[0:4]\": {weights: a.h5, state: {x: {unit: m, size: 2}}}\n"
         "ports:\n"
         "  \"edge[1:4]\": {law: bracket, table: {file: table.h5, dataset: edges}, weights: j.h5,\n"
         "    between: [\"node[a]\", \"node[b]\"], expose: {\"node[a]\": x, \"node[b]\": x}}\n"
         "  last: {law: bracket, between: [node0, node2], weights: j.h5,\n"
         "    expose: {node0: x, node2: x}}\n";

static void write_edges(const char *path, const double edges[6]) {
    const int extent[2] = {3, 2};
    pm_hdf5 *file = NULL;
    assert_int_equal(pm_hdf5_create(&file, path, PM_HDF5_ATOMIC), PM_OK);
    assert_int_equal(pm_hdf5_write(file, "edges", 2, extent, edges), PM_OK);
    assert_int_equal(pm_hdf5_commit(file), PM_OK);
    pm_hdf5_close(file);
}

static void a_table_makes_a_network(void **state) {
    static const double edges[6] = {3, 0, 1, 3, 2, 1};
    write_edges(scratch_path(*state, "table.h5"), edges);
    pm_scene *scene = NULL;
    if (pm_scene_parse(&scene, network, scratch_path(*state, "t.yaml")) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    assert_int_equal(scene->physics.nport, 4);
    for (int i = 0; i < 6; ++i) {
        assert_int_equal(scene->physics.port[i / 2].subsystem[i % 2], (int)edges[i]);
    }
    assert_string_equal(scene->physics.port[2].name, "edge3");
    assert_string_equal(scene->physics.port[3].name, "last");
    assert_int_equal(scene->physics.port[3].subsystem[1], 2);
    pm_scene_free(scene);
}

static void mistakes_in_tables_are_named(void **state) {
    static const struct {
        const char *from, *to;
        double wrong; // the number in row 1
        pm_status code;
        const char *expected;
    } cases[] = {
        {"edge[1:4]", "edge[1:4]", 1.5, PM_EDATA, "row 1 has 1.5, expected a whole number >= 0"},
        {"edge[1:4]", "edge[1:4]", -1, PM_EDATA, "row 1 has -1, expected a whole number >= 0"},
        {"edge[1:4]", "edge[1:4]", 7, PM_ECONFIG, "or boundary input \"node7\""},
        {"edge[1:4]", "edge[1:4]", 3, PM_ECONFIG, "found \"node3\" twice"},
        {"edge[1:4]", "edge[1:5]", 1, PM_EDATA, "dimension 1 is 3, expected 4"},
        {"\"edge[1:4]\"", "edge", 1, PM_ECONFIG, "a table needs a range of ports"},
        {"dataset: edges", "dataset: edge", 1, PM_EDATA, "dataset edge is missing"},
        {"file: table.h5, ", "", 1, PM_ECONFIG, "file"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; ++i) {
        char text[1024];
        pm_scene *scene = NULL;
        write_edges(scratch_path(*state, "table.h5"), (double[6]){3, 0, cases[i].wrong, 3, 2, 1});
        const char *at = strstr(network, cases[i].from);
        assert_non_null(at);
        snprintf(text, sizeof text, "%.*s%s%s", (int)(at - network), network, cases[i].to,
                 at + strlen(cases[i].from));
        assert_int_equal(pm_scene_parse(&scene, text, scratch_path(*state, "t.yaml")),
                         cases[i].code);
        if (strstr(pm_error(), cases[i].expected) == NULL) {
            fail_msg("case %zu: \"%s\" does not say \"%s\"", i, pm_error(), cases[i].expected);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_table_makes_a_network, scratch_setup, scratch_teardown),
        cmocka_unit_test_setup_teardown(mistakes_in_tables_are_named, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test(a_range_makes_a_chain),
        cmocka_unit_test(two_ranges_make_a_grid),
        cmocka_unit_test(mistakes_name_their_place),
        cmocka_unit_test(many_parts_are_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
