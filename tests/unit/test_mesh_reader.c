// Networks on meshes in the `model:` block and in weights files: the reader finds what the text
// says, text and weights come back equal, and errors name the place in the file.
#include "model/port.h"
#include "scene/weights.h"
#include "tests/support/model_text.h"
#include "tests/support/scratch.h"
#include "tests/support/yaml_case.h"

// 4 x 2 x 1 bricks have 24 free nodes.
static const char good_mesh[] =
    "mesh: {size: [40, 10, 2.5], elements: [4, 2, 1]}\n"
    "energy:\n"
    "  - {given: s}\n"
    "  - {nodes: [u, m], width: 8, passes: 1, patterns: 16, hidden: [48, 7]}\n"
    "entropy: {given: s}\n"
    "reversible: {learned: {acts_on: [u, m], nodes: [m], width: 9, passes: 0}}\n"
    "irreversible: {learned: {acts_on: u, rank: 2, nodes: u, width: 3, passes: 2}}\n";

static const char good_grip[] =
    "law: exchange\n"
    "form: free\n"
    "mesh: {size: [40, 10, 2.5], elements: [4, 2, 1]}\n"
    "rate: {nodes: [own.u], driven_by: other.dE.f, width: 20, passes: 4, patterns: 24, hidden: 6, "
    "within: 0.05}\n";

static void assert_message(const pm_network_spec *network, const pm_mesh *mesh,
                           pm_message_spec expected) {
    const pm_message_spec *m = network->message;
    assert_non_null(m);
    assert_ptr_equal(m->mesh, mesh);
    assert_true(m->width == expected.width && m->passes == expected.passes);
    assert_true(m->patterns == expected.patterns && m->within == expected.within);
    assert_string_equal(m->driver == NULL ? "" : m->driver,
                        expected.driver == NULL ? "" : expected.driver);
}

static void assert_mesh(const pm_mesh *mesh) {
    assert_non_null(mesh);
    assert_true(mesh->size[0] == 40 && mesh->size[1] == 10 && mesh->size[2] == 2.5);
    assert_true(mesh->elements[0] == 4 && mesh->elements[1] == 2 && mesh->elements[2] == 1);
    assert_int_equal(mesh->nnode, 24);
}

static void test_mesh(void **state) {
    (void)state;
    pm_arena arena = {0};
    const char *text = good_mesh;
    for (int i = 0; i < 2; ++i) {
        const pm_part_spec spec = part_of(text, &arena);
        const pm_network_spec *energy = &spec.energy.term[0];
        assert_mesh(spec.mesh);
        assert_int_equal(spec.energy.nterm, 1);
        assert_names(energy->nfeature, energy->feature, "u m");
        assert_true(energy->nhidden == 2 && energy->hidden[0] == 48 && energy->hidden[1] == 7);
        assert_message(energy, spec.mesh, (pm_message_spec){NULL, 8, 1, 16, NULL, 1});
        assert_message(&spec.reversible.network, spec.mesh,
                       (pm_message_spec){NULL, 9, 0, 0, NULL, 1});
        assert_message(&spec.irreversible.network, spec.mesh,
                       (pm_message_spec){NULL, 3, 2, 0, NULL, 1});
        const char *written = pm_part_spec_write(&spec, &arena);
        assert_true(i == 0 || strcmp(text, written) == 0);
        text = written;
    }
    assert_null(part_of("energy: {}\n", &arena).mesh);
    pm_arena_free(&arena);
}

