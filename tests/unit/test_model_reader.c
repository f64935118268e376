// The `model:` block of parts and ports: the reader finds what the text says, the text of a spec
// reads back as an equal spec, and errors name the place in the file.
#include <math.h>

#include "model/port.h"
#include "scene/model_reader.h"
#include "tests/support/model_text.h"
#include "tests/support/yaml_case.h"

static const char good[] =
    "form: soft\n"
    "constants: {m: 2, k: 0.1}\n"
    "energy:\n"
    "  - \"|p|^2/(2*m)\"\n"
    "  - {features: [\"|p|^2\"], skip: linear}\n"
    "  - {given: [u, w]}\n"
    "  - {given: {u: -2.5}}\n"
    "  - {features: [\"ln|q|\", s], hidden: [16, 8], activation: silu, skip: quadratic, "
    "zero_at_origin: "
    "true}\n"
    "entropy: {given: s}\n"
    "reversible:\n"
    "  given: [[q, p, 1.0], [v, \"a\\\"b\\\\c\", -0.1]]\n"
    "  learned: {acts_on: [p, s], along: [\"q/|q|^2\"], features: [\"<q,p>\"], hidden: 8}\n"
    "irreversible:\n"
    "  given: [[p, s, 0.5], [v, s, \"k*dE.s\"], [{u: 1, w: -2, v: \"-k\"}, s, k]]\n"
    "  learned: {acts_on: s, rank: 2, activation: softplus}\n";

// Checks that the spec is what `good` says.
static void assert_good(const pm_part_spec *spec) {
    assert_int_equal(spec->form, PM_SOFT);
    assert_true(spec->constants->count == 2 && spec->constants->value[1] == 0.1);
    assert_string_equal(spec->constants->name[0], "m");
    assert_true(spec->energy.nterm == 2 && spec->entropy.nterm == 0);
    assert_true(spec->energy.nformula == 1 && spec->entropy.nformula == 0);
    assert_string_equal(spec->energy.formula[0].text, "|p|^2/(2*m)");
    assert_ptr_equal(spec->energy.formula[0].constants, spec->constants);
    assert_names(spec->energy.ngiven, spec->energy.given, "u w u");
    assert_true(spec->energy.given_coefficient[0] == 1 &&
                spec->energy.given_coefficient[2] == -2.5);
    assert_names(spec->entropy.ngiven, spec->entropy.given, "s");
    const pm_network_spec *first = &spec->energy.term[0], *second = &spec->energy.term[1];
    assert_names(first->nfeature, first->feature, "|p|^2");
    assert_true(first->nhidden == 0 && first->activation == PM_TANH);
    assert_int_equal(first->skip, PM_SKIP_LINEAR);
    assert_true(!first->zero_at_origin && second->zero_at_origin);
    assert_names(second->nfeature, second->feature, "ln|q| s");
    assert_true(second->nhidden == 2 && second->hidden[0] == 16 && second->hidden[1] == 8);
    assert_true(second->activation == PM_SILU && second->skip == PM_SKIP_QUADRATIC);

    const pm_operator_spec *reversible = &spec->reversible;
    assert_int_equal(reversible->ngiven, 2);
    assert_string_equal(reversible->given[0].row, "q");
    assert_string_equal(reversible->given[1].col, "a\"b\\c");
    assert_true(reversible->given[0].coefficient == 1 && reversible->given[1].coefficient == -0.1);
    assert_true(reversible->learned);
    assert_names(reversible->nacts, reversible->acts_on, "p s");
    assert_names(reversible->nalong, reversible->along, "q/|q|^2");
    assert_names(reversible->network.nfeature, reversible->network.feature, "<q,p>");
    assert_true(reversible->network.nhidden == 1 && reversible->network.hidden[0] == 8);

    const pm_operator_spec *irreversible = &spec->irreversible;
    assert_true(irreversible->learned && irreversible->rank == 2 && irreversible->ngiven == 3);
    assert_names(irreversible->nacts, irreversible->acts_on, "s");
    assert_true(irreversible->nalong == 0 && irreversible->network.nfeature == 0);
    assert_int_equal(irreversible->network.activation, PM_SOFTPLUS);
    assert_true(irreversible->given[0].coefficient == 0.5);
    assert_null(irreversible->given[0].formula.text);
    assert_string_equal(irreversible->given[1].formula.text, "k*dE.s");
    const pm_given_pair *along = &irreversible->given[2];
    assert_true(along->ndirection == 3 && irreversible->given[0].ndirection == 0);
    assert_string_equal(along->direction[1].name, "w");
    assert_true(along->direction[0].coefficient == 1 && along->direction[1].coefficient == -2);
    assert_string_equal(along->direction[2].formula.text, "-k");
    assert_string_equal(along->formula.text, "k");
}

