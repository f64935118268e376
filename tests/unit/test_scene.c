// Scenes: the reader returns what the file says, and errors name the place of a mistake.
#include <dirent.h>
#include <math.h>

#include "scene/scene.h"
#include "tests/support/scratch.h"
#include "tests/support/yaml_case.h"

#define GOOD_URL "\"udpm://239.255.76.67:7667?ttl=1\""

static const char good[] = "scene: pair\n"
                           "url: " GOOD_URL "\n"
                           "time: {dt: 0.3, steps: 200, integrator: rk4, substeps: 8}\n"
                           "subsystems:\n"
                           "  upper:\n"
                           "    weights: w/upper.h5\n"
                           "    state:\n"
                           "      q: {unit: m, columns: [q1x, q1y]}\n"
                           "      p: {unit: kg m/s, columns: [p1x, p1y]}\n"
                           "      s: {unit: J/K, columns: s1}\n"
                           "  lower:\n"
                           "    weights: /abs/lower.h5\n"
                           "    state:\n"
                           "      q: {unit: m, columns: [q2x, q2y], relative_to: upper.q}\n"
                           "      s: {unit: J/K, columns: [s2]}\n"
                           "    initial: {q: [1, -2], s: 0.5}\n"
                           "ports:\n"
                           "  joint:\n"
                           "    law: bracket\n"
                           "    between: [lower, upper]\n"
                           "    expose: {upper: [s, q], lower: [q, s]}\n"
                           "    weights: w/joint.h5\n"
                           "reference: {file: ref.h5, trajectory: 3}\n"
                           "laws: {energy: 1.0e-11, entropy: 0}\n"
                           "guards: {energy_drift: 0.01, training_range: 0.5}\n"
                           "lockstep: {window: 4, patience: 2.5, checkpoint: 30}\n"
                           "record: {on_error: go_on}\n"
                           "key_file: pair.key\n";

static const char minimal[] = "scene: one\n"
                              "time: {dt: 1, steps: 1, integrator: euler}\n"
                              "subsystems: {a: {weights: a.h5, state: {x: {unit: m, size: 3}}}}\n";

