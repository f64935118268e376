// The eight symmetric copies of a body with a square section: each maps the body onto itself, and
// tensors turn with vectors.
#include <math.h>
#include <string.h>

#include "bodies/solid/symmetry_copies.h"
#include "tests/support/boxes.h"
#include "tests/support/unit.h"

static const int square[3] = {3, 2, 2};

// Makes a field of the nodes of a box whose axis is the x axis.
static pm_field centred(box *b, const int count[3]) {
    box_make(b, count, 0.5);
    for (int i = 0; i < b->placed.nnode; ++i) {
        b->position[i][1] -= 0.25 * count[1];
        b->position[i][2] -= 0.25 * count[2];
    }
    return (pm_field){.nnode = b->placed.nnode, .position = b->position[0]};
}

static void every_copy_maps_the_body_onto_itself(void **state) {
    (void)state;
    box b;
    const pm_field field = centred(&b, square);
    pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE];
    pm_arena arena = {0};
    double place[3 * MOST_NODES];
    assert_int_equal(pm_symmetry_copies_make(copy, &field, &arena), PM_OK);
    for (int c = 0; c < PM_SYMMETRY_COPIES_OF_SQUARE; ++c) {
        pm_copy_vectors(&copy[c], field.nnode, field.position, 3, place);
        for (int i = 0; i < 3 * field.nnode; ++i) {
            assert_true(fabs(place[i] - field.position[i]) < 1e-12);
        }
        for (int other = 0; other < c; ++other) {
            assert_memory_not_equal(copy[c].node, copy[other].node,
                                    (size_t)field.nnode * sizeof *copy[c].node);
        }
    }
    for (int i = 0; i < field.nnode; ++i) {
        assert_int_equal(copy[0].node[i], i);
    }
    pm_arena_free(&arena);
}

// Writes the symmetric tensors v v^T of vectors as xx yy zz xy xz yz.
static void square_of(int count, double vector[][3], double tensor[][6]) {
    static const int row[6] = {0, 1, 2, 0, 0, 1}, column[6] = {0, 1, 2, 1, 2, 2};
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < 6; ++k) {
            tensor[i][k] = vector[i][row[k]] * vector[i][column[k]];
        }
    }
}

static void tensors_turn_with_vectors(void **state) {
    (void)state;
    box b;
    const pm_field field = centred(&b, square);
    pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE];
    pm_arena arena = {0};
    double v[MOST_NODES][3], turned[MOST_NODES][3];
    double t[MOST_NODES][6], image[MOST_NODES][6], expected[MOST_NODES][6];
    for (int i = 0; i < 3 * field.nnode; ++i) {
        v[i / 3][i % 3] = sin(1.0 + 7 * i);
    }
    square_of(field.nnode, v, t);
    assert_int_equal(pm_symmetry_copies_make(copy, &field, &arena), PM_OK);
    for (int c = 0; c < PM_SYMMETRY_COPIES_OF_SQUARE; ++c) {
        pm_copy_vectors(&copy[c], field.nnode, v[0], 3, turned[0]);
        pm_copy_tensors(&copy[c], field.nnode, t[0], 6, image[0]);
        square_of(field.nnode, turned, expected);
        for (int i = 0; i < 6 * field.nnode; ++i) {
            assert_true(fabs(image[i / 6][i % 6] - expected[i / 6][i % 6]) < 1e-12);
        }
    }
    pm_arena_free(&arena);
}

static void what_is_not_square_is_refused(void **state) {
    (void)state;
    static const int flat[3] = {3, 2, 1};
    box b;
    const pm_field field = centred(&b, flat);
    pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE];
    pm_arena arena = {0};
    assert_int_equal(pm_symmetry_copies_make(copy, &field, &arena), PM_EDATA);
    assert_non_null(strstr(pm_error(), "not symmetric like a square"));
    pm_arena_free(&arena);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_copy_maps_the_body_onto_itself),
        cmocka_unit_test(tensors_turn_with_vectors),
        cmocka_unit_test(what_is_not_square_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