static void test_round_trip(void **state) {
    (void)state;
    pm_arena arena = {0};
    const pm_part_spec spec = part_of(good, &arena);
    assert_good(&spec);
    const char *text = pm_part_spec_write(&spec, &arena);
    assert_non_null(text);
    const pm_part_spec again = part_of(text, &arena);
    assert_good(&again);
    assert_string_equal(pm_part_spec_write(&again, &arena), text);
    pm_arena_free(&arena);
}

static void test_defaults(void **state) {
    (void)state;
    const char *const texts[] = {"energy: {}\n",
                                 "form: hard\nenergy: [{}]\nentropy: none\nreversible: "
                                 "none\nirreversible: {learned: none}\n"};
    pm_arena arena = {0};
    for (int i = 0; i < 2; ++i) {
        const pm_part_spec spec = part_of(texts[i], &arena);
        assert_int_equal(spec.form, PM_HARD);
        assert_true(spec.energy.nterm == 1 && spec.energy.ngiven == 0);
        assert_true(spec.energy.term[0].nfeature == 0 && spec.energy.term[0].nhidden == 0);
        assert_true(spec.energy.term[0].activation == PM_TANH &&
                    spec.energy.term[0].skip == PM_SKIP_NONE);
        assert_true(spec.entropy.nterm == 0 && spec.entropy.ngiven == 0);
        assert_true(spec.reversible.ngiven == 0 && !spec.reversible.learned);
        assert_false(spec.irreversible.learned);
        const char *text = pm_part_spec_write(&spec, &arena);
        const pm_part_spec again = part_of(text, &arena);
        assert_string_equal(pm_part_spec_write(&again, &arena), text);
    }
    const pm_part_spec spec = part_of("irreversible: {learned: {acts_on: s}}", &arena);
    assert_int_equal(spec.irreversible.rank, 1);
    pm_arena_free(&arena);
}

static void test_free_form(void **state) {
    (void)state;
    pm_arena arena = {0};
    const char *text = "form: free\nrate: {features: [q, \"ln|q|\"], hidden: [3, 2]}\n";
    for (int i = 0; i < 2; ++i) {
        const pm_part_spec spec = part_of(text, &arena);
        assert_int_equal(spec.form, PM_FREE);
        assert_names(spec.rate.nfeature, spec.rate.feature, "q ln|q|");
        assert_true(spec.rate.nhidden == 2 && spec.rate.hidden[1] == 2);
        text = pm_part_spec_write(&spec, &arena);
    }
    pm_arena_free(&arena);
}

static void test_port(void **state) {
    (void)state;
    static const char text[] = "law: exchange\n"
                               "form: soft\n"
                               "energy: {features: [own.q, other.q], hidden: [4]}\n"
                               "reversible: {given: [[a.p, b.q, 0.333333333333333315]], "
                               "learned: {acts_on: a.p, against: [b.q, b.s]}}\n"
                               "irreversible: {learned: {acts_on: [a.s, b.s]}}\n";
    pm_arena arena = {0};
    const char *written = text;
    for (int i = 0; i < 2; ++i) {
        pm_yaml_document *document = NULL;
        pm_yaml root;
        pm_port_spec spec;
        assert_int_equal(pm_yaml_parse(&document, written, "t.yaml", &root), PM_OK);
        assert_int_equal(pm_port_spec_read(root, (pm_yaml){0}, &arena, &spec), PM_OK);
        pm_yaml_close(document);
        assert_string_equal(spec.law, "exchange");
        assert_int_equal(spec.form, PM_SOFT);
        assert_names(spec.energy.term[0].nfeature, spec.energy.term[0].feature, "own.q other.q");
        assert_true(spec.reversible.given[0].coefficient == 1.0 / 3);
        assert_names(spec.reversible.nagainst, spec.reversible.against, "b.q b.s");
        assert_names(spec.irreversible.nacts, spec.irreversible.acts_on, "a.s b.s");
        written = pm_port_spec_write(&spec, &arena);
    }
    pm_arena_free(&arena);
}