static void test_mesh_of_a_port(void **state) {
    (void)state;
    pm_arena arena = {0};
    const char *text = good_grip;
    for (int i = 0; i < 2; ++i) {
        pm_yaml_document *document = NULL;
        pm_yaml root;
        pm_port_spec spec;
        assert_int_equal(pm_yaml_parse(&document, text, "t.yaml", &root), PM_OK);
        assert_int_equal(pm_port_spec_read(root, (pm_yaml){0}, &arena, &spec), PM_OK);
        pm_yaml_close(document);
        assert_mesh(spec.mesh);
        assert_message(&spec.rate, spec.mesh,
                       (pm_message_spec){NULL, 20, 4, 24, "other.dE.f", 0.05});
        const char *written = pm_port_spec_write(&spec, &arena);
        assert_true(i == 0 || strcmp(text, written) == 0);
        text = written;
    }
    pm_arena_free(&arena);
}

#define FOUR "u, u, u, u"
#define SIXTEEN FOUR ", " FOUR ", " FOUR ", " FOUR
#define FOUR_OWN "own.u, own.u, own.u, own.u"
#define SIXTEEN_OWN FOUR_OWN ", " FOUR_OWN ", " FOUR_OWN ", " FOUR_OWN

static const yaml_case bad_mesh[] = {
    {"size: [40, 10, 2.5]", "size: [40, 10]", "[40", "size: expected three numbers: along x, y, z"},
    {"elements: [4, 2, 1]", "elements: [4, 2, 1, 1]", "[4", "expected three numbers: along x"},
    {"elements: [4, 2, 1]", "elements: [4, 2, 0]", "0]", "elements: expected a whole number >= 1"},
    {"{size: [40, 10, 2.5]", "{size: [40, 10, -2.5]", "{size", "must be positive"},
    {"{size: [40, 10, 2.5], elements: [4, 2, 1]}", "{size: [1, 1, 1], elements: [99, 99, 99]}",
     "{size", "990000 nodes, at most 20000"},
    {"{size: [40, 10, 2.5], elements", "{elements", "{elements", "mesh: missing key \"size\""},
    {"mesh: {size", "# {size", "[u, m], width", "a network of nodes needs a \"mesh\" in the model"},
    {"[u, m], width", "[u, m], features: [u], width", "[u], width",
     "a network of nodes has no features"},
    {"[u, m], width", "[u, m], skip: none, width", "none", "a network of nodes has no skip"},
    {"[u, m], width", "[], width", "[]", "expected 1 to 32 fields"},
    {"[u, m], width", "[" SIXTEEN ", " SIXTEEN ", u], width", "[u", "expected 1 to 32 fields"},
    {"{nodes: [u, m], width: 8,", "{nodes: [u, m],", "{nodes", "missing key \"width\""},
    {"{nodes: [u, m], width: 8, passes: 1,", "{nodes: [u, m], width: 8,", "{nodes",
     "missing key \"passes\""},
    {"width: 8", "width: 257", "257", "width: expected a whole number >= 1 and <= 256"},
    {"passes: 1", "passes: 65", "65", "passes: expected a whole number >= 0 and <= 64"},
    {"patterns: 16", "patterns: 257", "257", "patterns: expected a whole number >= 0 and <= 256"},
    {"patterns: 16", "within: 0", "0", "within: expected a time > 0"},
    {"nodes: [u, m]", "features: [u, m]", "8,", "only a network of nodes has width"},
    {"[u, m], width", "[u, m], driven_by: m, width", "[u", "only a rate can be driven_by a field"},
    {"[u, m], width", "[u, m], within: 0.5, width", "[u", "only a rate has within"},
    {"[u, m], width: 8, passes: 1, patterns: 16", "[u, m], width: 8, passes: 1", "[u",
     "hidden layers need patterns, on whose amplitudes they act"},
    {"elements: [4, 2, 1]}\nenergy:\n  - {given: s}\n  - {nodes: [u, m], width: 8, passes: 1",
     "elements: [20, 5, 5]}\nenergy:\n  - {given: s}\n  - {nodes: [u, m], width: 256, passes: 64",
     "[u, m]", "256 numbers over 3768 edges in 64 passes: more than 16777216 in all"},
    {"[u, m], width", "[u, s], width", "[u",
     "\"s\" has 1 components, which is no field on a mesh of 24 nodes"},
    {"[u, m], width", "[u, x], width", "[u", "\"x\""},
    {"{learned: {acts_on: [u, m]", "{learned: {along: [u], acts_on: [u, m]", "{learned",
     "has no along and no against"},
    {"[m], width: 9", "[m], width: 9, patterns: 2", "[m]", "an operator on a mesh has no patterns"},
    {"{learned: {acts_on: u,", "{learned: {acts_on: [u, s],", "{learned",
     "acts_on names \"s\", which is no field on 24 nodes"},
};

