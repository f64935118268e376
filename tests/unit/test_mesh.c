// The graph of a box of bricks: numbers and order of nodes and edges, the nodes that edges join,
// and the features of both.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "model/mesh/mesh.h"

// 3 x 2 x 1 bricks of 2 x 0.5 x 3 m.
static const double size[3] = {6, 1, 3};
static const int elements[3] = {3, 2, 1};
#define NNODE (3 * 3 * 2)

static const pm_mesh *make(pm_arena *arena) {
    const pm_mesh *mesh = NULL;
    assert_int_equal(pm_mesh_make(size, elements, arena, &mesh), PM_OK);
    return mesh;
}

static void nodes_are_numbered_along_x_then_y_then_z(void **state) {
    (void)state;
    pm_arena arena = {0};
    const pm_mesh *mesh = make(&arena);
    assert_int_equal(mesh->nnode, NNODE);
    assert_memory_equal(mesh->size, size, sizeof size);
    assert_memory_equal(mesh->elements, elements, sizeof elements);
    int n = 0;
    for (int k = 0; k <= 1; ++k) {
        for (int j = 0; j <= 2; ++j) {
            for (int i = 1; i <= 3; ++i) {
                assert_int_equal(pm_mesh_node(mesh, (const int[]){i, j, k}), n);
                ++n;
            }
        }
    }
    pm_arena_free(&arena);
}

// Edges of bricks between free nodes: along x 2 x 3 x 2, along y 3 x 2 x 2, along z 3 x 3 x 1.
static void every_edge_of_a_brick_has_two_ways(void **state) {
    (void)state;
    pm_arena arena = {0};
    const pm_mesh *mesh = make(&arena);
    assert_int_equal(mesh->nedge, 2 * (12 + 12 + 9));
    static const int step[3] = {1, 3, 9}; // in numbers of nodes
    for (int e = 0; e < mesh->nedge; ++e) {
        const int d = mesh->direction[e], s = mesh->source[e], t = mesh->target[e];
        assert_true(d >= 0 && d < PM_MESH_DIRECTIONS && s >= 0 && s < NNODE);
        assert_int_equal(t - s, d % 2 == 0 ? step[d / 2] : -step[d / 2]);
        int same = 0, reverse = 0;
        for (int k = 0; k < mesh->nedge; ++k) {
            same += mesh->source[k] == s && mesh->target[k] == t;
            reverse +=
                mesh->source[k] == t && mesh->target[k] == s && mesh->direction[k] == (d ^ 1);
        }
        assert_int_equal(same, 1);
        assert_int_equal(reverse, 1);
    }
    pm_arena_free(&arena);
}

static void nodes_know_where_they_are(void **state) {
    (void)state;
    pm_arena arena = {0};
    const pm_mesh *mesh = make(&arena);
    double feature[NNODE][PM_MESH_NODE_FEATURES];
    pm_mesh_node_features(mesh, feature[0]);
    static const struct {
        int at[3];
        double feature[PM_MESH_NODE_FEATURES];
    } known[] = {
        {{1, 0, 0}, {-1 + 2 / 3.0, -1, -1, 0, 1, 1}},
        {{2, 1, 0}, {-1 + 4 / 3.0, 0, -1, 0, 0, 1}}, // inside but for its one layer along z
        {{3, 1, 1}, {1, 0, 1, 1, 0, 1}},
        {{3, 2, 0}, {1, 1, -1, 1, 1, 1}},
    };
    for (size_t i = 0; i < sizeof known / sizeof *known; ++i) {
        for (int c = 0; c < PM_MESH_NODE_FEATURES; ++c) {
            const double found = feature[pm_mesh_node(mesh, known[i].at)][c];
            if (!(fabs(found - known[i].feature[c]) < 1e-15)) {
                fail_msg("case %zu: feature %d is %g, expected %g", i, c, found,
                         known[i].feature[c]);
            }
        }
    }
    pm_arena_free(&arena);
}

static void directions_know_where_they_lead(void **state) {
    (void)state;
    pm_arena arena = {0};
    double feature[PM_MESH_DIRECTIONS * PM_MESH_EDGE_FEATURES];
    static const double expected[] = {
        1, 0,  0, 2 / 3.0, -1, 0, 0, 2 / 3.0, 0, 1, 0,  0.5 / 3,
        0, -1, 0, 0.5 / 3, 0,  0, 1, 1,       0, 0, -1, 1,
    };
    pm_mesh_edge_features(make(&arena), feature);
    for (int i = 0; i < PM_MESH_DIRECTIONS * PM_MESH_EDGE_FEATURES; ++i) {
        if (!(fabs(feature[i] - expected[i]) < 1e-15)) {
            fail_msg("number %d is %g, expected %g", i, feature[i], expected[i]);
        }
    }
    pm_arena_free(&arena);
}

static void what_is_no_box_is_refused(void **state) {
    (void)state;
    static const struct {
        double size[3];
        int elements[3];
        const char *words;
    } bad[] = {
        {{0, 1, 1}, {1, 1, 1}, "must be positive"},
        {{1, -1, 1}, {1, 1, 1}, "must be positive"},
        {{1, 1, NAN}, {1, 1, 1}, "must be positive"},
        {{1, 1, 1}, {0, 1, 1}, "must be positive"},
        {{1, 1, 1}, {1, 1, -3}, "must be positive"},
        {{1, 1, 1}, {5001, 1, 1}, "20004 nodes, at most 20000"},
        {{1, 1, 1}, {2147483647, 2147483647, 2147483647}, "nodes, at most 20000"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        pm_arena arena = {0};
        const pm_mesh *mesh = NULL;
        assert_int_equal(pm_mesh_make(bad[i].size, bad[i].elements, &arena, &mesh), PM_ECONFIG);
        assert_null(mesh);
        assert_non_null(strstr(pm_error(), bad[i].words));
        pm_arena_free(&arena);
    }
    pm_arena arena = {0};
    const pm_mesh *mesh = NULL;
    assert_int_equal(pm_mesh_make(size, (const int[]){5000, 1, 1}, &arena, &mesh), PM_OK);
    assert_int_equal(mesh->nnode, PM_MESH_MOST_NODES);
    pm_arena_free(&arena);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nodes_are_numbered_along_x_then_y_then_z),
        cmocka_unit_test(every_edge_of_a_brick_has_two_ways),
        cmocka_unit_test(nodes_know_where_they_are),
        cmocka_unit_test(directions_know_where_they_lead),
        cmocka_unit_test(what_is_no_box_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
