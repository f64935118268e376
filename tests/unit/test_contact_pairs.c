// Two boxes of bricks across a gap: which points face each other, and how their openings change
// when the boxes move.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "bodies/solid/contact_pairs.h"
#include "tests/support/boxes.h"
#include "tests/support/unit.h"

// The lower box is [0,8] x [0,4] x [0,2]. The upper one crosses it above x = 2 .. 5; its own x
// points along the global +y and its y along -x. No node of one lies straight above a node of the
// other.
typedef struct scene {
    box lower, upper;
    pm_arena arena;
    pm_contact_pairs pairs;
    double *value; // [PM_CONTACT_GROUPS][npair]
} scene;

static void make_scene(scene *s) {
    memset(s, 0, sizeof *s);
    box_make(&s->lower, (int[3]){4, 2, 1}, 2);
    box_make(&s->upper, (int[3]){6, 2, 1}, 1.5);
    s->upper.placed.placement =
        (pm_placement){.origin = {5, -2.5, 2 + GAP}, .axis = {1, 0, 2}, .sign = {1, -1, 1}};
    assert_int_equal(
        pm_contact_pairs_find(&s->pairs, &s->lower.placed, &s->upper.placed, &s->arena), PM_OK);
    s->value =
        pm_arena_array(&s->arena, PM_CONTACT_GROUPS * (size_t)s->pairs.npair, sizeof *s->value);
}

// Displaces a box by a function of the place in the global frame.
typedef void displacement(const double *x, double *u);
static void move(box *b, displacement *by) {
    for (int n = 0; n < b->placed.nnode; ++n) {
        double x[3], u[3];
        pm_placement_point(&b->placed.placement, b->position[n], x);
        by(x, u);
        pm_placement_rotate_back(&b->placed.placement, u, b->u[n]);
    }
}

static void stay(const double *x, double *u) {
    (void)x;
    memset(u, 0, 3 * sizeof *u);
}

static void measure(scene *s, displacement *lower, displacement *upper) {
    move(&s->lower, lower);
    move(&s->upper, upper);
    memset(s->value, 0, PM_CONTACT_GROUPS * (size_t)s->pairs.npair * sizeof *s->value);
    pm_contact_pairs_measure(&s->pairs, 0, &s->lower.placed, s->lower.u[0], s->value);
    pm_contact_pairs_measure(&s->pairs, 1, &s->upper.placed, s->upper.u[0], s->value);
}

static double get(const scene *s, int group, int pair) {
    return s->value[group * s->pairs.npair + pair];
}

static double opening(const scene *s, int i) {
    return s->pairs.pair[i].gap + get(s, PM_CONTACT_GAP, i) +
           get(s, PM_CONTACT_SLID_U, i) * get(s, PM_CONTACT_SLOPE_U, i) +
           get(s, PM_CONTACT_SLID_V, i) * get(s, PM_CONTACT_SLOPE_V, i);
}

// A component of a vector in the global frame, from its components along the tangents of a pair.
static double along(const scene *s, int first_group, int pair, int axis) {
    const pm_contact_pair *p = &s->pairs.pair[pair];
    return get(s, first_group, pair) * p->tangent[0][axis] +
           get(s, first_group + 1, pair) * p->tangent[1][axis];
}

// Computes the place of a point of a pair in the global frame.
static void place(const scene *s, int i, int end, double *x) {
    const box *b = end == 0 ? &s->lower : &s->upper;
    const pm_contact_point *point = &s->pairs.pair[i].point[end];
    memset(x, 0, 3 * sizeof *x);
    for (int k = 0; k < point->nnode; ++k) {
        double at[3];
        pm_placement_point(&b->placed.placement, b->position[point->node[k]], at);
        for (int d = 0; d < 3; ++d) {
            x[d] += point->value[k] * at[d];
        }
    }
}

