// Parameters, features and networks are compared with formulas written by hand, and every mistake
// in a model that shows only with its layout is refused.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "graph/program.h"
#include "model/operator.h"
#include "model/part.h"
#include "model/port.h"
#include "scene/model_reader.h"
#include "tests/support/unit.h"

static const pm_layout layout = {3,
                                 (pm_group[]){{"q", "m", 2, 0, PM_ROLE_OTHER, false},
                                              {"p", "kg m/s", 2, 2, PM_ROLE_OTHER, false},
                                              {"s", "J/K", 1, 4, PM_ROLE_ENTROPY, false}},
                                 5};
static const double state_values[] = {3, -4, 0.5, 2, -0.25};

// --- parameters ---

static void parameters_are_found_and_copied(void **state) {
    (void)state;
    pm_params params = {0};
    assert_int_equal(pm_params_add(&params, "a", 2, 3, true, 0.5, 1), PM_OK);
    double *value = pm_params_find(&params, "a")->value;
    assert_int_equal(pm_params_add(&params, "fixed", 1, 2, false, 0.5, 7), PM_OK);
    assert_int_equal(pm_params_add(&params, "b", 1, 1, true, 0, -2), PM_OK);
    assert_int_equal(pm_params_add(&params, "a", 2, 3, true, 0, 0), PM_OK);
    assert_ptr_equal(pm_params_find(&params, "a")->value, value);
    assert_int_equal(params.count, 3);
    assert_int_equal(pm_params_add(&params, "a", 3, 2, true, 0, 0), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "2 x 3, expected 3 x 2"));
    assert_null(pm_params_find(&params, "c"));
    assert_int_equal(pm_params_trained(&params), 7);
    double theta[7];
    pm_params_gather(&params, theta);
    assert_true(theta[0] == 1 && theta[5] == 1 && theta[6] == -2);
    pm_rng rng;
    pm_rng_init(&rng, 1, 0);
    pm_params_randomise(&params, &rng);
    assert_true(value[0] != 1 && pm_params_find(&params, "fixed")->value[1] == 7);
    assert_true(pm_params_find(&params, "b")->value[0] == -2);
    pm_params_scatter(&params, theta);
    assert_true(value[0] == 1 && value[5] == 1);
    pm_params_free(&params);
    assert_int_equal(params.count, 0);
}

// A shared entry borrows the value of its owner and is no longer trained; other entries stay.
static void shared_parameters_are_one_weight(void **state) {
    (void)state;
    pm_params a = {0}, b = {0};
    assert_int_equal(pm_params_add(&a, "w", 1, 1, true, 0, 1), PM_OK);
    assert_int_equal(pm_params_add_shared(&a, "T", 5), PM_OK);
    assert_int_equal(pm_params_add(&b, "w", 1, 1, true, 0, 2), PM_OK);
    assert_int_equal(pm_params_add_shared(&b, "T", 7), PM_OK);
    assert_int_equal(pm_params_add_shared(&b, "alone", 9), PM_OK);
    assert_int_equal(pm_params_trained(&b), 3);
    pm_params_share(&b, &a);
    pm_params_share(&b, &a); // a second time changes nothing
    assert_int_equal(pm_params_trained(&a), 2);
    assert_int_equal(pm_params_trained(&b), 2);
    assert_ptr_equal(pm_params_find(&b, "T")->value, pm_params_find(&a, "T")->value);
    assert_true(*pm_params_find(&b, "T")->value == 5 && *pm_params_find(&b, "w")->value == 2);
    assert_true(*pm_params_find(&b, "alone")->value == 9);
    pm_params_free(&b);
    pm_params_free(&a);
}

// Sizes come from files: products of them must neither wrap around nor take all memory.
static void sizes_are_bounded(void **state) {
    (void)state;
    static const char *const feature[] = {"q"}, *const acts_on[] = {"q"};
    const pm_layout large = {1, (pm_group[]){{"q", "m", 65537, 0, PM_ROLE_OTHER, false}}, 65537};
    const pm_network_spec quadratic = {
        .nfeature = 1, .feature = feature, .skip = PM_SKIP_QUADRATIC};
    const pm_operator_spec learned = {.learned = true, .nacts = 1, .acts_on = acts_on};
    pm_params params = {0};
    pm_site site = {0};
    pm_symbols_add(&site.symbols, NULL, &large, "", PM_NO_NODE);
    pm_site_add(&site, &large, "", 0);
    assert_int_equal(pm_network_declare(&quadratic, &site.symbols, 1, NULL, &params, "n"),
                     PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "65537 features, at most 4096 can be squared"));
    const pm_operator op = {&learned, PM_REVERSIBLE, PM_HARD, "reversible"};
    assert_int_equal(pm_operator_declare(&op, &site, &params), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "65537 x 65537"));
    assert_int_equal(pm_params_add(&params, "large", 4096, 4000, false, 0, 0), PM_OK);
    assert_int_equal(pm_params_add(&params, "larger", 4096, 96, false, 0, 0), PM_ENOMEM);
    assert_non_null(strstr(pm_error(), "more than 16777216 numbers in all"));
    pm_params_free(&params);
}

