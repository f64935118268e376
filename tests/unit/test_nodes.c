// Converts fields of a body into trajectories of nodal values, and back.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/rng.h"
#include "body/nodes.h"

#define NNODE 36 // of 3 x 2 x 2 bricks, 27 of them free
#define NFREE 27
#define NTIME 5
#define DT 0.1
#define VARIABLES "vx vy vz qx qy qz sxx syy szz sxy sxz syz"
#define V 0 // columns
#define Q 3
#define SIGMA 6

static const double corner[3] = {-1, 5, 0.5}, brick[3] = {2, 0.3, 1};
static const pm_nodes_settings settings = {.nbranch = 2, .tau = {0.2, 0.7}, .temperature = 250};

// A smooth field whose values differ between places, times and components.
static double value_at(const double *x, int trajectory, int time, int component) {
    return sin(x[0] + 2 * x[1] - 3 * x[2] + 0.4 * time * (component + 1) + trajectory);
}

// Makes a field whose nodes are in no particular order.
static pm_field *make_field(void) {
    pm_field *field = NULL;
    pm_rng rng;
    int order[NNODE] = {0};
    const pm_field_shape shape = {2, NTIME, NNODE, 12, 0, false};
    assert_int_equal(pm_field_new(&field, shape, DT, VARIABLES), PM_OK);
    pm_rng_init(&rng, 1, 0);
    for (int i = 0; i < NNODE; ++i) {
        const int other = (int)pm_rng_below(&rng, (uint64_t)i + 1);
        order[i] = order[other];
        order[other] = i;
    }
    for (int i = 0; i < NNODE; ++i) {
        const int at[3] = {order[i] % 4, order[i] / 4 % 3, order[i] / 12};
        for (int c = 0; c < 3; ++c) {
            field->position[3 * i + c] = corner[c] + at[c] * brick[c];
        }
    }
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < NTIME; ++j) {
            for (int n = 0; n < NNODE; ++n) {
                const double *x = field->position + 3 * (ptrdiff_t)n;
                for (int k = 0; k < 12; ++k) {
                    const double place = k >= Q && k < Q + 3 ? x[k - Q] : 0;
                    pm_field_state(field, i, j)[12 * n + k] = place + value_at(x, i, j, k);
                }
                for (int k = 0; k < 3; ++k) {
                    pm_field_force(field, i, j)[3 * n + k] = value_at(x, i, j, 12 + k);
                }
            }
        }
    }
    return field;
}

static pm_dataset *make_nodes(const pm_field *field, int count, const int *which) {
    pm_dataset *nodes = NULL;
    if (pm_nodes_dataset(&nodes, field, count, which, &settings) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return nodes;
}

// Computes the place of a free node.
static void place_of(int node, double x[3]) {
    const int at[3] = {node % 3 + 1, node / 3 % 3, node / 9};
    for (int c = 0; c < 3; ++c) {
        x[c] = corner[c] + at[c] * brick[c];
    }
}

static void check(const char *what, int node, double value, double expected, double tolerance) {
    if (!(fabs(value - expected) <= tolerance)) {
        fail_msg("%s of node %d: %.17g, expected %.17g", what, node, value, expected);
    }
}

// Nodal values are rounded to single precision.
#define ROUNDING 1e-6

static int column(const pm_dataset *nodes, const char *name) {
    for (int i = 0; i < nodes->ncolumn; ++i) {
        if (strcmp(nodes->column[i], name) == 0) {
            return i;
        }
    }
    fail_msg("there is no column %s", name);
    return -1;
}

// The force is that at the end of the step; the last state has its own force.
static void free_nodes_are_columns_in_the_order_of_the_mesh(void **state) {
    (void)state;
    pm_field *field = make_field();
    const int which[] = {1, 0};
    pm_dataset *nodes = make_nodes(field, 2, which);
    assert_int_equal(nodes->ntrajectory, 2);
    assert_int_equal(nodes->ntime, NTIME);
    assert_int_equal(nodes->ncolumn, NFREE * (3 + 2 * 3 + 6 + 3) + 1);
    assert_true(nodes->dt == DT);
    const int u = column(nodes, "u0"), sigma = column(nodes, "sigma0"), f = column(nodes, "f0");
    assert_int_equal(column(nodes, "u80") - u, 80);
    assert_int_equal(column(nodes, "sigma161") - sigma, 161);
    assert_int_equal(column(nodes, "f80") - f, 80);
    for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < NTIME; ++j) {
            const double *row = pm_dataset_state(nodes, i, j);
            const int end = j + 1 < NTIME ? j + 1 : j;
            for (int n = 0; n < NFREE; ++n) {
                double x[3];
                place_of(n, x);
                for (int k = 0; k < 3; ++k) {
                    check("u", n, row[u + 3 * n + k], value_at(x, which[i], j, Q + k), ROUNDING);
                    check("f", n, row[f + 3 * n + k], value_at(x, which[i], end, 12 + k), ROUNDING);
                }
                for (int k = 0; k < 6; ++k) {
                    check("sigma", n, row[sigma + 6 * n + k], value_at(x, which[i], j, SIGMA + k),
                          ROUNDING);
                }
            }
        }
    }
    pm_dataset_free(nodes);
    pm_field_free(field);
}