static const yaml_case bad_grip[] = {
    {"[own.u]", "[own.m]", "[own.m", "the first of nodes must be \"own.u\", whose rate this is"},
    {"[own.u]", "[own.x]", "[own.x", "neither end exposes \"own.x\""},
    {"[own.u], driven_by: other.dE.f", "[own.u], driven_by: other.x", "[own.u]", "\"other.x\""},
    {"[own.u], driven_by: other.dE.f", "[own.u], driven_by: other.dE.g", "[own.u]",
     "\"other.dE.g\" has 2 components, which is no field on a mesh of 24 nodes"},
    {"[own.u], driven_by: other.dE.f", "[own.u], driven_by: other.dE.t", "[own.u]",
     "driven_by \"other.dE.t\": expected a field like the first of nodes"},
    {"[own.u], driven_by", "[own.u, own.m, other.dE.f], driven_by", "[own.u",
     "driven_by \"other.dE.f\": a driver cannot be one of nodes too"},
    {"[own.u]", "[own.u, own.m/|own.m|]", "[own.u",
     "\"own.m/|own.m|\" is an expression, expected a group"},
    {"[own.u]", "[" SIXTEEN_OWN ", " SIXTEEN_OWN "]", "[own", "more than 32 fields"},
};

static pm_status declare_part(pm_yaml root, pm_arena *arena) {
    pm_part part = {
        .layout = {3, (pm_group[]){{"u", "m", 72, 0}, {"m", "m", 72, 72}, {"s", "J/K", 1, 144}},
                   145}};
    PM_TRY(pm_part_spec_read(root, (pm_yaml){0}, arena, &part.spec));
    const pm_status status = pm_part_declare(&part);
    pm_part_free(&part);
    return status;
}

static pm_status declare_grip(pm_yaml root, pm_arena *arena) {
    pm_port_model port = {
        .layout = {
            {2, (pm_group[]){{"u", "m", 72, 0}, {"m", "m", 72, 72}}, 144},
            {3, (pm_group[]){{"f", "m", 72, 0}, {"g", "m", 2, 72}, {"t", "K", 24, 74}}, 98}}};
    PM_TRY(pm_port_spec_read(root, (pm_yaml){0}, arena, &port.spec));
    const pm_status status = pm_port_declare(&port);
    pm_port_free(&port);
    return status;
}

// Errors of the text, and errors that show once the fields are known.
static void test_bad_mesh(void **state) {
    (void)state;
    static const yaml_case none = {"mesh", "mesh", "mesh", ""};
    const size_t count = sizeof bad_mesh / sizeof *bad_mesh;
    const size_t all = count + sizeof bad_grip / sizeof *bad_grip;
    int failures = 0;
    for (size_t i = 0; i < all + 2; ++i) {
        const bool port = i >= count && i != all;
        const yaml_case *c = i >= all ? &none : port ? &bad_grip[i - count] : &bad_mesh[i];
        char *text = yaml_case_text(port ? good_grip : good_mesh, c);
        pm_yaml_document *document = NULL;
        pm_arena arena = {0};
        pm_yaml root;
        assert_int_equal(pm_yaml_parse(&document, text, "t.yaml", &root), PM_OK);
        const pm_status status = port ? declare_grip(root, &arena) : declare_part(root, &arena);
        failures += i >= all ? status != PM_OK
                             : !yaml_case_holds("t.yaml", port ? good_grip : good_mesh, c, status);
        pm_yaml_close(document);
        pm_arena_free(&arena);
        free(text);
    }
    assert_int_equal(failures, 0);
}