static void points_face_each_other(void **state) {
    (void)state;
    scene s;
    make_scene(&s);
    // The pairs are the top nodes of the lower box with x = 2, 4 and y = 0, 2, 4.
    assert_int_equal(s.pairs.npair, 6);
    for (int i = 0; i < s.pairs.npair; ++i) {
        double x[2][3];
        place(&s, i, 0, x[0]);
        place(&s, i, 1, x[1]);
        boxes_check("x", i, x[1][0], x[0][0]);
        boxes_check("y", i, x[1][1], x[0][1]);
        boxes_check("z of the lower", i, x[0][2], 2);
        boxes_check("z of the upper", i, x[1][2], 2 + GAP);
        boxes_check("gap", i, s.pairs.pair[i].gap, GAP);
        assert_true(x[0][0] == 2 || x[0][0] == 4);
    }
    // In the other order the pairs are the 3 x 3 nodes of the upper box above the lower one.
    pm_contact_pairs other;
    assert_int_equal(pm_contact_pairs_find(&other, &s.upper.placed, &s.lower.placed, &s.arena),
                     PM_OK);
    assert_int_equal(other.npair, 9);
    boxes_check("gap", 0, other.pair[0].gap, GAP);
    // Boxes that lie side by side have no pairs.
    s.upper.placed.placement.origin[0] = 50;
    assert_int_equal(pm_contact_pairs_find(&other, &s.lower.placed, &s.upper.placed, &s.arena),
                     PM_OK);
    assert_int_equal(other.npair, 0);
    s.upper.placed.nelement = 0;
    assert_int_equal(pm_contact_pairs_find(&other, &s.lower.placed, &s.upper.placed, &s.arena),
                     PM_EDATA);
    assert_non_null(strstr(pm_error(), "no mesh"));
    pm_arena_free(&s.arena);
}

static void shift(const double *x, double *u) {
    (void)x;
    u[0] = 0.3, u[1] = -0.2, u[2] = 0.1;
}

static void what_shifts_opens_and_slides(void **state) {
    (void)state;
    scene s;
    make_scene(&s);
    for (int upper = 0; upper < 2; ++upper) {
        const double sign = upper == 1 ? 1 : -1;
        measure(&s, upper == 1 ? stay : shift, upper == 1 ? shift : stay);
        for (int i = 0; i < s.pairs.npair; ++i) {
            boxes_check("g", i, get(&s, PM_CONTACT_GAP, i), sign * 0.1);
            boxes_check("slid along x", i, along(&s, PM_CONTACT_SLID_U, i, 0), -sign * 0.3);
            boxes_check("slid along y", i, along(&s, PM_CONTACT_SLID_U, i, 1), sign * 0.2);
            boxes_check("slope", i, along(&s, PM_CONTACT_SLOPE_U, i, 0), 0);
        }
    }
    measure(&s, shift, shift);
    for (int i = 0; i < s.pairs.npair; ++i) {
        boxes_check("together", i, opening(&s, i), GAP);
    }
    pm_arena_free(&s.arena);
}

static void tilt(const double *x, double *u) {
    u[0] = 0, u[1] = 0, u[2] = 0.05 * x[0] - 0.07 * x[1];
}

// Along x the lower box is longer and along y the upper one.
static void the_longer_side_slopes(void **state) {
    (void)state;
    scene s;
    make_scene(&s);
    measure(&s, tilt, stay);
    for (int i = 0; i < s.pairs.npair; ++i) {
        boxes_check("lower along x", i, along(&s, PM_CONTACT_SLOPE_U, i, 0), 0.05);
        boxes_check("lower along y", i, along(&s, PM_CONTACT_SLOPE_U, i, 1), 0);
    }
    measure(&s, stay, tilt);
    for (int i = 0; i < s.pairs.npair; ++i) {
        boxes_check("upper along x", i, along(&s, PM_CONTACT_SLOPE_U, i, 0), 0);
        boxes_check("upper along y", i, along(&s, PM_CONTACT_SLOPE_U, i, 1), -0.07);
    }
    pm_arena_free(&s.arena);
}

static const double angle = 0.1;

static void turn(const double *x, double *u) {
    u[0] = 0;
    u[1] = (cos(angle) - 1) * x[1] - sin(angle) * x[2];
    u[2] = sin(angle) * x[1] + (cos(angle) - 1) * x[2];
}

// Bodies that rotate together keep their distance, which is GAP / cos(angle) along the old normal.
static void what_turns_together_stays_apart(void **state) {
    (void)state;
    scene s;
    make_scene(&s);
    measure(&s, turn, turn);
    for (int i = 0; i < s.pairs.npair; ++i) {
        const double far = opening(&s, i), expected = GAP / cos(angle);
        if (!(fabs(far - expected) <= GAP * pow(angle, 4))) {
            fail_msg("pair %d: %.9g apart, expected %.9g", i, far, expected);
        }
    }
    pm_arena_free(&s.arena);
}

// A point that slides meets the slope at another place, here along y, where the slope is that of
// the upper box.
static void slides(const double *x, double *u) {
    (void)x;
    u[0] = 0, u[1] = 0.4, u[2] = 0;
}