static void only_the_first_states_are_taken(void **state) {
    (void)state;
    pm_field *field = make_field();
    pm_dataset *nodes = NULL;
    pm_nodes_settings fewer = settings;
    fewer.nstate = 2;
    assert_int_equal(pm_nodes_dataset(&nodes, field, 1, (const int[]){1}, &fewer), PM_OK);
    assert_int_equal(nodes->ntime, 2);
    double x[3];
    place_of(0, x);
    // The force of the next state is known, although that state is not written.
    check("f", 0, pm_dataset_state(nodes, 0, 1)[column(nodes, "f0")], value_at(x, 1, 2, 12),
          ROUNDING);
    pm_dataset_free(nodes);
    pm_field_free(field);
}

static void memories_follow_displacements(void **state) {
    (void)state;
    pm_field *field = make_field();
    pm_dataset *nodes = make_nodes(field, 1, (const int[]){1});
    const char *const name[] = {"m0_0", "m1_0"};
    const int u = column(nodes, "u0");
    for (int b = 0; b < 2; ++b) {
        const int m = column(nodes, name[b]);
        // Each branch is zero at first, and follows the value at the beginning of each step.
        for (int i = 0; i < 3 * NFREE; ++i) {
            double memory = 0;
            for (int j = 0; j < NTIME; ++j) {
                const double *row = pm_dataset_state(nodes, 0, j);
                check("memory", i / 3, row[m + i], memory, ROUNDING);
                memory = row[u + i] + (memory - row[u + i]) * exp(-DT / settings.tau[b]);
            }
        }
    }
    pm_dataset_free(nodes);
    pm_field_free(field);
}

static void what_is_dissipated_is_entropy(void **state) {
    (void)state;
    pm_field *field = make_field();
    pm_dataset *nodes = NULL;
    double *energy = field->energy;
    for (int j = 0; j < NTIME; ++j) {
        energy[(NTIME + j) * PM_FIELD_ENERGIES + 1] = 1000.0 * j;
    }
    nodes = make_nodes(field, 1, (const int[]){1});
    const int s = column(nodes, "s");
    for (int j = 0; j < NTIME; ++j) {
        check("s", j, pm_dataset_state(nodes, 0, j)[s], 4 * j, ROUNDING);
    }
    pm_dataset_free(nodes);
    field->energy = NULL;
    nodes = make_nodes(field, 1, (const int[]){1});
    check("s", 0, pm_dataset_state(nodes, 0, NTIME - 1)[s], 0, 0);
    pm_dataset_free(nodes);
    pm_field_free(field);
}

static bool is_held(const pm_field *field, int node) {
    return field->position[3 * node] == corner[0];
}

static void back_again_is_the_body(void **state) {
    (void)state;
    pm_field *field = make_field(), *back = NULL;
    const int which[] = {1};
    pm_dataset *nodes = make_nodes(field, 1, which);
    for (int j = 0; j < NTIME; ++j) { // so that something is not simply copied
        pm_dataset_state(nodes, 0, j)[column(nodes, "u0")] += 0.25;
    }
    assert_int_equal(pm_nodes_fields(&back, nodes, field, which), PM_OK);
    assert_null(back->energy);
    assert_true(back->ntrajectory == 1 && back->ntime == NTIME && back->nnode == NNODE);
    assert_memory_equal(back->position, field->position, 3 * NNODE * sizeof(double));
    assert_memory_equal(pm_field_force(back, 0, 0), pm_field_force(field, 1, 0),
                        NTIME * 3 * NNODE * sizeof(double));
    double first[3];
    place_of(0, first);
    for (int j = 0; j < NTIME; ++j) {
        const double *z = pm_field_state(back, 0, j), *old = pm_field_state(field, 1, j);
        const double *before = pm_field_state(back, 0, j > 0 ? j - 1 : 0);
        for (int n = 0; n < NNODE; ++n) {
            const bool moved = memcmp(field->position + 3 * (ptrdiff_t)n, first, sizeof first) == 0;
            for (int k = 0; k < 3; ++k) {
                const int q = 12 * n + Q + k, v = 12 * n + V + k;
                const double expected = old[q] + (moved && k == 0 ? 0.25 : 0);
                check("position", n, z[q], expected, is_held(field, n) ? 0 : ROUNDING);
                check("velocity", n, z[v], j == 0 ? old[v] : (z[q] - before[q]) / DT, ROUNDING);
            }
            for (int k = SIGMA; k < SIGMA + 6; ++k) {
                check("stress", n, z[12 * n + k], old[12 * n + k],
                      is_held(field, n) ? 0 : ROUNDING);
            }
        }
    }
    pm_field_free(back);
    pm_dataset_free(nodes);
    pm_field_free(field);
}