// --- weights ---

static pm_yaml parse(const char *text, pm_yaml_document **document) {
    pm_yaml root;
    assert_int_equal(pm_yaml_parse(document, text, "t", &root), PM_OK);
    return root;
}

// On 2 x 1 x 1 bricks with 8 free nodes.
static void networks_on_a_mesh_come_back(void **state) {
    static const char mesh_part[] =
        "mesh: {size: [3, 1, 1], elements: [2, 1, 1]}\n"
        "energy: [{given: s}, {nodes: [u], width: 3, passes: 1, patterns: 2, hidden: [4]}]\n"
        "entropy: {given: s}\n"
        "irreversible: {learned: {acts_on: [u], nodes: [u], width: 2, passes: 1, rank: 2}}\n";
    static const char mesh_port[] =
        "law: exchange\nform: free\nmesh: {size: [3, 1, 1], elements: [2, 1, 1]}\n"
        "rate: {nodes: [own.u], driven_by: other.dE.f, width: 3, passes: 1, patterns: 2, "
        "within: 0.1}\n";
    pm_part body = {.layout = {2, (pm_group[]){{"u", "m", 24, 0}, {"s", "J/K", 1, 24}}, 25}},
            part2 = {0};
    pm_port_model grip = {.layout = {{1, (pm_group[]){{"u", "m", 24, 0}}, 24},
                                     {1, (pm_group[]){{"f", "m", 24, 0}}, 24}}};
    pm_port_model port2 = {0};
    pm_provenance found;
    pm_yaml_document *document[2];
    pm_rng rng;
    pm_arena arena = {0};
    const pm_provenance provenance = {.command = "fit"};
    scratch *folder = *state;
    pm_rng_init(&rng, 3, 0);
    assert_int_equal(
        pm_part_spec_read(parse(mesh_part, &document[0]), (pm_yaml){0}, &arena, &body.spec), PM_OK);
    assert_int_equal(
        pm_port_spec_read(parse(mesh_port, &document[1]), (pm_yaml){0}, &arena, &grip.spec), PM_OK);
    assert_int_equal(pm_part_declare(&body), PM_OK);
    assert_int_equal(pm_port_declare(&grip), PM_OK);
    pm_params_randomise(&body.params, &rng);
    pm_params_randomise(&grip.params, &rng);
    const char *path = scratch_path(folder, "body.h5");
    assert_int_equal(pm_weights_save_part(path, &body, &provenance), PM_OK);
    assert_int_equal(pm_weights_load_part(path, &arena, &part2, &found), PM_OK);
    assert_same_params(&part2.params, &body.params);
    assert_true(part2.spec.mesh->nnode == 8 && part2.spec.mesh->size[0] == 3);
    path = scratch_path(folder, "grip.h5");
    assert_int_equal(pm_weights_save_port(path, &grip, &provenance), PM_OK);
    assert_int_equal(pm_weights_load_port(path, &arena, &port2, &found), PM_OK);
    assert_same_params(&port2.params, &grip.params);
    assert_string_equal(port2.spec.rate.message->driver, "other.dE.f");
    for (int i = 0; i < 2; ++i) {
        pm_yaml_close(document[i]);
    }
    pm_part_free(&body);
    pm_part_free(&part2);
    pm_port_free(&grip);
    pm_port_free(&port2);
    pm_arena_free(&arena);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_mesh),
        cmocka_unit_test(test_mesh_of_a_port),
        cmocka_unit_test(test_bad_mesh),
        cmocka_unit_test_setup_teardown(networks_on_a_mesh_come_back, scratch_setup,
                                        scratch_teardown),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