static void test_matrix(void **state) {
    (void)state;
    pm_arena arena = {0};
    const char *written =
        "law: contact\nmatrix: [[1, -0.1, 0], [2.5e-3, 0.333333333333333315, 7]]\n";
    for (int i = 0; i < 2; ++i) {
        pm_yaml_document *document = NULL;
        pm_yaml root;
        pm_port_spec spec;
        assert_int_equal(pm_yaml_parse(&document, written, "t.yaml", &root), PM_OK);
        assert_int_equal(pm_port_spec_read(root, (pm_yaml){0}, &arena, &spec), PM_OK);
        pm_yaml_close(document);
        assert_true(spec.matrix.rows == 2 && spec.matrix.cols == 3);
        static const double expected[] = {1, -0.1, 0, 2.5e-3, 1.0 / 3, 7};
        assert_memory_equal(spec.matrix.value, expected, sizeof expected);
        written = pm_port_spec_write(&spec, &arena);
    }
    pm_arena_free(&arena);
}

static void test_identity(void **state) {
    (void)state;
    pm_arena arena = {0};
    const char *written = "law: contact\nmatrix: identity\n";
    for (int i = 0; i < 2; ++i) {
        pm_yaml_document *document = NULL;
        pm_yaml root;
        pm_port_model port = {
            .layout = {{1, (pm_group[]){{"p", "m", 3, 0, PM_ROLE_OTHER, false}}, 3},
                       {1, (pm_group[]){{"x", "m", 3, 0, PM_ROLE_OTHER, false}}, 3}}};
        assert_int_equal(pm_yaml_parse(&document, written, "t.yaml", &root), PM_OK);
        assert_int_equal(pm_port_spec_read(root, (pm_yaml){0}, &arena, &port.spec), PM_OK);
        pm_yaml_close(document);
        assert_true(port.spec.matrix.identity && port.spec.matrix.value == NULL);
        assert_int_equal(pm_port_declare(&port), PM_OK);
        assert_int_equal(port.params.count, 0);
        port.layout[1].nz = 2;
        assert_int_equal(pm_port_declare(&port), PM_ECONFIG);
        assert_non_null(strstr(pm_error(), "the identity joins 3 numbers of the first end to 2"));
        written = pm_port_spec_write(&port.spec, &arena);
        pm_port_free(&port);
    }
    pm_arena_free(&arena);
}

static const char good_derived[] =
    "derived:\n"
    "  g: {of: [q, p], matrix: [[0, 1, 2], [3, 4, 5]], offset: [6, 7]}\n"
    "  kept: {of: q, size: 4}\n"
    "energy: \"|min(g,0)|^2\"\n";

// A part with the groups q [2] and p [1].
static pm_status declare_derived(pm_yaml root, pm_arena *arena, pm_part *part) {
    static pm_group group[] = {{"q", "m", 2, 0, PM_ROLE_OTHER, false},
                               {"p", "m", 1, 2, PM_ROLE_OTHER, false}};
    *part = (pm_part){.layout = {2, group, 3}};
    PM_TRY(pm_part_spec_read(root, (pm_yaml){0}, arena, &part->spec));
    return pm_part_declare(part);
}

static void test_derived(void **state) {
    (void)state;
    pm_arena arena = {0};
    const char *written = good_derived;
    for (int i = 0; i < 2; ++i) {
        pm_yaml_document *document = NULL;
        pm_yaml root;
        pm_part part;
        assert_int_equal(pm_yaml_parse(&document, written, "t.yaml", &root), PM_OK);
        assert_int_equal(declare_derived(root, &arena, &part), PM_OK);
        pm_yaml_close(document);
        assert_int_equal(part.spec.nderived, 2);
        assert_names(part.spec.derived[0].ngroup, part.spec.derived[0].group, "q p");
        assert_true(part.spec.derived[0].size == 2 && part.spec.derived[1].size == 4);
        const pm_param_entry *matrix = pm_params_find(&part.params, "derived.g.matrix");
        const pm_param_entry *offset = pm_params_find(&part.params, "derived.g.offset");
        const pm_param_entry *kept = pm_params_find(&part.params, "derived.kept.matrix");
        for (int k = 0; k < 8; ++k) {
            assert_true((k < 6 ? matrix->value[k] : offset->value[k - 6]) == k);
        }
        assert_true(kept->rows == 4 && kept->cols == 2 && isnan(kept->value[0]));
        assert_false(matrix->trained);
        // Numbers that neither the text nor a file has given are an error.
        assert_int_equal(pm_params_check_given(&part.params), PM_ECONFIG);
        written = pm_part_spec_write(&part.spec, &arena);
        pm_part_free(&part);
    }
    pm_arena_free(&arena);
}