// --- features ---

static void features_are_their_formulas(void **state) {
    (void)state;
    static const struct {
        const char *expression;
        int size;
        double value[2];
    } c[] = {
        {"q", 2, {3, -4}},
        {"|q|", 1, {5, 0}},
        {"|q|^2", 1, {25, 0}},
        {"s", 1, {-0.25, 0}},
        {"|min(q,0)|", 1, {4, 0}},
        {"|min(q,0)|^2", 1, {16, 0}},
        {"ln|q|", 1, {1.6094379124341003, 0}},
        {"<q,p>", 1, {-6.5, 0}},
        {"q/|q|", 2, {0.6, -0.8}},
        {"q/|q|^2", 2, {0.12, -0.16}},
        {"|s|", 1, {0.25, 0}},
        {"<s,s>", 1, {0.0625, 0}},
    };
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z = pm_input(g, true, 1, 5);
    pm_symbols symbols = {0};
    pm_symbols_add(&symbols, g, &layout, "", z);
    for (size_t i = 0; i < sizeof c / sizeof *c; ++i) {
        int size = 0;
        assert_int_equal(pm_feature_size(c[i].expression, &symbols, &size), PM_OK);
        assert_int_equal(size, c[i].size);
        const pm_node node = pm_feature_build(g, c[i].expression, &symbols);
        pm_program *p = NULL;
        assert_int_equal(pm_program_open(&p, g, 1, &node, 1), PM_OK);
        memcpy(pm_program_value(p, z), state_values, sizeof state_values);
        pm_program_run(p, 1);
        for (int k = 0; k < size; ++k) {
            assert_near(c[i].expression, pm_program_value(p, node)[k], c[i].value[k], 1e-14);
        }
        pm_program_close(p);
    }
    pm_graph_close(g);
}

static void features_stay_finite_at_zero(void **state) {
    (void)state;
    static const char *const expression[] = {"|q|", "ln|q|", "|min(q,0)|", "q/|q|", "q/|q|^2"};
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z = pm_input(g, true, 1, 5);
    pm_symbols symbols = {0};
    pm_symbols_add(&symbols, g, &layout, "", z);
    const pm_node all = pm_features_build(g, 5, expression, &symbols);
    pm_node node[2] = {all};
    pm_gradient(g, all, PM_NO_NODE, 1, &z, &node[1]);
    pm_program *p = NULL;
    assert_int_equal(pm_program_open(&p, g, 2, node, 1), PM_OK);
    memset(pm_program_value(p, z), 0, 5 * sizeof(double));
    pm_program_run(p, 1);
    for (int i = 0; i < 2; ++i) {
        for (int k = 0; k < pm_graph_shape(g, node[i]).cols; ++k) {
            assert_true(isfinite(pm_program_value(p, node[i])[k]));
        }
    }
    pm_program_close(p);
    pm_graph_close(g);
}

// Angles count in their unit. The discrete derivative times the difference is that of the values.
static void sines_take_angles_in_their_unit(void **state) {
    (void)state;
    static const char *const expression[] = {"sin(phi)", "cos(phi)"};
    const pm_layout turn = {1, (pm_group[]){{"phi", "deg", 1, 0, PM_ROLE_OTHER, false}}, 1};
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node from = pm_input(g, true, 1, 1), to = pm_input(g, true, 1, 1);
    pm_symbols at[2] = {{0}, {0}};
    pm_symbols_add(&at[0], g, &turn, "", from);
    pm_symbols_add(&at[1], g, &turn, "", to);
    pm_node node[2] = {pm_features_build(g, 2, expression, &at[0]), PM_NO_NODE};
    pm_features_discrete(g, 2, expression, &at[0], &at[1], pm_constant(g, 1, 1, 2), &node[1]);
    pm_program *p = NULL;
    assert_int_equal(pm_program_open(&p, g, 2, node, 1), PM_OK);
    *pm_program_value(p, from) = 30;
    *pm_program_value(p, to) = 90;
    pm_program_run(p, 1);
    assert_near("sine", pm_program_value(p, node[0])[0], 0.5, 1e-14);
    assert_near("cosine", pm_program_value(p, node[0])[1], sqrt(0.75), 1e-14);
    assert_near("difference", 60 * *pm_program_value(p, node[1]), 0.5 - sqrt(0.75), 1e-10);
    pm_program_close(p);
    pm_graph_close(g);
}

