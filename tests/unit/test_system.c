// A scene with its weights: weights that fit are loaded; others are refused, and the message names
// them.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "model/training_range.h"
#include "scene/model_reader.h"
#include "scene/system.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

static const char good[] =
    "scene: pair\n"
    "time: {dt: 0.3, steps: 200, integrator: rk4, substeps: 8}\n"
    "subsystems:\n"
    "  upper: {weights: upper.h5, state: {p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n"
    "  lower: {weights: upper.h5, state: {p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  joint: {law: bracket, between: [upper, lower], expose: {upper: s, lower: s},\n"
    "          weights: joint.h5}\n";

// This scene has known models alone.
static const char known[] =
    "scene: pair\n"
    "time: {dt: 0.3, steps: 200, integrator: rk4, substeps: 8}\n"
    "models:\n"
    "  mass: {energy: [\"|p|^2/(2*m)\", \"c*exp(s/c)\"], entropy: s, constants: {m: 1, c: 2}}\n"
    "  heat: {law: bracket, irreversible: {given: [[a.s, b.s, 0.5]]}}\n"
    "subsystems:\n"
    "  upper: {model: mass, state: {p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n"
    "  lower: {model: mass, constants: {m: 3},\n"
    "          state: {p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}}\n"
    "ports:\n"
    "  joint: {law: bracket, between: [upper, lower], expose: {upper: s, lower: s}, model: heat}\n";

// The text with `from` replaced by `to`, as a scene in the folder.
static pm_scene *edited_from(const char *whole, scratch *folder, const char *from, const char *to) {
    char text[2048];
    const char *place = strstr(whole, from);
    assert_non_null(place);
    snprintf(text, sizeof text, "%.*s%s%s", (int)(place - whole), whole, to, place + strlen(from));
    pm_scene *scene = NULL;
    if (pm_scene_parse(&scene, text, scratch_path(folder, "t.yaml")) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return scene;
}

static pm_scene *edited(scratch *folder, const char *from, const char *to) {
    return edited_from(good, folder, from, to);
}

// Of what is saved next.
static const char *part_coordinates, *port_coordinates, *part_integrator, *part_fit, *port_fit;
static const char *port_system;
static bool ranged; // the part has a training range: p from 1 to 2 kg m/s, s from 3 to 4 J/K

static void save_part(pm_part *part, pm_arena *arena, const char *path) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    const pm_provenance provenance = {.command = "test",
                                      .data = "",
                                      .coordinates = part_coordinates,
                                      .integrator = part_integrator,
                                      .fit = part_fit,
                                      .step = 0.0375};
    assert_int_equal(pm_yaml_parse(&document,
                                   "energy: {features: [\"|p|^2\", s], skip: linear}\n"
                                   "entropy: {given: s}\n",
                                   "model", &root),
                     PM_OK);
    assert_int_equal(pm_part_spec_read(root, (pm_yaml){0}, arena, &part->spec), PM_OK);
    pm_yaml_close(document);
    assert_int_equal(pm_part_declare(part), PM_OK);
    if (ranged) {
        assert_int_equal(pm_training_range_declare(part), PM_OK);
        pm_training_range_widen(part, (const double[]){1, 0, 3});
        pm_training_range_widen(part, (const double[]){0, 2, 4});
    }
    assert_int_equal(pm_weights_save(path, pm_component_of_part(part), &provenance), PM_OK);
}

static void save_port(pm_port_model *port, pm_arena *arena, const char *path) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    const pm_provenance provenance = {.command = "test",
                                      .data = "",
                                      .coordinates = port_coordinates,
                                      .fit = port_fit,
                                      .system = port_system};
    assert_int_equal(pm_yaml_parse(&document,
                                   "law: bracket\n"
                                   "irreversible: {learned: {acts_on: [a.s, b.s]}}\n",
                                   "model", &root),
                     PM_OK);
    assert_int_equal(pm_port_spec_read(root, (pm_yaml){0}, arena, &port->spec), PM_OK);
    pm_yaml_close(document);
    assert_int_equal(pm_port_declare(port), PM_OK);
    assert_int_equal(pm_weights_save(path, pm_component_of_port(port), &provenance), PM_OK);
}

static void save_weights(scratch *folder) {
    pm_scene *scene = edited(folder, "pair", "pair");
    pm_system *system = NULL;
    assert_int_equal(pm_system_new(&system, scene), PM_OK);
    save_part(system->part[0], &system->arena, scene->physics.subsystem[0].weights);
    save_port(system->port[0], &system->arena, scene->physics.port[0].weights);
    pm_system_free(system);
    pm_scene_free(scene);
}