static const yaml_case bad[] = {
    {"form: soft", "form: firm", "firm", "form: expected one of hard, soft, free, found \"firm\""},
    {"form: soft", "form: free", "form", "missing key \"rate\""},
    {"form: soft", "form: soft\nrate: {hidden: 4}", "{hidden", "only form: free has a rate"},
    {"form: soft", "from: soft", "from", "unknown key \"from\"; allowed: form, energy, entropy"},
    {"form: soft", "law: bracket", "law", "unknown key \"law\"; allowed: form"},
    {"hidden: [16, 8]", "hidden: [16, 0]", "0]", "hidden: expected a whole number >= 1 and <= "},
    {"hidden: [16, 8]", "hidden: [1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]", "[1", "hidden: 17 layers"},
    {"hidden: [16, 8]", "layers: [16, 8]", "layers", "allowed: features, hidden, activation, skip"},
    {"activation: silu", "activation: relu", "relu", "one of tanh, softplus, silu, found \"relu\""},
    {"skip: linear", "skip: cubic", "cubic",
     "one of none, linear, quadratic, quartic, found \"cubic\""},
    {"zero_at_origin: true", "zero_at_origin: often", "often",
     "zero_at_origin: expected one of false, true"},
    {"{features: [\"|p|^2\"], skip: linear}", "{zero_at_origin: true}", "true",
     "zero_at_origin: only a network of features with a skip can be zero at the origin"},
    {"acts_on: [p, s]", "acts_on: [p, s], zero_at_origin: true", "zero_at_origin",
     "unknown key \"zero_at_origin\""},
    {"[\"|p|^2\"]", "[[p]]", "[p]", "features: expected text, found a list"},
    {"{given: [u, w]}", "{given: [u, w], skip: linear}", "skip",
     "unknown key \"skip\"; allowed: given"},
    {"{given: s}", "[[s]]", "[s]", "entropy: expected text, found a list"},
    {"m: 2", "m: heavy", "heavy", "m: expected a number, found \"heavy\""},
    {"{m: 2, k: 0.1}", "{}", "{}", "constants: expected a mapping with at least one entry"},
    {"k: 0.1}", "k: {learned: 0.1, optional: [m, kk]}}", "kk",
     "optional: expected a constant of the model, found \"kk\""},
    {"{m: 2, k: 0.1}", "[m]", "[m]",
     "constants: expected a mapping with at least one entry, found a list"},
    {"[q, p, 1.0], ", "[q, p], ", "[q", "given: expected a pair such as [q, p, 1.0]"},
    {"[q, p, 1.0], ", "[q, p, [x]], ", "[x]", "given: expected text, found a list"},
    {"[[q, p, 1.0], [v", "{q: p} # [[v", "{q", "given: expected a list of pairs"},
    {"{acts_on: [p, s], ", "{", "{", "learned: missing key \"acts_on\""},
    {"acts_on: [p, s]", "acts_on: []", "[]", "acts_on: expected at least one group"},
    {"acts_on: [p, s]", "acts_on: [p, s], rank: 1", "rank",
     "unknown key \"rank\"; allowed: acts_on"},
    {"rank: 2", "rank: 0", "0", "rank: expected a whole number >= 1 and <= "},
    {"[p, s, 0.5]", "[p, s]", "[p", "given: expected a pair such as [q, p, 1.0]"},
};

static const yaml_case bad_port[] = {
    {"law: bracket", "law: contract", "contract", "law: expected one of "},
    {"law: bracket", "form: hard", "form", "missing key \"law\""},
    {"law: bracket", "law: bracket\nports: 1", "ports",
     "unknown key \"ports\"; allowed: law, form"},
    {"law: bracket", "law: bracket\nmatrix: [[1]]", "[[1",
     "matrix: only law: contact has a matrix"},
    {"law: bracket", "law: contact\nmatrix: 1", "1", "expected a list of rows such as [[1.0, 0.0]"},
    {"law: bracket", "law: contact\nmatrix: []", "[]",
     "expected a list of rows such as [[1.0, 0.0]"},
    {"law: bracket", "law: contact\nmatrix: [1, 2]", "[1", "expected a list of rows such as [[1.0"},
    {"law: bracket", "law: contact\nmatrix: [[1, 2], [3]]", "[3",
     "matrix: expected a row of 2 numbers like the first, found 1"},
    {"law: bracket", "law: contact\nmatrix: [[1, 2], 3]", "3]", "expected a row of 2 numbers"},
    {"law: bracket", "law: contact\nmatrix: [[1, y]]", "y", "expected a number, found \"y\""},
};