// --- networks ---

static void set(pm_params *params, const char *name, int count, const double *value) {
    pm_param_entry *entry = pm_params_find(params, name);
    assert_non_null(entry);
    assert_int_equal(entry->rows * entry->cols, count);
    memcpy(entry->value, value, (size_t)count * sizeof *value);
}

// f = W1 act(W0 x + b0) + b1 + linear x + quadratic x x + cubic x^3 + quartic x^4, where
// x = (features - mean) / deviation.
static void networks_are_their_formulas(void **state) {
    (void)state;
    static const char *const feature[] = {"|q|", "s"};
    static const int hidden[] = {1};
    static const double mean[] = {4, -0.5}, deviation[] = {2, 0.25}, w0[] = {0.3, -0.7},
                        b0[] = {0.1}, w1[] = {1.5}, b1[] = {-0.2}, linear[] = {0.4, 0.6},
                        quadratic[] = {1, 2, 3, 4}, cubic[] = {0.7, -0.9}, quartic[] = {-2, 0.8};
    const double x[] = {0.5, 1}; // (5 - 4) / 2, (-0.25 + 0.5) / 0.25
    const double h = 0.3 * x[0] - 0.7 * x[1] + 0.1;
    const double act[] = {tanh(h), log1p(exp(h)), h / (1 + exp(-h))};
    const double form = 0.4 * x[0] + 0.6 * x[1];
    const double square = form + x[0] * x[0] + 5 * x[0] * x[1] + 4 * x[1] * x[1];
    const double fourth =
        square + 0.7 * pow(x[0], 3) - 0.9 * pow(x[1], 3) - 2 * pow(x[0], 4) + 0.8 * pow(x[1], 4);
    const double skip[] = {0, form, square, fourth};
    for (int i = 0; i < 12; ++i) {
        const pm_network_spec spec = {.nfeature = 2,
                                      .feature = feature,
                                      .nhidden = 1,
                                      .hidden = hidden,
                                      .activation = (pm_activation)(i % 3),
                                      .skip = (pm_skip)(i / 3)};
        pm_graph *g = NULL;
        assert_int_equal(pm_graph_open(&g), PM_OK);
        pm_params params = {0};
        pm_symbols symbols = {0};
        const pm_node z = pm_input(g, true, 1, 5);
        pm_symbols_add(&symbols, g, &layout, "", z);
        assert_int_equal(pm_network_declare(&spec, &symbols, 1, NULL, &params, "n"), PM_OK);
        set(&params, "n.mean", 2, mean);
        set(&params, "n.deviation", 2, deviation);
        set(&params, "n.layer0.weight", 2, w0);
        set(&params, "n.layer0.bias", 1, b0);
        set(&params, "n.output.weight", 1, w1);
        set(&params, "n.output.bias", 1, b1);
        if (spec.skip != PM_SKIP_NONE) {
            set(&params, "n.linear", 2, linear);
        }
        if (spec.skip >= PM_SKIP_QUADRATIC) {
            set(&params, "n.quadratic", 4, quadratic);
        }
        if (spec.skip == PM_SKIP_QUARTIC) {
            set(&params, "n.cubic", 2, cubic);
            set(&params, "n.quartic", 2, quartic);
        }
        const pm_node node = pm_network_build(g, &spec, &symbols, 1, &params, "n");
        pm_program *p = NULL;
        assert_int_equal(pm_program_open(&p, g, 1, &node, 1), PM_OK);
        memcpy(pm_program_value(p, z), state_values, sizeof state_values);
        pm_program_run(p, 1);
        assert_near("network", *pm_program_value(p, node), 1.5 * act[i % 3] - 0.2 + skip[i / 3],
                    1e-14);
        pm_program_close(p);
        pm_params_free(&params);
        pm_graph_close(g);
    }
}