// Weights of which nothing is recorded.
static int plain(void **state) {
    part_coordinates = port_coordinates = part_integrator = part_fit = port_fit = NULL;
    port_system = NULL;
    ranged = false;
    save_weights(*state);
    return 0;
}

static int setup(void **state) {
    static scratch folder;
    scratch_open(&folder);
    *state = &folder;
    return plain(state);
}

static int teardown(void **state) {
    scratch_close(*state);
    return 0;
}

static uint64_t digest_of(const char *whole, scratch *folder, const char *from, const char *to) {
    pm_scene *scene = edited_from(whole, folder, from, to);
    pm_system *system = NULL;
    if (pm_system_load(&system, scene, NULL) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    const uint64_t digest = system->digest;
    pm_system_free(system);
    pm_scene_free(scene);
    return digest;
}

static void test_known_models(void **state) {
    scratch *folder = *state;
    const uint64_t digest = digest_of(known, folder, "pair", "pair");
    static const char *const other[][2] = {
        {"m: 3", "m: 4"}, {"c*exp(s/c)", "c*exp(s/c) + 1"}, {"0.5]", "0.6]"}};
    for (size_t i = 0; i < sizeof other / sizeof *other; ++i) {
        assert_false(digest_of(known, folder, other[i][0], other[i][1]) == digest);
    }
    static const char *const bad[][3] = {
        {"|p|^2", "|v|^2", ":4:19: formula or feature \"|v|\": there is no \"v\" here"},
        {"0.5]", "-0.5]", ":5:38: irreversible: given pair [a.s, b.s] has -0.5"},
        {"[a.s, b.s,", "[a.s, b.q,", ":5:38: irreversible: given pair [a.s, b.q] must name two"},
        {"expose: {upper: s, lower: s}", "expose: {upper: s, lower: p}", "(model of joint)"},
        {"0.5]", "\"k\"]", ":5:58: formula or feature \"k\": there is no \"k\" here"},
        {"entropy: s", "entropy: {features: s}", ":7:18: the model of upper has 1 numbers to be"},
        {"entropy: s,", "reversible: {learned: {acts_on: p}}, ", ":7:18: the model of upper has 4"},
        {"law: bracket, irr", "law: exchange, irr",
         ":11:16: the model of port joint is one of the "
         "law exchange"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        pm_scene *scene = edited_from(known, folder, bad[i][0], bad[i][1]);
        pm_system *system = NULL;
        const pm_status status = pm_system_load(&system, scene, NULL);
        if (status != PM_ECONFIG || strstr(pm_error(), bad[i][2]) == NULL) {
            fail_msg("%d, \"%s\", expected \"%s\"", status, pm_error(), bad[i][2]);
        }
        pm_scene_free(scene);
    }
}

static const char touching[] =
    "scene: pair\n"
    "time: {dt: 0.3, steps: 200, integrator: discrete_gradient}\n"
    "models:\n"
    "  mass: {energy: \"|p|^2/2\"}\n"
    "  gap: {energy: \"|min(g,0)|^2\"}\n"
    "  touch: {law: contact, matrix: [[1, 0], [0, -1], [2, 3]]}\n"
    "subsystems:\n"
    "  body: {model: mass, state: {p: {unit: kg m/s, size: 2}}}\n"
    "  gaps: {model: gap, state: {g: {unit: m, size: 3}}}\n"
    "ports:\n"
    "  skin: {law: contact, between: [body, gaps], expose: {body: p, gaps: g}, model: touch}\n";

static pm_system *boundary_input(const pm_scene *scene) {
    pm_system *system = NULL;
    if (pm_system_load(&system, scene, NULL) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return system;
}

// The matrix of a contact, written in the scene, or kept in a weights file that does not spell it.
static void test_matrix(void **state) {
    scratch *folder = *state;
    pm_scene *scene = edited_from(touching, folder, "pair", "pair");
    pm_system *system = boundary_input(scene);
    static const double expected[] = {1, 0, 0, -1, 2, 3};
    pm_port_model *port = system->port[0];
    assert_memory_equal(pm_params_find(&port->params, "matrix")->value, expected, sizeof expected);
    port->spec.matrix = (pm_matrix_spec){0};
    const pm_provenance provenance = {.command = "test", .data = ""};
    assert_int_equal(
        pm_weights_save(scratch_path(folder, "skin.h5"), pm_component_of_port(port), &provenance),
        PM_OK);
    pm_system_free(system);
    pm_scene_free(scene);

    scene = edited_from(touching, folder, "model: touch", "weights: skin.h5");
    system = boundary_input(scene);
    port = system->port[0];
    assert_memory_equal(pm_params_find(&port->params, "matrix")->value, expected, sizeof expected);
    pm_system_free(system);
    pm_scene_free(scene);
    assert_false(digest_of(touching, folder, "2, 3]", "2, 4]") ==
                 digest_of(touching, folder, "pair", "pair"));

    static const char *const bad[][3] = {
        {", [2, 3]]", "]", ":6:33: the matrix is 2 x 2, expected 3 x 2: a row for each number"},
        {", matrix: [[1, 0], [0, -1], [2, 3]]", "",
         ":11:82: \"matrix\" is missing: 3 x 2 numbers (model of skin)"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        scene = edited_from(touching, folder, bad[i][0], bad[i][1]);
        const pm_status status = pm_system_load(&system, scene, NULL);
        if (status != PM_ECONFIG || strstr(pm_error(), bad[i][2]) == NULL) {
            fail_msg("%d, \"%s\", expected \"%s\"", status, pm_error(), bad[i][2]);
        }
        pm_scene_free(scene);
    }
}

static void test_digest(void **state) {
    const uint64_t digest = digest_of(good, *state, "pair", "pair");
    const char *const same[][2] = {{"steps: 200", "steps: 3"},
                                   // The coordinator's alone.
                                   {"ports:", "guards: {energy_drift: 0.5}\nports:"}};
    const char *const other[][2] = {{"pair", "pear"},
                                    {"dt: 0.3", "dt: 0.1"},
                                    {"ports:", "lockstep: {window: 2}\nports:"},
                                    {"ports:", "guards: {training_range: 0.5}\nports:"},
                                    {"rk4", "heun"},
                                    {"substeps: 8", "substeps: 4"},
                                    {"joint:", "hinge:"},
                                    {"[upper, lower]", "[lower, upper]"}};
    for (size_t i = 0; i < sizeof same / sizeof *same; ++i) {
        assert_true(digest_of(good, *state, same[i][0], same[i][1]) == digest);
    }
    for (size_t i = 0; i < sizeof other / sizeof *other; ++i) {
        assert_false(digest_of(good, *state, other[i][0], other[i][1]) == digest);
    }
}

// The error starts with the place, "LINE:COLUMN" in t.yaml, and the one that is refused.
static void assert_refused(scratch *folder, const char *from, const char *to, const char *at,
                           const char *what) {
    char start[512];
    snprintf(start, sizeof start, "%s:%s: ", scratch_path(folder, "t.yaml"), at);
    pm_scene *scene = edited(folder, from, to);
    pm_system *system = NULL;
    assert_int_equal(pm_system_load(&system, scene, NULL), PM_EWEIGHTS);
    if (strncmp(pm_error(), start, strlen(start)) != 0 || strstr(pm_error(), what) == NULL) {
        fail_msg("\"%s\", expected \"%s\" and \"%s\"", pm_error(), start, what);
    }
    assert_null(system);
    pm_scene_free(scene);
}

static void test_mismatch(void **state) {
    assert_refused(
        *state, "s: {unit: J/K, size: 1}", "s: {unit: K, size: 1}", "4:66: subsystem upper",
        "made for p[2] in kg m/s, s[1] in J/K; the scene says p[2] in kg m/s, s[1] in K");
    assert_refused(*state, "p: {unit: kg m/s, size: 2}", "p: {unit: kg m/s, size: 3}",
                   "4:38: subsystem upper", "the scene says p[3] in kg m/s");
    assert_refused(*state, "lower: s}", "lower: [p, s]}", "7:76: port joint, end lower",
                   "made for s[1] in J/K; the scene says p[2] in kg m/s, s[1] in J/K");
    assert_refused(*state, "law: bracket", "law: exchange", "7:16: port joint",
                   "made for the law bracket; the scene says exchange");
    assert_refused(*state, "p: {unit: kg m/s, size: 2}, ", "", "4:38: subsystem upper",
                   "the scene says s[1] in J/K");
    assert_refused(*state, "J/K, size: 1}", "J/K, size: 1}, t: {unit: s, size: 1}",
                   "4:91: subsystem upper", "J/K, t[1] in s");
    assert_refused(*state, "lower: {weights: upper.h5", "lower: {weights: joint.h5",
                   "5:20: subsystem lower", "joint.h5: weights of a");
}

// Files of one folder come from one fit, unless the folder has them under other names.
static void test_fits(void **state) {
    static const struct {
        const char *part, *port;
        bool good;
    } cases[] = {
        {"0123456789abcdef upper.h5 joint.h5", "0123456789abcdef upper.h5 joint.h5", true},
        {"0123456789abcdef upper.h5 joint.h5", "0123456789abcdee upper.h5 joint.h5", false},
        {"0123456789abcdef upper.h5 joint.h5", "0123456789abcdee lower.h5 joint.h5", true},
        {"0123456789abcdef upper.h5 joint.h5", NULL, true},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        part_fit = cases[i].part;
        port_fit = cases[i].port;
        save_weights(*state);
        if (cases[i].good) {
            digest_of(good, *state, "pair", "pair");
        } else {
            assert_refused(*state, "pair", "pair", "8:20: joint",
                           "upper.h5: a file of another fit");
        }
    }
}

// Where a scene says which system it describes, it takes the weights of no other one, though all
// sizes and names are equal; weights that say nothing are those of older fits.
static void test_named_system(void **state) {
    port_system = "cart";
    save_weights(*state);
    digest_of(good, *state, "pair\n", "pair\nsystem: cart\n");
    digest_of(good, *state, "pair", "pair");
    assert_refused(*state, "pair\n", "pair\nsystem: crane\n", "9:20: joint",
                   "joint.h5 are of the system \"cart\", the scene is of \"crane\"");
    port_system = NULL;
    save_weights(*state);
    digest_of(good, *state, "pair\n", "pair\nsystem: crane\n");
}

// States in another unit, or of another system, lie far from what the weights have seen.
static void test_range(void **state) {
    ranged = true;
    save_weights(*state);
    static const struct {
        double z[18];
        int count;
        const char *guard, *why;
    } cases[] = {
        {{1, 1, 3, 0, 7, 3}, 1, "", NULL},
        {{1, 1, 3, 0, 1500, 3}, 1, "", "lower.p is 1500 kg m/s, and the weights "},
        {{1, 1, 3, 0, 1500, 3}, 1, "guards: {training_range: 9}\n", NULL},
        {{1, 1, -9, 0, 1, 3}, 1, "", "upper.s is -9 J/K"},
        // Of several states one may be anywhere.
        {{1, 1, 3, 0, 1500, 3, 1, 1, 3, 0, 1, 3, 1, 1, 3, 0, 1, 3}, 3, "", NULL},
        {{1, 1, 3, 0, 1500, 3, 1, 1, 3, 0, 1500, 3, 1, 1, 3, 0, 1, 3}, 3, "", "1500"},
        {{1, 1, 3, 0, 1, 3, 1, 1, NAN, 0, 1, 3}, 2, "", NULL},
        // What swings around the range is outside, too.
        {{1, 1, 99, 0, 1, 3, 1, 1, -99, 0, 1, 3}, 2, "", "upper.s is -99 J/K"},
        // A group that is much smaller in all states has another unit, unless it is zero or there
        // is one state.
        {{1, 1, 0.003, 0, 1, 3, 1, 1, 0.004, 0, 1, 3}, 2, "", "upper.s is 0.004 J/K"},
        {{1, 1, 0.003, 0, 1, 3, 1, 1, 3, 0, 1, 3}, 2, "", NULL},
        {{1, 1, 0, 0, 1, 3, 1, 1, 0, 0, 1, 3}, 2, "", NULL},
        {{1, 1, 0.003, 0, 1, 3}, 1, "", NULL},
        {{1, 1, 0.003, 0, 1, 3, 1, 1, 0.004, 0, 1, 3}, 2, "guards: {training_range: 9}\n", NULL},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        char text[100];
        snprintf(text, sizeof text, "%sports:", cases[i].guard);
        pm_scene *scene = edited(*state, "ports:", text);
        pm_system *system = boundary_input(scene);
        const pm_status status = pm_system_check_range(system, cases[i].count, cases[i].z, "x");
        if (status != (cases[i].why == NULL ? PM_OK : PM_EDATA) ||
            (cases[i].why != NULL && strstr(pm_error(), cases[i].why) == NULL)) {
            fail_msg("case %zu: %d, \"%s\"", i, status, pm_error());
        }
        pm_system_free(system);
        pm_scene_free(scene);
    }
}

// Features say rates, of which every integrator makes its steps.
static void rates_hold_for_all_steps(void **state) {
    part_integrator = "rk4";
    save_weights(*state);
    pm_scene *scene = edited(*state, "rk4, substeps: 8", "heun, substeps: 3");
    pm_system *system = boundary_input(scene);
    assert_string_equal(system->component[0].provenance->integrator, "rk4");
    assert_true(system->component[0].provenance->step == 0.0375);
    pm_system_free(system);
    pm_scene_free(scene);
}

static pm_dataset *dataset_in(const char *coordinates) {
    static const char *const column = "x";
    pm_dataset *d = NULL;
    assert_int_equal(pm_dataset_new(&d, 1, 1, 1, 1, &column), PM_OK);
    if (coordinates != NULL) {
        assert_int_equal(pm_dataset_note(d, "coordinates", "%s", coordinates), PM_OK);
    }
    return d;
}

static void coordinates_must_agree_where_they_are_known(void **state) {
    static const struct {
        const char *part, *port, *data;
        pm_status boundary_inputs, fits;
    } cases[] = {
        {"basis 1", "basis 1", "basis 1", PM_OK, PM_OK},
        {"basis 1", "basis 2", NULL, PM_EWEIGHTS, PM_OK},
        {"basis 1", NULL, "basis 2", PM_OK, PM_EDATA},
        {"basis 1", NULL, NULL, PM_OK, PM_OK},
        {NULL, "basis 2", "basis 1", PM_OK, PM_OK},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        part_coordinates = cases[i].part;
        port_coordinates = cases[i].port;
        save_weights(*state);
        pm_scene *scene = edited(*state, "pair", "pair");
        pm_system *system = NULL;
        pm_dataset *data = dataset_in(cases[i].data);
        assert_int_equal(pm_system_load(&system, scene, NULL), cases[i].boundary_inputs);
        if (system == NULL) {
            assert_non_null(strstr(pm_error(), "t.yaml:8:20: port joint: the weights "));
            assert_non_null(strstr(pm_error(), "joint.h5 are made for basis 2, those of upper, "));
        } else {
            assert_string_equal(system->component[0].provenance->coordinates,
                                cases[i].part == NULL ? "" : cases[i].part);
            assert_int_equal(pm_system_check_dataset(system, data, "data.h5"), cases[i].fits);
            if (cases[i].fits != PM_OK) {
                assert_non_null(strstr(pm_error(), "data.h5: made with basis 2; the weights "));
            }
        }
        pm_dataset_free(data);
        pm_system_free(system);
        pm_scene_free(scene);
    }
}

// Times in ms in place of s make steps a thousand times too long.
static void states_are_not_a_thousand_steps_apart(void **state) {
    pm_scene *scene = edited(*state, "pair", "pair");
    pm_system *system = NULL;
    assert_int_equal(pm_system_load(&system, scene, NULL), PM_OK);
    static const struct {
        int ntime;
        double steps;
        pm_status status;
    } cases[] = {{2, 1, PM_OK}, {2, 500, PM_OK}, {2, 1000, PM_EDATA}, {1, 1000, PM_OK}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        static const char *const column = "x";
        pm_dataset *d = NULL;
        const double dt = cases[i].steps * scene->physics.dt;
        assert_int_equal(pm_dataset_new(&d, 1, cases[i].ntime, 1, dt, &column), PM_OK);
        assert_int_equal(pm_system_check_dataset(system, d, "data.h5"), cases[i].status);
        assert_true(cases[i].status == PM_OK || strstr(pm_error(), "are the times in ms?") != NULL);
        pm_dataset_free(d);
    }
    pm_system_free(system);
    pm_scene_free(scene);
}

// Another folder's weights take the place of the scene's, by file name.
static void test_weights_folder(void **state) {
    scratch *folder = *state;
    pm_scene *scene = edited(folder, "joint.h5", "elsewhere/joint.h5");
    pm_system *system = NULL;
    assert_int_equal(pm_system_load(&system, scene, NULL), PM_EWEIGHTS);
    assert_non_null(strstr(pm_error(), "t.yaml:8:20: port joint: weights "));
    assert_non_null(strstr(pm_error(), "elsewhere/joint.h5: "));
    assert_null(system);
    assert_int_equal(pm_system_load(&system, scene, folder->folder), PM_OK);
    assert_string_equal(system->port[0]->spec.law, "bracket");
    pm_system_free(system);
    pm_scene_free(scene);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_digest),
        cmocka_unit_test(test_known_models),
        cmocka_unit_test(test_matrix),
        cmocka_unit_test(test_mismatch),
        cmocka_unit_test_teardown(test_fits, plain),
        cmocka_unit_test_teardown(test_named_system, plain),
        cmocka_unit_test_teardown(test_range, plain),
        cmocka_unit_test(test_weights_folder),
        cmocka_unit_test(coordinates_must_agree_where_they_are_known),
        cmocka_unit_test(states_are_not_a_thousand_steps_apart),
        cmocka_unit_test(rates_hold_for_all_steps),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