static pm_status visit_features(void *context, const pm_normaliser *n) {
    int size = 0;
    if (n->kind == PM_NORMALISE_FEATURES) {
        assert_int_equal(pm_feature_size(n->expression[0], n->symbols, &size), PM_OK);
        *(int *)context += size;
    }
    return PM_OK;
}

// A network of an energy may have features of derived variables.
static void test_derived_features(void **state) {
    (void)state;
    static const char text[] = "derived:\n"
                               "  g: {of: [q, p], matrix: [[0, 1, 2], [3, 4, 5]]}\n"
                               "energy: {features: [g], skip: quadratic}\n";
    pm_arena arena = {0};
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_part part;
    pm_graph *g = NULL;
    int size = 0;
    assert_int_equal(pm_yaml_parse(&document, text, "t.yaml", &root), PM_OK);
    assert_int_equal(declare_derived(root, &arena, &part), PM_OK);
    pm_yaml_close(document);
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z = pm_input(g, true, 1, 3);
    assert_int_equal(pm_part_visit(&part, g, z, z, z, visit_features, &size), PM_OK);
    assert_int_equal(size, 2);
    pm_graph_close(g);
    pm_part_free(&part);
    pm_arena_free(&arena);
}

static const yaml_case bad_derived[] = {
    {"{of: [q, p]", "{of: [q, x]", "{of", "derived variable g: the state has no group \"x\""},
    {"of: [q, p]", "of: []", "[]", "of: expected 1 to 16 groups"},
    {"of: [q, p]", "to: [q, p]", "to", "unknown key \"to\"; allowed: of, size, matrix, offset"},
    {"{of: [q, p]", "{of: q", "{of", "derived variable g: the matrix is 2 x 3, expected 2 x 2"},
    {"of: [q, p]", "size: 3, of: [q, p]", "[6", "offset: expected 3 numbers, found 2"},
    {"{of: q, size: 4", "{of: q", "{of: q", "missing key \"size\""},
    {"size: 4", "size: 4, offset: [1, 2, 3, 4]", "[1, 2, 3, 4",
     "offset: expected a matrix beside it"},
    {"size: 4", "size: 0", "0}", "size: expected a whole number >= 1"},
    {"[3, 4, 5]", "[3, 4]", "[3", "expected a row of 3 numbers like the first, found 2"},
    {"  kept", "  q", "{of: q",
     "derived variable q: its name is that of a group, or of another one"},
    {"kept: {of: q, size: 4}", "h: {of: g, size: 4}", "{of: g",
     "derived variable h: the state has no group"},
    {"derived:", "form: free\nrate: {features: q}\nderived:", "form",
     "form: free has a rate and nothing else"},
};

static void test_bad_derived(void **state) {
    (void)state;
    int failures = 0;
    for (size_t i = 0; i < sizeof bad_derived / sizeof *bad_derived; ++i) {
        char *text = yaml_case_text(good_derived, &bad_derived[i]);
        pm_yaml_document *document = NULL;
        pm_arena arena = {0};
        pm_part part;
        pm_yaml root;
        assert_int_equal(pm_yaml_parse(&document, text, "t.yaml", &root), PM_OK);
        const pm_status status = declare_derived(root, &arena, &part);
        failures += !yaml_case_holds("t.yaml", good_derived, &bad_derived[i], status);
        pm_part_free(&part);
        pm_yaml_close(document);
        pm_arena_free(&arena);
        free(text);
    }
    assert_int_equal(failures, 0);
}

static void test_bad(void **state) {
    (void)state;
    static const char good_port[] = "law: bracket\n";
    const size_t count = sizeof bad / sizeof *bad;
    const size_t all = count + sizeof bad_port / sizeof *bad_port;
    int failures = 0;
    for (size_t i = 0; i < all; ++i) {
        const bool port = i >= count;
        const yaml_case *c = port ? &bad_port[i - count] : &bad[i];
        char *text = yaml_case_text(port ? good_port : good, c);
        pm_yaml_document *document = NULL;
        pm_arena arena = {0};
        pm_yaml root;
        pm_part_spec part_spec;
        pm_port_spec port_spec;
        assert_int_equal(pm_yaml_parse(&document, text, "t.yaml", &root), PM_OK);
        const pm_status status = port ? pm_port_spec_read(root, (pm_yaml){0}, &arena, &port_spec)
                                      : pm_part_spec_read(root, (pm_yaml){0}, &arena, &part_spec);
        failures += !yaml_case_holds("t.yaml", port ? good_port : good, c, status);
        pm_yaml_close(document);
        pm_arena_free(&arena);
        free(text);
    }
    assert_int_equal(failures, 0);
}