// Beside a quartic skip the hidden layers of an energy wait while initial weights are compared, so
// that the polynomial comes first. Other networks learn all their weights together.
static void polynomials_come_first(void **state) {
    (void)state;
    static const char *const feature[] = {"s"};
    static const int hidden[] = {2};
    for (int i = 0; i < 4; ++i) {
        const pm_network_spec spec = {.nfeature = 1,
                                      .feature = feature,
                                      .nhidden = 1,
                                      .hidden = hidden,
                                      .skip = i % 2 == 0 ? PM_SKIP_QUARTIC : PM_SKIP_QUADRATIC,
                                      .scaled = i < 2};
        pm_params params = {0};
        pm_symbols symbols = {0};
        pm_graph *g = NULL;
        assert_int_equal(pm_graph_open(&g), PM_OK);
        pm_symbols_add(&symbols, g, &layout, "", pm_input(g, true, 1, 5));
        assert_int_equal(pm_network_declare(&spec, &symbols, 1, NULL, &params, "n"), PM_OK);
        assert_int_equal(pm_params_find(&params, "n.layer0.weight")->late,
                         i == 0 ? PM_LATE_LAYERS : PM_AT_ONCE);
        assert_int_equal(pm_params_find(&params, "n.layer0.bias")->late,
                         i == 0 ? PM_LATE_LAYERS : PM_AT_ONCE);
        assert_int_equal(pm_params_find(&params, "n.output.weight")->late,
                         i == 0 ? PM_LATE_LAYERS : PM_AT_ONCE);
        assert_false(pm_params_find(&params, "n.linear")->late);
        assert_false(pm_params_find(&params, "n.quadratic")->late);
        pm_params_free(&params);
        pm_graph_close(g);
    }
}

// A network with zero_at_origin is f(s) - f(0) - f'(0) s: value and slope vanish at s = 0, although
// the features are normalised about 2.
static void networks_with_zero_at_origin_are_flat_there(void **state) {
    (void)state;
    static const char *const feature[] = {"s"};
    static const int hidden[] = {1};
    const pm_network_spec spec = {.nfeature = 1,
                                  .feature = feature,
                                  .nhidden = 1,
                                  .hidden = hidden,
                                  .skip = PM_SKIP_QUADRATIC,
                                  .zero_at_origin = true};
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    pm_params params = {0};
    pm_symbols symbols = {0};
    const pm_node z = pm_input(g, true, 1, 5);
    pm_symbols_add(&symbols, g, &layout, "", z);
    assert_int_equal(pm_network_declare(&spec, &symbols, 1, NULL, &params, "n"), PM_OK);
    set(&params, "n.mean", 1, (const double[]){2});
    set(&params, "n.layer0.weight", 1, (const double[]){0.5});
    set(&params, "n.layer0.bias", 1, (const double[]){0.3});
    set(&params, "n.output.weight", 1, (const double[]){1.5});
    set(&params, "n.output.bias", 1, (const double[]){7});
    set(&params, "n.linear", 1, (const double[]){11});
    set(&params, "n.quadratic", 1, (const double[]){0.25});
    pm_node out[2] = {pm_network_build(g, &spec, &symbols, 1, &params, "n"), PM_NO_NODE};
    pm_gradient(g, out[0], PM_NO_NODE, 1, &z, &out[1]);
    pm_program *p = NULL;
    assert_int_equal(pm_program_open(&p, g, 2, out, 2), PM_OK);
    const double s[2] = {0, 0.8}, at_zero = tanh(-0.7);
    for (int i = 0; i < 2; ++i) {
        pm_program_value(p, z)[5 * i + 4] = s[i];
    }
    pm_program_run(p, 2);
    for (int i = 0; i < 2; ++i) {
        const double expected = 1.5 * (tanh(0.5 * s[i] - 0.7) - at_zero) -
                                0.75 * (1 - at_zero * at_zero) * s[i] + 0.25 * s[i] * s[i];
        assert_near("value", pm_program_value(p, out[0])[i], expected, 1e-14);
    }
    assert_near("slope at zero", pm_program_value(p, out[1])[4], 0, 1e-14);
    assert_true(fabs(pm_program_value(p, out[1])[9]) > 0.1);
    pm_program_close(p);
    pm_params_free(&params);
    pm_graph_close(g);
}

// --- mistakes ---

typedef struct mistake {
    const char *text, *words;
} mistake;

#define E "energy: {features: [q, p, s], skip: linear}\n"
#define ES E "entropy: {given: s}\n"
#define MANY "q, q, q, q, q, q, q, q, q, q, q"

