// The declaration of networks on a mesh: the names of their parameters, the order of these (the
// initial weights are drawn in it, so that another order would change every training), and the
// errors.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "graph/node.h"
#include "model/mesh/message.h"
#include "tests/support/allocations.h"

typedef struct network {
    pm_arena arena;
    pm_message_spec message;
    pm_network_spec spec;
    pm_symbols symbols;
    pm_params params;
} network;

static void open_network(network *n) {
    static const char *const field[] = {"u"};
    static const int hidden[] = {5}, elements[3] = {2, 1, 1};
    static const double size[3] = {2, 1, 1};
    *n = (network){.message = {.width = 3, .passes = 1, .within = 1}};
    assert_int_equal(pm_mesh_make(size, elements, &n->arena, &n->message.mesh), PM_OK);
    n->spec = (pm_network_spec){
        .message = &n->message, .nfeature = 1, .feature = field, .hidden = hidden};
    n->symbols = (pm_symbols){2, {{"u", 24, PM_NO_NODE}, {"f", 24, PM_NO_NODE}}};
}

static void open_driven(network *n) {
    open_network(n);
    n->message.driver = "f";
    n->message.patterns = 2;
    n->spec.nhidden = 1;
}

static void close_network(network *n) {
    pm_params_free(&n->params);
    pm_arena_free(&n->arena);
}

static void check_names(const pm_params *params, const char *expected) {
    char all[1024] = "";
    size_t used = 0;
    for (int i = 0; i < params->count; ++i) {
        used += (size_t)snprintf(all + used, sizeof all - used, "%s\n", params->entry[i].name);
        assert_true(used < sizeof all);
    }
    assert_string_equal(all, expected);
}

#define ENCODE_AND_PROCESS                                                                  \
    "r.position\nr.where0.weight\nr.where0.bias\nr.where1.weight\nr.where1.bias\nr.along\n" \
    "r.encode.where\nr.encode.field\nr.encode.bias\n"                                       \
    "r.pass0.difference\nr.pass0.source\nr.pass0.target\nr.pass0.bias\nr.edge\n"            \
    "r.pass0.edge\nr.pass0.sum\nr.pass0.own\nr.pass0.where\n"
#define PATTERNS "r.field0.patterns\nr.layer0.weight\nr.layer0.bias\n"

static void parameters_of_rates_are_in_order(void **state) {
    (void)state;
    network n;
    open_driven(&n);
    const pm_fields out = {1, n.spec.feature};
    assert_int_equal(pm_message_declare_fields(&n.spec, &n.symbols, out, &n.params, "r"), PM_OK);
    check_names(&n.params, ENCODE_AND_PROCESS PATTERNS
                "r.drive.where\nr.drive.bias\nr.drive.force\n"
                "r.drive0.target\nr.drive0.bias\nr.drive0.source\nr.drive0.edge\n"
                "r.drive0.carried\nr.drive0.sum\n"
                "r.lever.where\nr.lever.bias\nr.together.weight\n"
                "r.out.along\nr.out0.local\nr.out0.gate\nr.out0.gated\nr.out0.together\n");
    close_network(&n);
}

static void parameters_of_sums_are_in_order(void **state) {
    (void)state;
    network n;
    open_network(&n);
    n.message.patterns = 2;
    n.spec.nhidden = 1;
    assert_int_equal(pm_message_declare_sum(&n.spec, &n.symbols, &n.params, "r"), PM_OK);
    check_names(&n.params, ENCODE_AND_PROCESS PATTERNS "r.decode.weight\nr.together.weight\n");
    close_network(&n);
}

static void parameters_of_nodes_are_in_order(void **state) {
    (void)state;
    network n;
    open_network(&n);
    assert_int_equal(pm_message_declare_nodes(&n.spec, &n.symbols, 4, &n.params, "r"), PM_OK);
    check_names(&n.params, ENCODE_AND_PROCESS "r.decode.weight\nr.decode.bias\n");
    close_network(&n);
}

// The products of a driver with the first field exist for every component.
static void a_driver_of_too_many_components_is_refused(void **state) {
    (void)state;
    for (int components = PM_MAX_FEATURES; components <= PM_MAX_FEATURES + 1; ++components) {
        network n;
        open_network(&n);
        const pm_fields out = {1, n.spec.feature};
        n.message.driver = "f";
        n.message.patterns = 2;
        n.symbols.symbol[0].size = n.symbols.symbol[1].size = 8 * components;
        const pm_status status =
            pm_message_declare_fields(&n.spec, &n.symbols, out, &n.params, "r");
        assert_int_equal(status, components <= PM_MAX_FEATURES ? PM_OK : PM_ECONFIG);
        if (status != PM_OK) {
            assert_string_equal(
                pm_error(), "driven_by \"f\": 33 components per node, at most 32 with patterns");
        }
        close_network(&n);
    }
}

static void parameters_of_other_shapes_are_refused(void **state) {
    (void)state;
    network n;
    open_network(&n);
    assert_int_equal(pm_params_add(&n.params, "r.encode.field", 2, 3, true, 1, 0), PM_OK);
    assert_int_equal(pm_message_declare_sum(&n.spec, &n.symbols, &n.params, "r"), PM_ECONFIG);
    assert_string_equal(pm_error(), "parameter r.encode.field is 2 x 3, expected 3 x 3");
    close_network(&n);
}

// The declaration fails cleanly whichever allocation fails.
static void running_out_of_memory_is_an_error(void **state) {
    (void)state;
    int failures = -1;
    for (pm_status status = PM_ENOMEM; status != PM_OK; ++failures) {
        network n;
        open_driven(&n);
        allocations = 0;
        failing = failures + 2;
        status = pm_message_declare_fields(&n.spec, &n.symbols, (pm_fields){1, n.spec.feature},
                                           &n.params, "r");
        failing = 0;
        assert_true(status == PM_OK || status == PM_ENOMEM);
        close_network(&n);
    }
    assert_true(failures > 50);
}

// The graph remembers the failure, and opening its program reports it.
static void building_goes_on_without_memory(void **state) {
    (void)state;
    const pm_fields out = {1, (const char *const[]){"u"}};
    network n;
    open_driven(&n);
    assert_int_equal(pm_message_declare_fields(&n.spec, &n.symbols, out, &n.params, "r"), PM_OK);
    int failures = -1;
    for (bool exhausted = true; exhausted; ++failures) {
        pm_graph *g = NULL;
        assert_int_equal(pm_graph_open(&g), PM_OK);
        allocations = 0;
        failing = failures + 2;
        n.symbols.symbol[0].node = pm_input(g, true, 1, 24);
        n.symbols.symbol[1].node = pm_input(g, true, 1, 24);
        pm_message_build_fields(g, &n.spec, &n.symbols, out, &n.params, "r");
        failing = 0;
        exhausted = pm_graph_exhausted(g);
        pm_graph_close(g);
    }
    assert_true(failures > 2);
    close_network(&n);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(parameters_of_rates_are_in_order),
        cmocka_unit_test(parameters_of_sums_are_in_order),
        cmocka_unit_test(parameters_of_nodes_are_in_order),
        cmocka_unit_test(a_driver_of_too_many_components_is_refused),
        cmocka_unit_test(parameters_of_other_shapes_are_refused),
        cmocka_unit_test(running_out_of_memory_is_an_error),
        cmocka_unit_test(building_goes_on_without_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