// Learned constants, thermal energies, cross products and heats: text, spec and text again.
static void test_physics_round_trip(void **state) {
    (void)state;
    static const char text[] =
        "constants: {m: 2.0, g: {learned: 0.1}, K: {learned: 1.5, positive: true, shared: "
        "true}}\n"
        "energy:\n"
        "  - \"|p|^2/(2*m)\"\n"
        "  - {features: [x], thermal: [s, r], hidden: [4], exponentials: 3, rising: true, "
        "temperature: 290.0, "
        "separate: true}\n"
        "  - {features: [x], hidden: [4], scaled: true}\n"
        "entropy: {given: [s, r]}\n"
        "reversible: {given: [[m, m, cross], [\"x[0]\", \"p[1]\", \"g\"]]}\n"
        "irreversible:\n"
        "  given: [[p, v, K]]\n"
        "  learned: {acts_on: [p, v], rank: 2, heats: [s, r], "
        "strength: {features: [p], hidden: [3]}}\n";
    pm_arena arena = {0};
    pm_part_spec spec = part_of(text, &arena);
    for (int pass = 0; pass < 2; ++pass) {
        assert_true(spec.constants->count == 3 && spec.constants->value[2] == 1.5);
        assert_int_equal(spec.constants->learned[0], PM_CONSTANT_KNOWN);
        assert_int_equal(spec.constants->learned[1], PM_CONSTANT_LEARNED);
        assert_int_equal(spec.constants->learned[2], PM_CONSTANT_POSITIVE);
        assert_true(spec.constants->shared[2] && !spec.constants->shared[1]);
        const pm_network_spec *thermal = &spec.energy.term[0];
        assert_names(thermal->nfeature, thermal->feature, "x s r");
        assert_true(thermal->nthermal == 2 && thermal->exponentials == 3 && thermal->scaled);
        assert_true(thermal->temperature == 290 && thermal->separate && thermal->rising);
        assert_true(spec.energy.term[1].scaled && spec.energy.term[1].nthermal == 0);
        assert_true(spec.reversible.given[0].cross && !spec.reversible.given[1].cross);
        assert_names(spec.irreversible.nheats, spec.irreversible.heats, "s r");
        assert_non_null(spec.irreversible.strength);
        assert_names(spec.irreversible.strength->nfeature, spec.irreversible.strength->feature,
                     "p");
        assert_int_equal(spec.irreversible.strength->hidden[0], 3);
        const char *written = pm_part_spec_write(&spec, &arena);
        assert_non_null(written);
        spec = part_of(written, &arena);
        assert_string_equal(pm_part_spec_write(&spec, &arena), written);
    }
    static const char given[] = "irreversible: {given: [[p, v, 0.5]], heats: [s]}\n";
    spec = part_of(given, &arena);
    spec = part_of(pm_part_spec_write(&spec, &arena), &arena);
    assert_names(spec.irreversible.nheats, spec.irreversible.heats, "s");
    static const char optional[] = "constants: {a: {learned: 1.0, optional: [b, c]}, b: {learned: "
                                   "1.0, optional: true}, c: {learned: 1.0}}\n"
                                   "irreversible: {given: [[p, v, \"a + b + c\"]]}\n";
    const pm_constants *constants = part_of(optional, &arena).constants;
    assert_string_equal(constants->optional[0], " b c ");
    assert_string_equal(constants->optional[1], "");
    assert_null(constants->optional[2]);
    pm_arena_free(&arena);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_defaults),
        cmocka_unit_test(test_physics_round_trip),
        cmocka_unit_test(test_free_form),
        cmocka_unit_test(test_port),
        cmocka_unit_test(test_matrix),
        cmocka_unit_test(test_identity),
        cmocka_unit_test(test_derived),
        cmocka_unit_test(test_derived_features),
        cmocka_unit_test(test_bad_derived),
        cmocka_unit_test(test_bad),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