static const mistake part_mistakes[] = {
    {"entropy: {given: s}\n", "needs an energy"},
    {E "irreversible: {learned: {acts_on: s}}\n", "needs an entropy"},
    {"energy: {features: [v], skip: linear}\n", "there is no \"v\" here, only q, p, s"},
    {"energy: {features: [\"|q\"], skip: linear}\n", "expected x, |x|"},
    {"energy: {features: [\"<q,s>\"], skip: linear}\n", "do not fit together"},
    {"energy: {features: [\"q/|p|\"], skip: linear}\n", "do not fit together"},
    {"energy: {features: [" MANY ", " MANY ", " MANY "]}\n", "33 expressions, at most 32"},
    {"energy: {given: v}\n", "\"v\""},
    {E "reversible: {given: [[q, v, 1.0]]}\n", "[q, v] must name two groups here of equal size"},
    {E "reversible: {given: [[q, s, 1.0]]}\n", "of equal size"},
    {E "reversible: {given: [[q, q, 1.0]]}\n", "must name two groups"},
    {E "reversible: {learned: {acts_on: [q, v]}}\n", "\"v\", which is not a group"},
    {E "reversible: {learned: {acts_on: [q], features: [dE.v]}}\n", "\"dE.v\""},
    {E "reversible: {learned: {acts_on: [q], against: [v]}}\n",
     "against names \"v\", which is not"},
    {E "reversible: {learned: {acts_on: [q], against: [q]}}\n", "\"q\", as acts_on does"},
    {ES "reversible: {learned: {acts_on: [q], along: [s]}}\n", "has 1 components, q has 2"},
    {ES "reversible: {learned: {acts_on: [s], along: [q, s]}}\n", "differ in size"},
    {ES "irreversible: {learned: {acts_on: [p], along: [" MANY ", " MANY ", " MANY "]}}\n",
     "at most 32"},
};

static const mistake port_mistakes[] = {
    {"law: bracket\nenergy: {given: a.s}\n", "stores no energy"},
    {"law: bracket\nreversible: {given: [[q, b.p, 1.0]]}\n", "[q, b.p]"},
    {"law: bracket\nreversible: {learned: {acts_on: [a.q, c.q]}}\n", "\"c.q\""},
    {"law: bracket\nreversible: {learned: {acts_on: [a.q], features: [own.q]}}\n", "\"own.q\""},
    {"law: bracket\nreversible: {learned: {acts_on: [a.q], against: [a.q, b.p]}}\n",
     "\"a.q\", as acts_on does"},
    {"law: exchange\n", "cannot be hard"},
    {"law: contact\nmatrix: [[1, 2]]\n", "model:2:9: the matrix is 1 x 2, expected 5 x 5"},
    {"law: contact\nform: soft\n", "law contact is hard, and has a matrix and nothing else"},
    {"law: contact\nenergy: s\n", "law contact is hard, and has a matrix and nothing else"},
    {"law: contact\nreversible: {given: [[a.q, b.q, 1]]}\n", "has a matrix and nothing else"},
    {"law: exchange\nform: soft\nenergy: {features: [a.q]}\n", "\"a.q\""},
    {"law: exchange\nform: soft\nreversible: {learned: {acts_on: [other.q]}}\n", "not a group"},
};

static void check_mistake(const mistake *m, bool port) {
    pm_arena arena = {0};
    pm_yaml_document *document = NULL;
    pm_yaml block;
    pm_part part = {.layout = layout};
    pm_port_model model = {.layout = {layout, layout}};
    assert_int_equal(pm_yaml_parse(&document, m->text, "model", &block), PM_OK);
    assert_int_equal(port ? pm_port_spec_read(block, (pm_yaml){0}, &arena, &model.spec)
                          : pm_part_spec_read(block, (pm_yaml){0}, &arena, &part.spec),
                     PM_OK);
    const pm_status status = port ? pm_port_declare(&model) : pm_part_declare(&part);
    if (status != PM_ECONFIG || strstr(pm_error(), m->words) == NULL ||
        strchr(pm_error(), '\n') != NULL) {
        fail_msg("%s: status %d, \"%s\", expected \"%s\"", m->text, status, pm_error(), m->words);
    }
    pm_port_free(&model);
    pm_part_free(&part);
    pm_yaml_close(document);
    pm_arena_free(&arena);
}

static void mistakes_are_named(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof part_mistakes / sizeof *part_mistakes; ++i) {
        check_mistake(&part_mistakes[i], false);
    }
    for (size_t i = 0; i < sizeof port_mistakes / sizeof *port_mistakes; ++i) {
        check_mistake(&port_mistakes[i], true);
    }
    assert_null(pm_port_law_find("contract"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parameters_are_found_and_copied),
        cmocka_unit_test(shared_parameters_are_one_weight),
        cmocka_unit_test(sizes_are_bounded),
        cmocka_unit_test(features_are_their_formulas),
        cmocka_unit_test(features_stay_finite_at_zero),
        cmocka_unit_test(sines_take_angles_in_their_unit),
        cmocka_unit_test(networks_are_their_formulas),
        cmocka_unit_test(polynomials_come_first),
        cmocka_unit_test(networks_with_zero_at_origin_are_flat_there),
        cmocka_unit_test(mistakes_are_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
