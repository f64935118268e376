// Corrects a simulation by better known fields. An error that is linear in the place of the load is
// removed entirely, whatever the numbering of the nodes.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "bodies/solid/correction.h"

enum { NROW = 5, NNODE = 2 * NROW, NTIME = 3, NVARIABLE = 2 };

// Nodes in two rows along x, at y = 0 and 1, in this order or in the reverse.
static pm_field *make(int ntrajectory, bool reversed) {
    const pm_field_shape shape = {ntrajectory, NTIME, NNODE, NVARIABLE, 0, false};
    pm_field *d = NULL;
    assert_int_equal(pm_field_new(&d, shape, 0.5, "q v"), PM_OK);
    for (int i = 0; i < NNODE; ++i) {
        const int place = reversed ? NNODE - 1 - i : i;
        d->position[3 * i] = place % NROW;
        d->position[3 * i + 1] = place / NROW;
    }
    return d;
}

// Sets a load at x in row y and the response to it: an arbitrary one, and an error linear in x.
static void press(pm_field *d, int trajectory, double x, double y, double error) {
    for (int j = 0; j < NTIME; ++j) {
        for (int i = 0; i < NNODE; ++i) {
            const double *at = d->position + 3 * (ptrdiff_t)i;
            double *z = pm_field_state(d, trajectory, j) + (ptrdiff_t)NVARIABLE * i;
            z[0] = j * sin(3 * at[0] * x + at[1]) + error * (1 + 2 * x) * (j + at[0] - 3 * at[1]);
            z[1] = j * cos(at[0] + x) + error * (4 - x);
            pm_field_force(d, trajectory, j)[3 * i + 1] = at[0] == x && at[1] == y ? -7.0 * j : 0;
        }
    }
}

// The simulated loads lie at x = 0 .. 4 of the first row. Two of the three known loads are used, at
// 1 and 3, on nodes in another order.
typedef struct pair {
    pm_field *own, *known;
} pair;

static const int used[] = {2, 0};

static pair make_pair(void) {
    pair p = {make(NROW, false), make(3, true)};
    for (int i = 0; i < NROW; ++i) {
        press(p.own, i, i, 0, 0.1);
    }
    press(p.known, 0, 3, 0, 0);
    press(p.known, 1, 2, 0, 5);
    press(p.known, 2, 1, 0, 0);
    return p;
}

static void free_pair(pair *p) {
    pm_field_free(p->own);
    pm_field_free(p->known);
}

static void what_is_linear_is_corrected(void **state) {
    (void)state;
    pair p = make_pair();
    pm_field *d = NULL, *right = make(NROW, true);
    assert_int_equal(pm_correct(&d, p.own, p.known, 2, used), PM_OK);
    assert_int_equal(d->ntrajectory, NROW);
    assert_memory_equal(d->position, p.known->position, 3 * NNODE * sizeof *d->position);
    // Beyond the last known loads the discrepancy is constant.
    for (int i = 0; i < NROW; ++i) {
        const double nearest = i < 1 ? 1 : i > 3 ? 3 : i;
        pm_field *lost = make(1, true), *none = make(1, true);
        press(right, i, i, 0, 0.1);
        press(lost, 0, nearest, 0, 0.1);
        press(none, 0, nearest, 0, 0);
        const double *z = pm_field_state(d, i, 0), *own = pm_field_state(right, i, 0);
        for (int k = 0; k < NTIME * NNODE * NVARIABLE; ++k) {
            const double expected = own[k] - lost->z[k] + none->z[k];
            if (!(fabs(z[k] - expected) < 1e-13)) {
                fail_msg("load %d, number %d: %.17g, expected %.17g", i, k, z[k], expected);
            }
        }
        assert_memory_equal(pm_field_force(d, i, 0), pm_field_force(right, i, 0),
                            3 * NTIME * NNODE * sizeof *d->f);
        pm_field_free(lost);
        pm_field_free(none);
    }
    pm_field_free(d);
    pm_field_free(right);
    free_pair(&p);
}

static void refuse(pair *p, const char *words) {
    pm_field *d = NULL;
    assert_int_equal(pm_correct(&d, p->own, p->known, 2, used), PM_EDATA);
    if (strstr(pm_error(), words) == NULL) {
        fail_msg("\"%s\", expected \"%s\"", pm_error(), words);
    }
    free_pair(p);
}

static void what_does_not_fit_is_refused(void **state) {
    (void)state;
    pair p = make_pair();
    press(p.own, 3, 3, 1, 0);
    refuse(&p, "no load like that of trajectory 0 of the known fields, at (3, 0, 0) m");
    p = make_pair();
    press(p.own, 4, 4, 1, 0);
    refuse(&p, "in a row with that of trajectory 4 of the simulation, at (4, 1, 0) m");
    p = make_pair();
    pm_field_force(p.own, 1, 1)[3 * 1] = 1; // the same place, other forces
    refuse(&p, "no load like that of trajectory 2");
    p = make_pair();
    for (int j = 0; j < NTIME; ++j) { // between the known ones, but twice as strong
        pm_field_force(p.own, 2, j)[3 * 2 + 1] *= 2;
    }
    refuse(&p, "same size and direction lies in a row with that of trajectory 2");
    p = make_pair();
    memset(pm_field_force(p.own, 2, NTIME - 1), 0, 3 * NNODE * sizeof(double));
    refuse(&p, "trajectory 2 of the simulation has no load at its last time");
    p = make_pair();
    memset(pm_field_force(p.known, 2, NTIME - 1), 0, 3 * NNODE * sizeof(double));
    refuse(&p, "trajectory 2 of the known fields has no load at its last time");
    p = make_pair();
    p.own->position[0] = 0.5;
    refuse(&p, "the simulation has no node at (0, 0, 0) m");
    p = make_pair();
    p.own->variable = "q w";
    refuse(&p, "variables \"q w\", the known fields \"q v\"");
    p = make_pair();
    p.own->dt = 0.6;
    refuse(&p, "0.6 s apart");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(what_is_linear_is_corrected),
        cmocka_unit_test(what_does_not_fit_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