static void what_slides_meets_the_slope(void **state) {
    (void)state;
    scene s;
    make_scene(&s);
    measure(&s, slides, tilt);
    for (int i = 0; i < s.pairs.npair; ++i) {
        double x[3], expected[3];
        place(&s, i, 0, x);
        x[1] += 0.4;
        tilt(x, expected);
        boxes_check("opening", i, opening(&s, i), GAP + expected[2]);
    }
    pm_arena_free(&s.arena);
}

// Makes `count` bricks around an edge like the slices of a cake. Their top faces meet at its axis
// and have 2 count + 1 nodes.
static void make_cake(box *b, int count) {
    const int nlayer = 2 * count + 1;
    memset(b, 0, sizeof *b);
    b->placed = (pm_placed_body){.name = "cake",
                                 .nnode = 2 * nlayer,
                                 .nelement = count,
                                 .position = b->position[0],
                                 .hexahedron = b->hexahedron[0],
                                 .placement = PM_PLACEMENT_IDENTITY};
    for (int n = 0; n < 2 * nlayer; ++n) {
        const int i = n % nlayer; // 0: the axis
        const double turned = acos(-1) * i / count;
        b->position[n][0] = i == 0 ? 0 : cos(turned);
        b->position[n][1] = i == 0 ? 0 : sin(turned);
        b->position[n][2] = n / nlayer;
    }
    for (int e = 0; e < count; ++e) {
        const int corner[4] = {0, 2 * e + 1, 2 * e + 2, (2 * e + 2) % (2 * count) + 1};
        for (int c = 0; c < 8; ++c) {
            b->hexahedron[e][c] = corner[c % 4] + c / 4 * nlayer;
        }
    }
}

// Points at which more faces meet than there is room for are refused.
static void points_of_many_faces_are_refused(void **state) {
    (void)state;
    for (int count = 7; count <= 8; ++count) {
        box lower, upper;
        pm_arena arena = {0};
        pm_contact_pairs pairs;
        make_cake(&lower, count);
        make_cake(&upper, count);
        upper.placed.placement.origin[2] = 1 + GAP;
        const pm_status status =
            pm_contact_pairs_find(&pairs, &lower.placed, &upper.placed, &arena);
        assert_int_equal(status, count == 7 ? PM_OK : PM_EDATA);
        if (status == PM_OK) {
            assert_int_equal(pairs.npair, 2 * count + 1);
            assert_int_equal(pairs.pair[0].point[1].nnode, 2 * count + 1);
        } else {
            assert_non_null(strstr(pm_error(), "more than 16 nodes"));
        }
        pm_arena_free(&arena);
    }
}

static void shake(box *b, double size, pm_rng *rng) {
    for (int n = 0; n < b->placed.nnode; ++n) {
        for (int d = 0; d < 3; ++d) {
            b->u[n][d] = size * pm_rng_normal(rng);
        }
    }
}

// The power of the forces is minus that of the efforts on the quantities.
static void forces_are_the_adjoint(void **state) {
    (void)state;
    scene s;
    pm_rng rng;
    pm_rng_init(&rng, 21, 0);
    make_scene(&s);
    const int count = PM_CONTACT_GROUPS * s.pairs.npair;
    double *effort = pm_arena_array(&s.arena, (size_t)count, sizeof *effort);
    for (int end = 0; end < 2; ++end) {
        box *b = end == 0 ? &s.lower : &s.upper;
        double f[MOST_NODES][3] = {{0}}, power = 0, lost = 0;
        shake(b, 1, &rng);
        memset(s.value, 0, (size_t)count * sizeof *s.value);
        pm_contact_pairs_measure(&s.pairs, end, &b->placed, b->u[0], s.value);
        for (int i = 0; i < count; ++i) {
            effort[i] = pm_rng_normal(&rng);
            lost -= effort[i] * s.value[i];
        }
        pm_contact_pairs_add_forces(&s.pairs, end, &b->placed, effort, f[0]);
        for (int n = 0; n < b->placed.nnode; ++n) {
            for (int d = 0; d < 3; ++d) {
                power += f[n][d] * b->u[n][d];
            }
        }
        boxes_check("power", end, power, lost);
    }
    pm_arena_free(&s.arena);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_face_each_other),
        cmocka_unit_test(what_shifts_opens_and_slides),
        cmocka_unit_test(the_longer_side_slopes),
        cmocka_unit_test(what_turns_together_stays_apart),
        cmocka_unit_test(what_slides_meets_the_slope),
        cmocka_unit_test(points_of_many_faces_are_refused),
        cmocka_unit_test(forces_are_the_adjoint),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