static pm_scene *parsed(const char *text) {
    pm_scene *scene = NULL;
    if (pm_scene_parse(&scene, text, "dir/t.yaml") != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return scene;
}

static void test_settings(void **state) {
    (void)state;
    pm_scene *scene = parsed(good);
    assert_string_equal(scene->name, "pair");
    assert_string_equal(scene->path, "dir/t.yaml");
    assert_string_equal(scene->network.url, "udpm://239.255.76.67:7667?ttl=1");
    assert_true(scene->physics.dt == 0.3);
    assert_int_equal(scene->run.steps, 200);
    assert_string_equal(scene->physics.integrator->name, "rk4");
    assert_string_equal(scene->physics.integrator_at, "dir/t.yaml:3:41");
    assert_int_equal(scene->physics.substeps, 8);
    assert_string_equal(scene->run.reference, "dir/ref.h5");
    assert_string_equal(scene->run.reference_at, "dir/t.yaml:23:19");
    assert_int_equal(scene->run.reference_trajectory, 3);
    assert_string_equal(scene->run.reference_trajectory_at, "dir/t.yaml:23:39");
    assert_true(scene->run.energy_tolerance == 1e-11 && scene->run.entropy_tolerance == 0);
    assert_true(scene->run.largest_drift == 0.01 && scene->run.largest_departure == 0.5);
    assert_true(scene->network.window == 4 && scene->network.patience == 2.5 &&
                scene->network.checkpoint == 30);
    assert_string_equal(scene->network.key_file, "dir/pair.key");
    assert_string_equal(scene->network.key_file_at, "dir/t.yaml:28:11");
    assert_true(scene->run.outlives_recording);
    pm_scene_free(scene);
}

static void test_subsystems(void **state) {
    (void)state;
    pm_scene *scene = parsed(good);
    assert_int_equal(scene->physics.nsubsystem, 2);
    assert_int_equal(scene->physics.nz, 8);
    const pm_scene_subsystem *upper = &scene->physics.subsystem[0],
                             *lower = &scene->physics.subsystem[1];
    assert_string_equal(upper->name, "upper");
    assert_string_equal(upper->weights, "dir/w/upper.h5");
    assert_string_equal(lower->weights, "/abs/lower.h5");
    assert_string_equal(upper->at, "dir/t.yaml:5:3");
    assert_string_equal(upper->weights_at, "dir/t.yaml:6:14");
    assert_string_equal(upper->group_at[2], "dir/t.yaml:10:7");
    assert_string_equal(upper->column_at[3], "dir/t.yaml:9:40");
    assert_string_equal(upper->column_at[4], "dir/t.yaml:10:31");
    assert_true(upper->first == 0 && upper->layout.nz == 5 && upper->layout.ngroup == 3);
    assert_true(lower->first == 5 && lower->layout.nz == 3 && lower->layout.ngroup == 2);
    assert_string_equal(upper->layout.group[1].name, "p");
    assert_string_equal(upper->layout.group[1].unit, "kg m/s");
    assert_true(upper->layout.group[1].size == 2 && upper->layout.group[1].first == 2);
    const char *const columns[] = {"q1x", "q1y", "p1x", "p1y", "s1"};
    for (int i = 0; i < 5; ++i) {
        assert_string_equal(upper->column[i], columns[i]);
    }
    assert_true(lower->relative_subsystem[0] == 0 && lower->relative_group[0] == 0);
    assert_true(lower->relative_subsystem[1] == -1 && upper->relative_subsystem[0] == -1);
    assert_null(upper->initial);
    assert_true(lower->initial[0] == 1 && lower->initial[1] == -2 && lower->initial[2] == 0.5);
    assert_int_equal(pm_scene_find_subsystem(scene, "lower"), 1);
    assert_int_equal(pm_scene_find_subsystem(scene, "joint"), -1);
    pm_scene_free(scene);
}

static void groups_may_be_hidden(void **state) {
    (void)state;
    static const char text[] =
        "scene: one\n"
        "time: {dt: 1, steps: 1, integrator: euler}\n"
        "subsystems: {a: {weights: a.h5, state: {x: {unit: m, columns: [x0, x1, x2]}%s}}}\n";
    char whole[512];
    pm_scene *scene = parsed(good);
    assert_false(pm_scene_hides(scene));
    pm_scene_free(scene);
    for (int k = 0; k < 2; ++k) {
        snprintf(whole, sizeof whole, text,
                 k == 0 ? "" : ", s: {unit: J/K, hidden: {guess: 1, deviation: 2}}");
        scene = parsed(whole);
        assert_int_equal(pm_scene_hides(scene), k);
        pm_scene_free(scene);
    }
}

static void ranges_stand_for_their_columns(void **state) {
    (void)state;
    pm_scene *scene = parsed("scene: one\n"
                             "time: {dt: 1, steps: 1, integrator: euler}\n"
                             "subsystems:\n"
                             "  a:\n"
                             "    weights: a.h5\n"
                             "    state:\n"
                             "      x: {unit: m, columns: \"x[0:3]\"}\n"
                             "      y: {unit: m, columns: [y, \"y_[9:11]\", \"y[0]\"]}\n"
                             "boundary_inputs: {hand: {f: {unit: N, dE: [0.5, \"f[1:3]\"]}}}\n");
    static const char *const columns[] = {"x0", "x1", "x2", "y", "y_9", "y_10", "y[0]"};
    const pm_scene_subsystem *a = &scene->physics.subsystem[0];
    assert_int_equal(a->layout.nz, 7);
    for (int i = 0; i < 7; ++i) {
        assert_string_equal(a->column[i], columns[i]);
    }
    assert_int_equal(a->layout.group[1].size, 4);
    assert_string_equal(a->column_at[0], "dir/t.yaml:7:29");
    assert_string_equal(a->column_at[2], "dir/t.yaml:7:29");
    assert_string_equal(a->column_at[5], "dir/t.yaml:8:33");
    const pm_scene_prescribed *dE = scene->physics.boundary_input[0].value + 3;
    assert_int_equal(scene->physics.boundary_input[0].layout.nz, 3);
    assert_true(dE[0].column == NULL && dE[0].number == 0.5);
    assert_string_equal(dE[1].column, "f1");
    assert_string_equal(dE[2].column, "f2");
    assert_string_equal(dE[2].at, "dir/t.yaml:9:49");
    pm_scene_free(scene);
}

// Thousands of ranges of 100,000 columns each are a short text.
static void ranges_do_not_exhaust_memory(void **state) {
    (void)state;
    char *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    fputs("scene: big\ntime: {dt: 1, steps: 1, integrator: euler}\nsubsystems:\n", file);
    for (int i = 0; i < 20; ++i) {
        fprintf(file, "  s%d: {weights: w, state: {x: {unit: m, columns: \"c%d_[0:100000]\"}}}\n",
                i, i);
    }
    fclose(file);
    pm_scene *scene = NULL;
    assert_int_equal(pm_scene_parse(&scene, text, "t.yaml"), PM_ECONFIG);
    assert_string_equal(pm_error(), "t.yaml:14:51: columns: more than 1000000 columns in all");
    free(text);
}

static void test_ports(void **state) {
    (void)state;
    pm_scene *scene = parsed(good);
    assert_int_equal(scene->physics.nport, 1);
    const pm_scene_port *port = &scene->physics.port[0];
    assert_int_equal(pm_scene_find_port(scene, "joint"), 0);
    assert_int_equal(pm_scene_find_port(scene, "upper"), -1);
    assert_string_equal(port->law, "bracket");
    assert_string_equal(port->law_at, "dir/t.yaml:19:10");
    assert_string_equal(port->weights, "dir/w/joint.h5");
    assert_string_equal(port->weights_at, "dir/t.yaml:22:14");
    assert_string_equal(port->expose_at[0], "dir/t.yaml:21:36");
    assert_string_equal(port->expose_at[1], "dir/t.yaml:21:21");
    assert_true(port->subsystem[0] == 1 && port->subsystem[1] == 0);
    // End b exposes [s, q] of the state q p s: components 4, then 0 and 1.
    const int a[] = {0, 1, 2}, b[] = {4, 0, 1};
    assert_true(port->layout[0].nz == 3 && port->layout[1].nz == 3);
    assert_memory_equal(port->component[0], a, sizeof a);
    assert_memory_equal(port->component[1], b, sizeof b);
    assert_string_equal(port->layout[1].group[1].name, "q");
    assert_int_equal(port->layout[1].group[1].first, 1);
    pm_scene_free(scene);
}

static void test_defaults(void **state) {
    (void)state;
    pm_scene *scene = parsed(minimal);
    assert_null(scene->network.url);
    assert_true(scene->physics.substeps == 1 && scene->network.window == 1 &&
                scene->network.patience == 10 && scene->network.checkpoint == 100);
    assert_true(scene->run.energy_tolerance == 1e-12 && scene->run.entropy_tolerance == 1e-12);
    assert_true(isinf(scene->run.largest_drift) && isinf(scene->run.largest_departure));
    assert_true(scene->physics.nport == 0 && scene->physics.nz == 3 &&
                scene->run.reference == NULL);
    assert_null(scene->network.key_file);
    assert_null(scene->physics.subsystem[0].column);
    pm_scene_free(scene);
    // A path without a folder leaves relative paths as they are.
    assert_int_equal(pm_scene_parse(&scene, minimal, "t.yaml"), PM_OK);
    assert_string_equal(scene->physics.subsystem[0].weights, "a.h5");
    pm_scene_free(scene);
}

#define NAME48 "abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuv"

static const yaml_case bad[] = {
    // keys and settings
    {"scene: pair\n", "", "url", "missing key \"scene\""},
    {"scene: pair", "scene: a-b", "a-b", "scene: expected a name of a letter"},
    {"scene: pair", "scene: " NAME48 "w", "abc", "at most 48"},
    {"scene: pair\n", "scene: pair\nsystem: a\\b\n", "a\\b", "system: expected 1 to 80 printable"},
    {"url:", "uri:", "uri",
     "unknown key \"uri\"; allowed: scene, url, key_file, time, subsystems, boundary_inputs"},
    // time, laws and the rest
    {"dt: 0.3", "dt: -0.3", "-0.3", "dt: expected a number > 0, found \"-0.3\""},
    {"dt: 0.3", "dt: fast", "fast", "dt: expected a number > 0, found \"fast\""},
    {"steps: 200", "steps: 0", "0", "steps: expected a whole number >= 1"},
    {"{dt: 0.3, ", "{", "{", "time: missing key \"dt\""},
    {"integrator: rk4", "integrator: [rk4]", "[rk4]", "integrator: expected text, found a list"},
    {"substeps: 8", "tolerance: 0", "0", "tolerance: expected a number > 0"},
    {"substeps: 8", "tolerance: 0.01", "0.01", "tolerance: each step tells how long the next"},
    {"substeps: 8", "substep: 8", "substep", "time: unknown key \"substep\"; allowed: dt, steps"},
    {"{energy: 1.0e-11", "{energy: -1", "-1", "energy: expected a number >= 0"},
    {"energy_drift: 0.01", "energy_drift: 0", "0", "energy_drift: expected a number > 0"},
    {"window: 4", "window: 0", "0", "window: expected a whole number >= 1"},
    {"patience: 2.5", "patience: 0", "0", "patience: expected a number > 0"},
    {"on_error: go_on", "on_error: wait", "wait", "on_error: expected one of stop, go_on"},
    {"on_error: go_on", "at_error: go_on", "at_error", "record: unknown key \"at_error\""},
    {"checkpoint: 30", "checkpoint: 0", "0", "checkpoint: expected a whole number >= 1"},
    {"trajectory: 3", "trajectory: -1", "-1", "trajectory: expected a whole number >= 0"},
    {"file: ref.h5", "path: ref.h5", "path", "unknown key \"path\"; allowed: file, trajectory"},
    // subsystems
    {"  lower:", "  upper:", "upper", "duplicate key \"upper\""},
    {"  lower:", "  2nd:", "2nd", "expected a name of a letter"},
    {"weights: w/upper.h5", "weight: w/upper.h5", "weight", "unknown key \"weight\"; allowed"},
    {"weights: w/upper.h5", "model: m", "m\n", "model: there is no model \"m\" under models"},
    {"weights: w/upper.h5", "weights: w/upper.h5\n    model: m", "weights",
     "upper: expected either \"weights\", a file, or \"model\", a name"},
    {"weights: w/upper.h5", "weights: w/upper.h5\n    constants: {m: 1}", "{m: 1}",
     "constants: only a model has constants"},
    {"      q: {unit: m, columns: [q1x", "      q: {columns: [q1x", "{", "q: missing key \"unit\""},
    {"unit: J/K, columns: s1", "unit: J;K, columns: s1", "J;K",
     "unit: expected a unit without ';'"},
    {"columns: [q1x, q1y]", "columns: []", "[]", "expected 1 to"},
    {"columns: [q1x, q1y]", "columns: {}", "{}", "columns: expected text, found a mapping"},
    {"columns: [q1x, q1y]", "columns: [x, \"q[2:2]\"]", "\"q[2",
     "columns: expected a range PREFIX[A:B] with A < B, such as f[0:3] for f0, f1 and f2, found "
     "\"q[2:2]\""},
    {"columns: [q1x, q1y]", "columns: \"q[0:100001]\"", "\"q[", "expected 1 to 100000 components"},
    {"columns: [q1x, q1y]", "columns: [\"q[0:99999]\", x, y]", "y]", "1 to 100000 components"},
    {"columns: [q1x, q1y]", "columns: [\"q[0:3]\", \"q[2:5]\"]", "\"q[2:5",
     "columns: dataset column \"q2\" occurs twice"},
    {"columns: [q1x, q1y]", "columns: [q1x, q1x]", "q1x]", "dataset column \"q1x\" occurs twice"},
    {"columns: [s2]", "columns: [s1]", "s1]", "dataset column \"s1\" occurs twice"},
    {"{unit: J/K, columns: s1}", "{unit: J/K}", "{",
     "either \"columns\" (of a dataset) or \"size\""},
    {"{unit: J/K, columns: s1}", "{unit: J/K, size: 1}", "{",
     "expected \"columns\" as in the groups"},
    {"{unit: J/K, columns: [s2]}", "{unit: J/K, size: 1}", "{", "expected \"columns\" as in the"},
    {"columns: s1}", "size: 0}", "0", "size: expected a whole number >= 1"},
    {"initial: {q: [1, -2], s: 0.5}", "initial: {q: [1], s: 0.5}", "[1]",
     "expected 2 numbers, found 1"},
    {"initial: {q: [1, -2], s: 0.5}", "initial: {q: [1, 2]}", "{", "initial: missing key \"s\""},
    {"initial: {q: [1, -2], s: 0.5}", "initial: {q: [1, 2], v: 1}", "v", "allowed: q, s"},
    // relative_to
    {"relative_to: upper.q", "relative_to: upper", "upper", "expected SUBSYSTEM.GROUP"},
    {"relative_to: upper.q", "relative_to: middle.q", "middle", "subsystems: upper, lower"},
    {"relative_to: upper.q", "relative_to: upper.x", "upper.x", "no group \"x\"; groups: q, p, s"},
    {"relative_to: upper.q", "relative_to: upper.s", "upper.s",
     "1 components in J/K, expected 2 in m"},
    {"relative_to: upper.q", "relative_to: upper.p", "upper.p",
     "2 components in kg m/s, expected 2"},
    {"relative_to: upper.q", "relative_to: lower.q", "lower.q", "relative_to: a cycle"},
    {"columns: [q1x, q1y]", "columns: [q1x, q1y], relative_to: lower.q", "lower.q", "a cycle"},
    // ports
    {"law: bracket", "law: gravity", "gravity", "law: expected one of bracket, exchange"},
    {"    law: bracket\n", "", "between", "joint: missing key \"law\""},
    {"[lower, upper]", "[lower, uper]", "uper",
     "no subsystem or boundary input \"uper\"; there are: upper, lower"},
    {"[lower, upper]", "[lower, lower]", "[lower",
     "expected two different subsystems, found \"lower\""},
    {"[lower, upper]", "[lower]", "[lower]", "expected two subsystems [a, b], found 1"},
    {"[lower, upper]", "lower", "lower", "expected two subsystems [a, b], found 1"},
    {"{upper: [s, q], lower", "{upper: [s, x], lower", "x",
     "upper has no group \"x\"; groups: q, p, s"},
    {"{upper: [s, q], lower", "{upper: [s, s], lower", "s]", "group \"s\" occurs twice"},
    {"{upper: [s, q], lower", "{upper: [], lower", "[]", "expected at least one group of upper"},
    {"{upper: [s, q], lower", "{lower", "{lower", "expose: missing key \"upper\""},
    {"{upper: [s, q], lower", "{other: s, upper: [s, q], lower", "other", "allowed: lower, upper"},
    {"    law: bracket\n    between: [lower, upper]\n    expose: {upper: [s, q], lower: [q, s]}\n  "
     "  weights: w/joint.h5\n",
     "    law: bracket\n    between: [lower, upper]\n    expose: {upper: q, lower: q}\n", "law",
     "joint: expected either \"weights\", a file, or \"model\""},
    {"ports:\n", "ports:\n  joint: 1\n", "joint:\n", "ports: duplicate key \"joint\""},
};

static const yaml_case bad_minimal[] = {
    {"{a: {weights: a.h5, state: {x: {unit: m, size: 3}}}}", "{}", "{}", "at least one entry"},
    {"{a: {weights: a.h5, state: {x: {unit: m, size: 3}}}}", "[a]", "[a]", "found a list"},
    {"{x: {unit: m, size: 3}}", "{}", "{}", "state: expected a mapping with at least one entry"},
    {"{x: {unit: m, size: 3}}", "3", "3", "state: expected a mapping with at least one entry"},
    {"size: 3", "size: 1000000000", "1000000000", "size: expected a whole number >= 1 and <= "},
    {"{a:", "{" NAME48 "w:", "abc", "at most 48"},
};

// A link whose other ends are the random_system's.
static const char driven[] = "scene: driven\n"
                             "time: {dt: 1, steps: 1, integrator: euler}\n"
                             "subsystems: {a: {weights: a.h5, state: {q: {unit: m, size: 2},\n"
                             "    s: {unit: J/K, size: 1}}}}\n"
                             "boundary_inputs:\n"
                             "  pivot:\n"
                             "    p: {unit: kg m/s, dE: [vx, -0.5]}\n"
                             "    s: {unit: J/K, value: [.25], dE: T, dS: 1}\n"
                             "  hand: {x: {unit: m, dE: [1e3]}}\n"
                             "ports:\n"
                             "  base:\n"
                             "    law: bracket\n"
                             "    between: [pivot, a]\n"
                             "    expose: {pivot: [s, p], a: [q, s]}\n"
                             "    weights: base.h5\n";

static const yaml_case bad_driven[] = {
    {"  pivot:\n", "  a:\n", "a:\n    p", "\"a\" is the name of a subsystem already"},
    {"  pivot:\n", "  7:\n", "7:\n    p", "expected a name of a letter"},
    {"hand: {x: {unit: m, dE: [1e3]}}", "hand: {}", "{}", "at least one entry"},
    {"dE: [1e3]", "dE: []", "[]", "dE: expected 1 to 100000 components, found 0"},
    {"dE: [1e3]", "dE: \"f[0:x]\"", "\"f[0:x", "dE: expected a range PREFIX[A:B]"},
    {"dE: [1e3]", "dE: \"f[0:3]\", dS: [1, 2]", "[1, 2]", "expected 3 as under \"dE\", found 2"},
    {"dE: [1e3]", "dE: 1x", "1x", "dE: expected a number, found \"1x\""},
    {"dE: [1e3]", "dE: [1e3], columns: [x]", "columns", "allowed: unit, dE, dS, value"},
    {"x: {unit: m, dE: [1e3]}", "x: {unit: m, dS: [1e3]}", "{unit: m", "x: missing key \"dE\""},
    {"x: {unit: m, dE", "x: {dE", "{dE", "x: missing key \"unit\""},
    {"dS: 1}", "dS: [1, 0]}", "[1, 0]", "dS: expected 1 as under \"dE\", found 2"},
    {"[pivot, a]", "[pivot, hand]", "[pivot, hand]",
     "a subsystem at one end, found two boundary inputs"},
    {"[pivot, a]", "[pivo, a]", "pivo, a",
     "no subsystem or boundary input \"pivo\"; there are: a, pivot, hand"},
    {"pivot: [s, p]", "pivot: [s, q]", "q], a", "pivot has no group \"q\"; groups: p, s"},
    {"pivot: [s, p]", "hand: [x]", "hand", "allowed: pivot, a"},
};

static void test_loads(void **state) {
    (void)state;
    pm_scene *scene = parsed(driven);
    assert_int_equal(scene->physics.nboundary_input, 2);
    assert_int_equal(scene->physics.nprescribed, 12);
    const pm_scene_boundary_input *pivot = &scene->physics.boundary_input[0],
                                  *hand = &scene->physics.boundary_input[1];
    assert_true(pivot->first == 0 && pivot->layout.nz == 3 && pivot->layout.ngroup == 2);
    assert_true(hand->first == 9 && hand->layout.nz == 1);
    assert_true(pivot->entropy && !hand->entropy);
    // State, dE, dS of px, py, s.
    static const double number[9] = {0, 0, 0.25, 0, -0.5, 0, 0, 0, 1};
    for (int i = 0; i < 9; ++i) {
        assert_true(pivot->value[i].number == number[i]);
        assert_true((pivot->value[i].column != NULL) == (i == 3 || i == 5));
    }
    assert_string_equal(pivot->value[3].column, "vx");
    assert_string_equal(pivot->value[3].at, "dir/t.yaml:7:28");
    assert_string_equal(pivot->value[5].column, "T");
    assert_true(hand->value[1].number == 1e3);
    const pm_scene_port *port = &scene->physics.port[0];
    assert_true(port->subsystem[0] == -1 && port->boundary_input[0] == 0);
    assert_true(port->subsystem[1] == 0 && port->boundary_input[1] == -1);
    assert_string_equal(pm_scene_end_name(scene, port, 0), "pivot");
    assert_string_equal(pm_scene_end_name(scene, port, 1), "a");
    assert_int_equal(port->component[0][0], 2);
    assert_int_equal(port->component[0][1], 0);
    assert_int_equal(pm_scene_find_boundary_input(scene, "hand"), 1);
    assert_int_equal(pm_scene_find_boundary_input(scene, "a"), -1);
    pm_scene_free(scene);
}

// A model serves several components, each with constants of its own.
static void test_models(void **state) {
    (void)state;
    static const char text[] =
        "scene: x\n"
        "time: {dt: 1, steps: 1, integrator: rk4}\n"
        "models:\n"
        "  mass: {energy: \"|p|^2/(2*m) + k\", constants: {m: 1, k: 2}}\n"
        "  joint: {law: bracket, reversible: {given: [[a.p, b.p, w]]}}\n"
        "subsystems:\n"
        "  a: {model: mass, state: {p: {unit: kg m/s, size: 2}}}\n"
        "  b: {model: mass, constants: {m: 3}, state: {p: {unit: kg m/s, size: 2}}}\n"
        "ports:\n"
        "  j: {law: bracket, between: [a, b], expose: {a: p, b: p}, model: joint, constants: {w: "
        "4}}\n";
    pm_scene *scene = NULL;
    if (pm_scene_parse(&scene, text, "dir/t.yaml") != PM_OK) {
        fail_msg("%s", pm_error());
    }
    const double m[] = {1, 3};
    for (int i = 0; i < 2; ++i) {
        const pm_scene_subsystem *subsystem = &scene->physics.subsystem[i];
        const pm_constants *constants = subsystem->model->constants;
        assert_null(subsystem->weights);
        assert_string_equal(subsystem->weights_at, i == 0 ? "dir/t.yaml:7:14" : "dir/t.yaml:8:14");
        assert_int_equal(constants->count, 2);
        assert_string_equal(constants->name[0], "m");
        assert_true(constants->value[0] == m[i] && constants->value[1] == 2);
    }
    assert_string_equal(scene->physics.port[0].model->reversible.given[0].formula.text, "w");
    assert_true(scene->physics.port[0].model->constants->value[0] == 4);
    pm_scene_free(scene);
}

static int failures_of(const char *text, const yaml_case *cases, size_t count) {
    int failures = 0;
    for (size_t i = 0; i < count; ++i) {
        char *edited = yaml_case_text(text, &cases[i]);
        pm_scene *scene = NULL;
        const pm_status status = pm_scene_parse(&scene, edited, "dir/t.yaml");
        free(edited);
        failures += !yaml_case_holds("dir/t.yaml", text, &cases[i], status);
        assert_null(scene);
    }
    return failures;
}

static void test_bad(void **state) {
    (void)state;
    const size_t count = sizeof bad / sizeof *bad;
    const size_t count_minimal = sizeof bad_minimal / sizeof *bad_minimal;
    assert_int_equal(failures_of(good, bad, count), 0);
    const size_t count_driven = sizeof bad_driven / sizeof *bad_driven;
    assert_int_equal(failures_of(minimal, bad_minimal, count_minimal), 0);
    assert_int_equal(failures_of(driven, bad_driven, count_driven), 0);
}

// A state of more groups than a layout holds.
static void test_many_groups(void **state) {
    (void)state;
    char text[4096], *end = text;
    end += sprintf(end, "scene: x\ntime: {dt: 1, steps: 1, integrator: euler}\n"
                        "subsystems:\n  a:\n    weights: a.h5\n    state:\n");
    for (int i = 0; i <= PM_MAX_GROUPS; ++i) {
        end += sprintf(end, "      g%d: {unit: m, size: 1}\n", i);
    }
    pm_scene *scene = NULL;
    assert_int_equal(pm_scene_parse(&scene, text, "t.yaml"), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "t.yaml:7:7: state: "));
    *strstr(text, "      g1:") = '\0';
    assert_int_equal(pm_scene_parse(&scene, text, "t.yaml"), PM_OK);
    pm_scene_free(scene);
}

