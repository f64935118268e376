// The free form: a linear network gives the linear rate of its weights, over the own state in a
// part and over the states of both ends in a port. Potentials and operators beside it are refused.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "graph/program.h"
#include "model/part.h"
#include "model/port.h"
#include "tests/support/unit.h"

#define NZ 3

static const pm_layout layout = {.ngroup = 2,
                                 .group = (pm_group[]){{"q", "m", 2, 0, PM_ROLE_OTHER, false},
                                                       {"s", "J/K", 1, 2, PM_ROLE_ENTROPY, false}},
                                 .nz = NZ};
static const char *const own[] = {"q", "s"};
static const char *const both[] = {"own.s", "other.q"};

static void set(const pm_params *params, const char *name, int count, const double *value) {
    pm_param_entry *entry = pm_params_find(params, name);
    assert_non_null(entry);
    assert_int_equal(entry->rows * entry->cols, count);
    memcpy(entry->value, value, (size_t)count * sizeof *value);
}

static void assert_rate(pm_graph *g, pm_node rate, int ninput, const pm_node *input,
                        const double z[][NZ], const double *expected) {
    pm_program *program = NULL;
    assert_int_equal(pm_program_open(&program, g, 1, &rate, 1), PM_OK);
    for (int i = 0; i < ninput; ++i) {
        memcpy(pm_program_value(program, input[i]), z[i], sizeof z[i]);
    }
    pm_program_run(program, 1);
    for (int i = 0; i < NZ; ++i) {
        const double value = pm_program_value(program, rate)[i];
        if (!(fabs(value - expected[i]) <= 1e-15)) {
            fail_msg("component %d: %.17g, expected %.17g", i, value, expected[i]);
        }
    }
    pm_program_close(program);
}

static void part_is_its_network(void **state) {
    (void)state;
    pm_part part = {
        .layout = layout,
        .spec = {.form = PM_FREE, .rate = {.nfeature = 2, .feature = own, .skip = PM_SKIP_LINEAR}}};
    assert_int_equal(pm_part_declare(&part), PM_OK);
    assert_false(pm_part_has_energy(&part) || pm_part_has_entropy(&part));
    set(&part.params, "rate.scale", NZ, (const double[]){1, 1, 4});
    set(&part.params, "rate.linear", NZ * NZ, (const double[]){0, 1, 0, -1, 0, 0, 0, 0, 0.5});
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z = pm_input(g, true, 1, NZ);
    pm_node degeneracy = PM_NO_NODE, dE;
    pm_gradient(g, pm_part_energy(g, &part, z), PM_NO_NODE, 1, &z, &dE);
    assert_int_equal(dE, PM_NO_NODE);
    const pm_node rate = pm_part_bulk(g, &part, z, dE, PM_NO_NODE, &degeneracy);
    assert_int_equal(degeneracy, PM_NO_NODE);
    assert_rate(g, rate, 1, &z, (const double[][NZ]){{2, 3, 5}}, (const double[]){-3, 2, 10});
    pm_graph_close(g);
    pm_part_free(&part);
}

static void port_sees_both_ends(void **state) {
    (void)state;
    pm_port_model port = {
        .layout = {layout, layout},
        .spec = {.law = "exchange",
                 .form = PM_FREE,
                 .rate = {.nfeature = 2, .feature = both, .skip = PM_SKIP_LINEAR}}};
    assert_int_equal(pm_port_declare(&port), PM_OK);
    set(&port.params, "a.rate.linear", NZ * NZ, (const double[]){0, 0, 1, 1, 0, 0, 0, 1, 0});
    set(&port.params, "b.rate.linear", NZ * NZ, (const double[]){0, 0, 0, 0, 0, 0, 0, 0, 2});
    const double z[2][NZ] = {{2, 3, 5}, {7, 11, 13}};
    const double expected[2][NZ] = {{7, 11, 5}, {0, 0, 6}};
    for (int end = 0; end < 2; ++end) {
        pm_graph *g = NULL;
        assert_int_equal(pm_graph_open(&g), PM_OK);
        const pm_node input[2] = {pm_input(g, true, 1, NZ), pm_input(g, true, 1, NZ)};
        const pm_port_nodes shown[2] = {{input[0], PM_NO_NODE, PM_NO_NODE, PM_NO_NODE},
                                        {input[1], PM_NO_NODE, PM_NO_NODE, PM_NO_NODE}};
        pm_node degeneracy = PM_NO_NODE;
        const pm_node rate = port.law->rate(g, &port, (pm_end)end, shown, &degeneracy);
        assert_rate(g, rate, 2, input, z, expected[end]);
        pm_graph_close(g);
    }
    pm_port_free(&port);
}

// Features of the other end need not make sense at the end without a term.
static void port_acts_at_one_end(void **state) {
    (void)state;
    static const char *const mine[] = {"own.q"};
    const pm_layout other = {
        .ngroup = 1, .group = (pm_group[]){{"w", "1", 1, 0, PM_ROLE_OTHER, false}}, .nz = 1};
    pm_port_model port = {
        .layout = {layout, other},
        .spec = {.law = "exchange",
                 .form = PM_FREE,
                 .rate = {.nfeature = 1, .feature = mine, .skip = PM_SKIP_LINEAR}}};
    assert_int_equal(pm_port_declare(&port), PM_ECONFIG);
    pm_port_free(&port);
    port.params = (pm_params){0};
    port.spec.ends = PM_END_A_ALONE;
    assert_int_equal(pm_port_declare(&port), PM_OK);
    assert_non_null(pm_params_find(&port.params, "a.rate.linear"));
    assert_null(pm_params_find(&port.params, "b.rate.linear"));
    pm_graph *g = NULL;
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_port_nodes shown[2] = {{pm_input(g, true, 1, NZ), PM_NO_NODE, PM_NO_NODE, PM_NO_NODE},
                                    {pm_input(g, true, 1, 1), PM_NO_NODE, PM_NO_NODE, PM_NO_NODE}};
    pm_node degeneracy = PM_NO_NODE;
    assert_int_not_equal(port.law->rate(g, &port, PM_END_A, shown, &degeneracy), PM_NO_NODE);
    assert_int_equal(port.law->rate(g, &port, PM_END_B, shown, &degeneracy), PM_NO_NODE);
    pm_graph_close(g);
    pm_port_free(&port);
}

static void nothing_stands_beside_a_rate(void **state) {
    (void)state;
    static const char *const s[] = {"s"};
    const pm_potential_spec entropy = {.ngiven = 1, .given = s};
    pm_part part = {.layout = layout, .spec = {.form = PM_FREE, .entropy = entropy}};
    assert_int_equal(pm_part_declare(&part), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "a rate and nothing else"));
    pm_port_model port = {.layout = {layout, layout},
                          .spec = {.law = "exchange", .form = PM_FREE, .energy = entropy}};
    assert_int_equal(pm_port_declare(&port), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "a rate and nothing else"));
    port.spec = (pm_port_spec){.law = "bracket", .form = PM_FREE};
    assert_int_equal(pm_port_declare(&port), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "cannot be free"));
    pm_part_free(&part);
    pm_port_free(&port);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(part_is_its_network),
        cmocka_unit_test(port_sees_both_ends),
        cmocka_unit_test(port_acts_at_one_end),
        cmocka_unit_test(nothing_stands_beside_a_rate),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
