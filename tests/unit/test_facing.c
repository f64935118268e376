// Two boxes of bricks across a gap: which points face each other, and what opens them when the
// boxes move.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/rng.h"
#include "modal/assembly.h"

#define GAP 0.25
#define MOST_NODES 100

typedef struct box {
    double position[MOST_NODES][3], hexahedron[MOST_NODES][8], u[MOST_NODES][3];
    pm_placed placed;
} box;

static int node_of(const int count[3], int i, int j, int k) {
    return (k * (count[1] + 1) + j) * (count[0] + 1) + i;
}

static void make_box(box *b, const int count[3], double step) {
    memset(b, 0, sizeof *b);
    b->placed = (pm_placed){.name = "box",
                            .nnode = (count[0] + 1) * (count[1] + 1) * (count[2] + 1),
                            .nelement = count[0] * count[1] * count[2],
                            .position = b->position[0],
                            .hexahedron = b->hexahedron[0],
                            .axis = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    assert_true(b->placed.nnode <= MOST_NODES);
    for (int n = 0; n < b->placed.nnode; ++n) {
        b->position[n][0] = step * (n % (count[0] + 1));
        b->position[n][1] = step * (n / (count[0] + 1) % (count[1] + 1));
        b->position[n][2] = step * (n / (count[0] + 1) / (count[1] + 1));
    }
    static const int corner[8][3] = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                     {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
    for (int e = 0; e < b->placed.nelement; ++e) {
        const int i = e % count[0], j = e / count[0] % count[1], k = e / count[0] / count[1];
        for (int c = 0; c < 8; ++c) {
            b->hexahedron[e][c] =
                node_of(count, i + corner[c][0], j + corner[c][1], k + corner[c][2]);
        }
    }
}

// The lower box [0,8] x [0,4] x [0,2]; the upper one crosses it above x = 2 .. 5, and its nodes
// meet none of the lower: its own x looks along +y of the world, its y along -x.
typedef struct scene {
    box lower, upper;
    pm_arena arena;
    pm_facing facing;
    double *value; // [PM_FACING_GROUPS][npair]
} scene;

static void make_scene(scene *s) {
    memset(s, 0, sizeof *s);
    make_box(&s->lower, (int[3]){4, 2, 1}, 2);
    make_box(&s->upper, (int[3]){6, 2, 1}, 1.5);
    const double turned[3][3] = {{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};
    memcpy(s->upper.placed.axis, turned, sizeof turned);
    memcpy(s->upper.placed.origin, (double[3]){5, -2.5, 2 + GAP}, 3 * sizeof(double));
    assert_int_equal(pm_facing_find(&s->facing, &s->lower.placed, &s->upper.placed, &s->arena),
                     PM_OK);
    s->value =
        pm_arena_array(&s->arena, PM_FACING_GROUPS * (size_t)s->facing.npair, sizeof *s->value);
}

static void in_world(const pm_placed *p, const double *own, double *world) {
    for (int d = 0; d < 3; ++d) {
        world[d] = p->origin[d];
        for (int k = 0; k < 3; ++k) {
            world[d] += own[k] * p->axis[k][d];
        }
    }
}

// Moves a box by a displacement that is a function of the place in the world.
typedef void displacement(const double *x, double *u);
static void move(box *b, displacement *by) {
    for (int n = 0; n < b->placed.nnode; ++n) {
        double x[3], u[3];
        in_world(&b->placed, b->position[n], x);
        by(x, u);
        for (int k = 0; k < 3; ++k) {
            const double *axis = b->placed.axis[k];
            b->u[n][k] = u[0] * axis[0] + u[1] * axis[1] + u[2] * axis[2];
        }
    }
}

static void stay(const double *x, double *u) {
    (void)x;
    memset(u, 0, 3 * sizeof *u);
}

static void measure(scene *s, displacement *lower, displacement *upper) {
    move(&s->lower, lower);
    move(&s->upper, upper);
    memset(s->value, 0, PM_FACING_GROUPS * (size_t)s->facing.npair * sizeof *s->value);
    pm_facing_measure(&s->facing, 0, &s->lower.placed, s->lower.u[0], s->value);
    pm_facing_measure(&s->facing, 1, &s->upper.placed, s->upper.u[0], s->value);
}

static double get(const scene *s, int group, int pair) {
    return s->value[group * s->facing.npair + pair];
}

static double opening(const scene *s, int i) {
    return s->facing.pair[i].gap + get(s, PM_FACING_GAP, i) +
           get(s, PM_FACING_SLID_U, i) * get(s, PM_FACING_SLOPE_U, i) +
           get(s, PM_FACING_SLID_V, i) * get(s, PM_FACING_SLOPE_V, i);
}

// A vector of the world from its components along the pair's tangents.
static double along(const scene *s, int first_group, int pair, int axis) {
    const pm_facing_pair *p = &s->facing.pair[pair];
    return get(s, first_group, pair) * p->tangent[0][axis] +
           get(s, first_group + 1, pair) * p->tangent[1][axis];
}

static void check(const char *what, int pair, double value, double expected) {
    if (!(fabs(value - expected) <= 1e-12)) {
        fail_msg("%s, pair %d: %.17g, expected %.17g", what, pair, value, expected);
    }
}

// Where a pair's point of one end lies in the world.
static void place(const scene *s, int i, int end, double *x) {
    const box *b = end == 0 ? &s->lower : &s->upper;
    const pm_facing_point *point = &s->facing.pair[i].point[end];
    memset(x, 0, 3 * sizeof *x);
    for (int k = 0; k < point->nnode; ++k) {
        double at[3];
        in_world(&b->placed, b->position[point->node[k]], at);
        for (int d = 0; d < 3; ++d) {
            x[d] += point->value[k] * at[d];
        }
    }
}

static void points_face_each_other(void **state) {
    (void)state;
    scene s;
    make_scene(&s);
    // The lower's top nodes with x = 2, 4 and y = 0, 2, 4.
    assert_int_equal(s.facing.npair, 6);
    for (int i = 0; i < s.facing.npair; ++i) {
        double x[2][3];
        place(&s, i, 0, x[0]);
        place(&s, i, 1, x[1]);
        check("x", i, x[1][0], x[0][0]);
        check("y", i, x[1][1], x[0][1]);
        check("z of the lower", i, x[0][2], 2);
        check("z of the upper", i, x[1][2], 2 + GAP);
        check("gap", i, s.facing.pair[i].gap, GAP);
        assert_true(x[0][0] == 2 || x[0][0] == 4);
    }
    // Seen from the other: the upper's nodes above the lower, 3 x 3 of them.
    pm_facing other;
    assert_int_equal(pm_facing_find(&other, &s.upper.placed, &s.lower.placed, &s.arena), PM_OK);
    assert_int_equal(other.npair, 9);
    check("gap", 0, other.pair[0].gap, GAP);
    // Behind each other's backs there is nothing.
    s.upper.placed.origin[0] = 50;
    assert_int_equal(pm_facing_find(&other, &s.lower.placed, &s.upper.placed, &s.arena), PM_OK);
    assert_int_equal(other.npair, 0);
    s.upper.placed.nelement = 0;
    assert_int_equal(pm_facing_find(&other, &s.lower.placed, &s.upper.placed, &s.arena), PM_EDATA);
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
        for (int i = 0; i < s.facing.npair; ++i) {
            check("g", i, get(&s, PM_FACING_GAP, i), sign * 0.1);
            check("slid along x", i, along(&s, PM_FACING_SLID_U, i, 0), -sign * 0.3);
            check("slid along y", i, along(&s, PM_FACING_SLID_U, i, 1), sign * 0.2);
            check("slope", i, along(&s, PM_FACING_SLOPE_U, i, 0), 0);
        }
    }
    measure(&s, shift, shift);
    for (int i = 0; i < s.facing.npair; ++i) {
        check("together", i, opening(&s, i), GAP);
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
    for (int i = 0; i < s.facing.npair; ++i) {
        check("lower along x", i, along(&s, PM_FACING_SLOPE_U, i, 0), 0.05);
        check("lower along y", i, along(&s, PM_FACING_SLOPE_U, i, 1), 0);
    }
    measure(&s, stay, tilt);
    for (int i = 0; i < s.facing.npair; ++i) {
        check("upper along x", i, along(&s, PM_FACING_SLOPE_U, i, 0), 0);
        check("upper along y", i, along(&s, PM_FACING_SLOPE_U, i, 1), -0.07);
    }
    pm_arena_free(&s.arena);
}

static const double angle = 0.1;

static void turn(const double *x, double *u) {
    u[0] = 0;
    u[1] = (cos(angle) - 1) * x[1] - sin(angle) * x[2];
    u[2] = sin(angle) * x[1] + (cos(angle) - 1) * x[2];
}

// Turned together, bodies stay as far apart as they were: GAP / cos(angle) along the old normal.
static void what_turns_together_stays_apart(void **state) {
    (void)state;
    scene s;
    make_scene(&s);
    measure(&s, turn, turn);
    for (int i = 0; i < s.facing.npair; ++i) {
        const double far = opening(&s, i), expected = GAP / cos(angle);
        if (!(fabs(far - expected) <= GAP * pow(angle, 4))) {
            fail_msg("pair %d: %.9g apart, expected %.9g", i, far, expected);
        }
    }
    pm_arena_free(&s.arena);
}

// What slides meets the slope at another place, here along y, where the upper one's counts.
static void slides(const double *x, double *u) {
    (void)x;
    u[0] = 0, u[1] = 0.4, u[2] = 0;
}

static void what_slides_meets_the_slope(void **state) {
    (void)state;
    scene s;
    make_scene(&s);
    measure(&s, slides, tilt);
    for (int i = 0; i < s.facing.npair; ++i) {
        double x[3], expected[3];
        place(&s, i, 0, x);
        x[1] += 0.4;
        tilt(x, expected);
        check("opening", i, opening(&s, i), GAP + expected[2]);
    }
    pm_arena_free(&s.arena);
}

// Bricks around an edge as slices of a cake, whose top faces meet at its axis: `count` of them have
// 2 count + 1 nodes there.
static void make_cake(box *b, int count) {
    const int nlayer = 2 * count + 1;
    memset(b, 0, sizeof *b);
    b->placed = (pm_placed){.name = "cake",
                            .nnode = 2 * nlayer,
                            .nelement = count,
                            .position = b->position[0],
                            .hexahedron = b->hexahedron[0],
                            .axis = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
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

// Where more faces meet than a point has room for, that is told.
static void points_of_many_faces_are_refused(void **state) {
    (void)state;
    for (int count = 7; count <= 8; ++count) {
        box lower, upper;
        pm_arena arena = {0};
        pm_facing facing;
        make_cake(&lower, count);
        make_cake(&upper, count);
        upper.placed.origin[2] = 1 + GAP;
        const pm_status status = pm_facing_find(&facing, &lower.placed, &upper.placed, &arena);
        assert_int_equal(status, count == 7 ? PM_OK : PM_EDATA);
        if (status == PM_OK) {
            assert_int_equal(facing.npair, 2 * count + 1);
            assert_int_equal(facing.pair[0].point[1].nnode, 2 * count + 1);
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

// The power of the forces is what the groups lose.
static void forces_are_the_adjoint(void **state) {
    (void)state;
    scene s;
    pm_rng rng;
    pm_rng_init(&rng, 21, 0);
    make_scene(&s);
    const int count = PM_FACING_GROUPS * s.facing.npair;
    double *effort = pm_arena_array(&s.arena, (size_t)count, sizeof *effort);
    for (int end = 0; end < 2; ++end) {
        box *b = end == 0 ? &s.lower : &s.upper;
        double f[MOST_NODES][3] = {{0}}, power = 0, lost = 0;
        shake(b, 1, &rng);
        memset(s.value, 0, (size_t)count * sizeof *s.value);
        pm_facing_measure(&s.facing, end, &b->placed, b->u[0], s.value);
        for (int i = 0; i < count; ++i) {
            effort[i] = pm_rng_normal(&rng);
            lost -= effort[i] * s.value[i];
        }
        pm_facing_add_forces(&s.facing, end, &b->placed, effort, f[0]);
        for (int n = 0; n < b->placed.nnode; ++n) {
            for (int d = 0; d < 3; ++d) {
                power += f[n][d] * b->u[n][d];
            }
        }
        check("power", end, power, lost);
    }
    pm_arena_free(&s.arena);
}

// --- assemblies ---

enum { NBODY = 3, NPAIR = 12, NTIME = 4 };
static const int trajectory = 0;

// Two modes: one tilts along x, one shifts along y.
static void mode_fields(const double *x, double u[2][3]) {
    memset(u, 0, 6 * sizeof **u);
    u[0][2] = x[0];
    u[1][1] = 1;
}

static pm_basis *make_basis(const box *b) {
    pm_basis *basis = NULL;
    assert_int_equal(pm_basis_new(&basis, b->placed.nnode, 2, 2, 0), PM_OK);
    basis->swing = 1;
    basis->temperature = 1;
    double square[2] = {0};
    for (int n = 0; n < b->placed.nnode; ++n) {
        double u[2][3];
        mode_fields(b->position[n], u);
        for (int m = 0; m < 2; ++m) {
            memcpy(basis->mode + 3 * (m * b->placed.nnode + n), u[m], sizeof u[m]);
            square[m] += u[m][1] * u[m][1] + u[m][2] * u[m][2];
        }
    }
    basis->stiffness[0] = 1 / square[0];
    basis->stiffness[1] = 1 / square[1];
    return basis;
}

static double amplitude(int body, int mode, int time) {
    return 0.01 * (1 + body) * time * (mode == 0 ? 1 : -2);
}

// In modes alone; forces of contact push what is above up and what is below down, 5 N per time.
static pm_field *make_field(const box *b, int body) {
    const pm_field_shape shape = {.ntrajectory = 1,
                                  .ntime = NTIME,
                                  .nnode = b->placed.nnode,
                                  .nvariable = 6,
                                  .contact = true};
    pm_field *field = NULL;
    assert_int_equal(pm_field_new(&field, shape, 0.1, "qx qy qz vx vy vz"), PM_OK);
    memcpy(field->position, b->position, 3 * (size_t)b->placed.nnode * sizeof(double));
    for (int j = 0; j < NTIME; ++j) {
        for (int n = 0; n < b->placed.nnode; ++n) {
            double u[2][3], *q = pm_field_state(field, 0, j) + 6 * n;
            mode_fields(b->position[n], u);
            for (int d = 0; d < 3; ++d) {
                q[d] = b->position[n][d] + amplitude(body, 0, j) * u[0][d] +
                       amplitude(body, 1, j) * u[1][d];
            }
        }
        pm_field_contact(field, 0, j)[3 * 2 + 2] = body == 0 ? -5 * j : body == 2 ? 5 * j : 0;
    }
    return field;
}

typedef struct stack {
    box box;
    pm_basis *basis;
    pm_assembly assembly;
    pm_field *field[NBODY];
} stack;

static void make_stack(stack *s) {
    static const char *const names[NBODY] = {"bottom", "middle", "top"};
    memset(s, 0, sizeof *s);
    make_box(&s->box, (int[3]){3, 2, 1}, 2);
    s->basis = make_basis(&s->box);
    s->assembly = (pm_assembly){.basis = s->basis, .nbody = NBODY};
    s->assembly.body = pm_arena_array(&s->assembly.arena, NBODY, sizeof *s->assembly.body);
    for (int i = 0; i < NBODY; ++i) {
        s->assembly.body[i] = s->box.placed;
        s->assembly.body[i].name = names[i];
        s->assembly.body[i].origin[2] = i * (2 + GAP);
        s->field[i] = make_field(&s->box, i);
    }
    assert_int_equal(pm_assembly_meet(&s->assembly), PM_OK);
}

static void free_stack(stack *s) {
    for (int i = 0; i < NBODY; ++i) {
        pm_field_free(s->field[i]);
    }
    pm_arena_free(&s->assembly.arena);
    pm_basis_free(s->basis);
}

static void neighbours_meet(void **state) {
    (void)state;
    stack s;
    make_stack(&s);
    assert_int_equal(s.assembly.nmeeting, 2); // bottom and top have the middle between them
    for (int m = 0; m < 2; ++m) {
        assert_int_equal(s.assembly.meeting[m].body[0], m);
        assert_int_equal(s.assembly.meeting[m].body[1], m + 1);
        assert_int_equal(s.assembly.meeting[m].facing.npair, NPAIR);
    }
    free_stack(&s);
}

static int column_of(const pm_dataset *d, const char *name) {
    int i = 0;
    while (i < d->ncolumn && strcmp(d->column[i], name) != 0) {
        ++i;
    }
    if (i == d->ncolumn) {
        fail_msg("no column %s", name);
    }
    return i;
}

// What the fields say about the gaps is what the matrices make of the amplitudes, with what has
// slid taken half way to the axes, a quarter of the bodies' thickness below their sides.
static void matrices_give_the_gaps(void **state) {
    (void)state;
    static const char *const a_names[2] = {"middle_a0", "top_a0"};
    stack s;
    make_stack(&s);
    pm_dataset *d = NULL;
    assert_int_equal(
        pm_assembly_project(&d, &s.assembly, (const pm_field *const *)s.field, 1, &trajectory),
        PM_OK);
    const pm_meeting *m = &s.assembly.meeting[1];
    double matrix[2][PM_FACING_GROUPS * NPAIR][2];
    for (int end = 0; end < 2; ++end) {
        assert_int_equal(pm_meeting_matrix(&s.assembly, m, end, matrix[end][0]), PM_OK);
    }
    const int first = column_of(d, "middle_top_g0");
    assert_int_equal(column_of(d, "middle_top_slope_v0"), first + 4 * NPAIR);
    assert_int_equal(column_of(d, "middle_top_s"), first + 5 * NPAIR);
    for (int j = 0; j < NTIME; ++j) {
        const double *row = pm_dataset_state(d, 0, j);
        for (int i = 0; i < PM_FACING_GROUPS * NPAIR; ++i) {
            double expected = i < NPAIR ? GAP : 0;
            for (int end = 0; end < 2; ++end) {
                const double *a = row + column_of(d, a_names[end]);
                check("amplitude", end, a[0], amplitude(1 + end, 0, j));
                expected += matrix[end][i][0] * a[0] + matrix[end][i][1] * a[1];
            }
            check("gap", i, row[first + i], expected);
        }
        check("entropy", j, row[first + 5 * NPAIR], 0);
    }
    check("the tilt opens", 0, matrix[1][NPAIR - 1][0], -matrix[0][NPAIR - 1][0]);
    // A tilt alone does not move a side along itself, but what lies below it counts as lagging.
    for (int i = 0; i < 2 * NPAIR; ++i) {
        const double slid = matrix[1][PM_FACING_SLID_U * NPAIR + i][0];
        check("slid", i, slid, 0.5 * matrix[1][PM_FACING_SLOPE_U * NPAIR + i][0]);
    }
    check("slope", 0,
          hypot(matrix[1][PM_FACING_SLOPE_U * NPAIR][0], matrix[1][PM_FACING_SLOPE_V * NPAIR][0]),
          0.5);
    pm_dataset_free(d);
    free_stack(&s);
}

static void forces_are_compared(void **state) {
    (void)state;
    stack s;
    make_stack(&s);
    pm_dataset *d = NULL;
    assert_int_equal(
        pm_assembly_project(&d, &s.assembly, (const pm_field *const *)s.field, 1, &trajectory),
        PM_OK);
    for (int m = 0; m < 2; ++m) {
        const char *const name = m == 0 ? "bottom_middle_g0" : "middle_top_g0";
        const pm_meeting *meeting = &s.assembly.meeting[m];
        const pm_field *const *field = (const pm_field *const *)s.field;
        double error = -1;
        // One pair closed such that 10 N/m give the truth's force, then half of that.
        for (int j = 0; j < NTIME; ++j) {
            double *row = pm_dataset_state(d, 0, j) + column_of(d, name);
            for (int i = 0; i < PM_FACING_GROUPS * NPAIR; ++i) {
                row[i] = i < NPAIR ? 1 : 0;
            }
            row[2] = -0.3 * j;
            row[2 + NPAIR] = 2;
            row[2 + 3 * NPAIR] = -0.1 * j;
        }
        assert_int_equal(
            pm_meeting_force_errors(&s.assembly, meeting, d, 10, field, &trajectory, &error),
            PM_OK);
        check("all of the force", m, error, 0);
        assert_int_equal(
            pm_meeting_force_errors(&s.assembly, meeting, d, 5, field, &trajectory, &error), PM_OK);
        check("half of the force", m, error, 0.5);
    }
    pm_dataset_free(d);
    free_stack(&s);
}

// What the stack's columns are when its boxes are displaced by u, and the energy of its openings.
static double fill_openings(const stack *s, double (*u)[MOST_NODES][3], const pm_dataset *d,
                            double stiffness, double *row) {
    static const char *const first[2] = {"bottom_middle_g0", "middle_top_g0"};
    double energy = 0;
    for (int m = 0; m < 2; ++m) {
        const pm_meeting *meeting = &s->assembly.meeting[m];
        double *value = row + column_of(d, first[m]);
        for (int i = 0; i < PM_FACING_GROUPS * NPAIR; ++i) {
            value[i] = i < NPAIR ? GAP : 0;
        }
        for (int end = 0; end < 2; ++end) {
            const int body = meeting->body[end];
            pm_facing_measure(&meeting->facing, end, &s->assembly.body[body], u[body][0], value);
        }
        for (int i = 0; i < NPAIR; ++i) {
            const double opening = value[i] + value[NPAIR + i] * value[3 * NPAIR + i] +
                                   value[2 * NPAIR + i] * value[4 * NPAIR + i];
            energy += stiffness / 2 * fmin(opening, 0) * fmin(opening, 0);
        }
    }
    return energy;
}

// Of the middle one, which is pressed from both sides.
static void forces_are_the_slope_of_the_energy(void **state) {
    (void)state;
    static double u[NBODY][MOST_NODES][3];
    const double stiffness = 30, h = 1e-5, tolerance = 1e-6;
    stack s;
    pm_touch touch;
    pm_dataset *d = NULL;
    pm_rng rng;
    pm_rng_init(&rng, 22, 0);
    make_stack(&s);
    assert_int_equal(
        pm_assembly_project(&d, &s.assembly, (const pm_field *const *)s.field, 1, &trajectory),
        PM_OK);
    assert_int_equal(pm_touch_open(&touch, &s.assembly, 1, d, stiffness, &s.assembly.arena), PM_OK);
    for (int i = 0; i < NBODY * MOST_NODES; ++i) {
        for (int k = 0; k < 3; ++k) {
            u[i / MOST_NODES][i % MOST_NODES][k] = 0.2 * pm_rng_normal(&rng);
        }
    }
    double f[MOST_NODES][3] = {{0}}, largest = 0, *row = pm_dataset_state(d, 0, 0);
    fill_openings(&s, u, d, stiffness, row);
    pm_touch_add_forces(&touch, row, f[0]);
    for (int i = 0; i < 3 * s.box.placed.nnode; ++i) {
        double *own = &u[1][i / 3][i % 3], force = f[i / 3][i % 3];
        const double at = *own;
        *own = at + h;
        double slope = fill_openings(&s, u, d, stiffness, row);
        *own = at - h;
        slope = (slope - fill_openings(&s, u, d, stiffness, row)) / (2 * h);
        *own = at;
        largest = fmax(largest, fabs(slope));
        if (!(fabs(force + slope) <= tolerance)) {
            fail_msg("seed 22, component %d: %.9g, expected %.9g within %g", i, force, -slope,
                     tolerance);
        }
    }
    assert_true(largest > 1);
    pm_dataset_free(d);
    free_stack(&s);
}

// Fields of another number of trajectories, states or nodes are not read.
static void fields_that_do_not_fit_are_refused(void **state) {
    (void)state;
    stack s;
    make_stack(&s);
    pm_dataset *d = NULL;
    double error = -1;
    const pm_field *const *field = (const pm_field *const *)s.field;
    assert_int_equal(pm_assembly_project(&d, &s.assembly, field, 1, &trajectory), PM_OK);
    int *const number[] = {&s.field[2]->ntrajectory, &s.field[2]->ntime, &s.field[2]->nnode};
    for (int i = 0; i < 3; ++i) {
        pm_dataset *none = NULL;
        --*number[i];
        assert_int_equal(pm_assembly_check(&s.assembly, field), PM_EDATA);
        assert_non_null(strstr(pm_error(), "the field of top has"));
        assert_int_equal(pm_assembly_project(&none, &s.assembly, field, 1, &trajectory), PM_EDATA);
        assert_int_equal(pm_meeting_force_errors(&s.assembly, &s.assembly.meeting[1], d, 1, field,
                                                 &trajectory, &error),
                         PM_EDATA);
        ++*number[i];
    }
    assert_int_equal(pm_assembly_check(&s.assembly, field), PM_OK);
    pm_dataset_free(d);
    free_stack(&s);
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
        cmocka_unit_test(neighbours_meet),
        cmocka_unit_test(matrices_give_the_gaps),
        cmocka_unit_test(forces_are_compared),
        cmocka_unit_test(forces_are_the_slope_of_the_energy),
        cmocka_unit_test(fields_that_do_not_fit_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