// Every scene that is shipped reads.
static void test_shipped(void **state) {
    (void)state;
    int count = 0;
    DIR *folder = opendir("configs");
    assert_non_null(folder);
    for (struct dirent *entry; (entry = readdir(folder)) != NULL;) {
        if (strstr(entry->d_name, ".yaml") != NULL) {
            char path[512];
            snprintf(path, sizeof path, "configs/%s", entry->d_name);
            pm_scene *scene = NULL;
            if (pm_scene_load(&scene, path) != PM_OK) {
                fail_msg("%s", pm_error());
            }
            const pm_scene_subsystem *first = &scene->physics.subsystem[0];
            assert_true(first->model != NULL ||
                        strncmp(first->weights, "configs/weights/", 16) == 0);
            pm_scene_free(scene);
            ++count;
        }
    }
    closedir(folder);
    assert_true(count >= 4);
    pm_scene *scene = NULL;
    assert_int_equal(pm_scene_load(&scene, "configs/absent.yaml"), PM_EFILE);
    assert_null(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_settings),
        cmocka_unit_test(test_subsystems),
        cmocka_unit_test(groups_may_be_hidden),
        cmocka_unit_test(ranges_stand_for_their_columns),
        cmocka_unit_test(ranges_do_not_exhaust_memory),
        cmocka_unit_test(test_ports),
        cmocka_unit_test(test_loads),
        cmocka_unit_test(test_models),
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_bad),
        cmocka_unit_test(test_many_groups),
        cmocka_unit_test(test_shipped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