// --- refusals ---

static void assert_refused(const pm_field *field, const char *words) {
    pm_dataset *nodes = NULL;
    const pm_status status = pm_nodes_dataset(&nodes, field, 1, (const int[]){0}, &settings);
    if (status != PM_EDATA || strstr(pm_error(), words) == NULL || nodes != NULL) {
        fail_msg("status %d, error \"%s\", expected %d and \"%s\"", status, pm_error(), PM_EDATA,
                 words);
    }
}

static void what_is_no_box_is_refused(void **state) {
    (void)state;
    pm_field *field = make_field();
    double kept[3 * NNODE], *x = field->position;
    memcpy(kept, x, sizeof kept);
    field->nnode = NNODE - 1;
    assert_refused(field, "35 nodes do not form a box of bricks");
    field->nnode = NNODE;
    for (int i = 0; i < NNODE; ++i) { // flat
        x[3 * i + 1] = 0;
    }
    assert_refused(field, "36 nodes do not form a box of bricks");
    memcpy(x, kept, sizeof kept);
    int inner = 0, other = 0;
    for (int i = 0; i < NNODE; ++i) {
        const bool is_inner = fabs(x[3 * i] - (corner[0] + 2)) < 0.1 &&
                              fabs(x[3 * i + 1] - (corner[1] + 0.3)) < 0.1 &&
                              fabs(x[3 * i + 2] - (corner[2] + 1)) < 0.1;
        inner = is_inner ? i : inner;
        other = !is_inner && !is_held(field, i) ? i : other;
    }
    x[3 * inner] += 0.01;
    char words[64];
    snprintf(words, sizeof words, "node %d is off the grid", inner);
    assert_refused(field, words);
    memcpy(x + 3 * (ptrdiff_t)inner, x + 3 * (ptrdiff_t)other, 3 * sizeof *x);
    assert_refused(field, "some are missing");
    memcpy(x, kept, sizeof kept);
    field->variable = "vx vy vz qx qy qz sxx syy szz sxy sxz syx";
    assert_refused(field, "expected variables qx qy qz and sxx syy szz sxy sxz syz, found vx vy");
    pm_field_free(field);
}

static void other_columns_than_the_bodys_are_refused(void **state) {
    (void)state;
    pm_field *field = make_field(), *back = NULL;
    const int which[] = {0};
    pm_dataset *nodes = make_nodes(field, 1, which);
    const char *name[NFREE * 18 + 1];
    memcpy(name, nodes->column, sizeof name);
    nodes->column = name;
    const int at[] = {column(nodes, "u0"), column(nodes, "u80"), column(nodes, "sigma161")};
    for (int i = 0; i < 3; ++i) {
        const char *kept = name[at[i]];
        name[at[i]] = "x";
        assert_int_equal(pm_nodes_fields(&back, nodes, field, which), PM_EDATA);
        assert_non_null(strstr(pm_error(), "expected columns u[0:81], sigma[0:162] and 5 states"));
        name[at[i]] = kept;
    }
    nodes->ntime = NTIME - 1;
    assert_int_equal(pm_nodes_fields(&back, nodes, field, which), PM_EDATA);
    assert_null(back);
    pm_dataset_free(nodes);
    pm_field_free(field);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(free_nodes_are_columns_in_the_order_of_the_mesh),
        cmocka_unit_test(only_the_first_states_are_taken),
        cmocka_unit_test(memories_follow_displacements),
        cmocka_unit_test(what_is_dissipated_is_entropy),
        cmocka_unit_test(back_again_is_the_body),
        cmocka_unit_test(what_is_no_box_is_refused),
        cmocka_unit_test(other_columns_than_the_bodys_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
