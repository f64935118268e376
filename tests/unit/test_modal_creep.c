// A viscoelastic body with two modes, of which one is in the state. The other creeps under its
// load, so that its displacement is a function of the history of the loads, not of the loads of the
// moment.
#include <math.h>
#include <stdlib.h>

#include "base/rng.h"
#include "bodies/modal/reconstruct.h"
#include "bodies/modal/reduce.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

// The body has nodes at x = 0..5 on a line, and is clamped at x = 0.
enum { NNODE = 6, NTRAJECTORY = 8, NLEARNED = 6, NTIME = 60, NMODE = 2, NBRANCH = 2 };
static const double dt = 0.05, softness[NMODE] = {2e-3, 1e-3};
static const double tau[NBRANCH] = {0.2, 0.5}, share[NBRANCH] = {0.3, 0.49};

// The displacement in y is a_0 x^2, that in z is a_1 x (6 - x).
static double shape(int mode, double x) {
    return mode == 0 ? x * x : x * (6 - x);
}

// The force on a mode grows from 0 at the time `on` to 1 and goes back to 0 at the time `off`.
static double load_at(double t, double on, double off) {
    return fmax(0, fmin(1, 5 * (t - on))) - fmax(0, fmin(1, 5 * (t - off)));
}

// Fills in a trajectory in which the load on a mode is top * load_at:
//     load = (a - sum_k share_k c_k) / softness,  dc_k/dt = (a - c_k)/tau_k,  a linear in a step
static void move(pm_field *d, int trajectory, int mode, double top, double on, double off) {
    const int node = 3 + mode;
    double before = 0, c[NBRANCH] = {0};
    for (int j = 0; j < NTIME; ++j) {
        const double load = top * load_at(j * dt, on, off);
        double known = 0, own = 0, fixed[NBRANCH], m[NBRANCH];
        for (int k = 0; k < NBRANCH; ++k) {
            const double r = exp(-dt / tau[k]);
            m[k] = (1 - r) * tau[k] / dt;
            fixed[k] = r * c[k] + (m[k] - r) * before;
            known += share[k] * fixed[k];
            own += share[k] * (1 - m[k]);
        }
        const double a = (softness[mode] * load + known) / (1 - own);
        for (int k = 0; k < NBRANCH; ++k) {
            c[k] = fixed[k] + (1 - m[k]) * a;
        }
        before = a;
        pm_field_force(d, trajectory, j)[3 * node + 1 + mode] = load / shape(mode, node);
        for (int n = 0; n < NNODE; ++n) {
            double *z = pm_field_state(d, trajectory, j) + n * d->nvariable;
            z[1 + mode] = a * shape(mode, n);
            z[6 + mode] = 1e3 * load; // a stress that follows from the load
        }
    }
}

static pm_field *make_body(void) {
    const pm_field_shape size = {
        .ntrajectory = NTRAJECTORY, .ntime = NTIME, .nnode = NNODE, .nvariable = 12};
    pm_field *d = NULL;
    pm_rng rng;
    pm_rng_init(&rng, 9, 0);
    assert_int_equal(pm_field_new(&d, size, dt, "qx qy qz vx vy vz sxx syy szz sxy sxz syz"),
                     PM_OK);
    for (int n = 0; n < NNODE; ++n) {
        d->position[3 * n] = n;
        for (int i = 0; i < NTRAJECTORY * NTIME; ++i) {
            d->z[(i * NNODE + n) * d->nvariable] = n;
        }
    }
    for (int i = 0; i < NTRAJECTORY; ++i) {
        for (int mode = 0; mode < NMODE; ++mode) {
            const double on = pm_rng_uniform(&rng), hold = 0.2 + pm_rng_uniform(&rng);
            move(d, i, mode, pm_rng_normal(&rng), on, on + hold);
        }
    }
    return d;
}

static const pm_reduce_settings settings = {
    .nmode = NMODE,
    .nstate = 1,
    .nlead = 1,
    .nbranch = NBRANCH,
    .tau = {0.2, 0.5},
    .inertia_time = 1e-3,
    .temperature = 300,
    .displacement_rank = 4,
    .stress_rank = 1,
};
static const int all[NTRAJECTORY] = {0, 1, 2, 3, 4, 5, 6, 7};

// The creep of a body with the relaxation modulus G(t) = 1 - sum_k share_k (1 - exp(-t/tau_k)) has
// the times at which tau_1 tau_2 s^2 + (tau_1 + tau_2 - share_1 tau_2 - share_2 tau_1) s + G(inf)
// is zero for s = -1/time: 0.2504 and 1.9020 s.
static void retardation_times_follow_from_the_fields(void **state) {
    (void)state;
    pm_field *field = make_body();
    pm_basis *b = NULL;
    assert_int_equal(pm_reduce_fit(&b, field, NLEARNED, all, &settings), PM_OK);
    assert_int_equal(b->nstate, 1);
    assert_int_equal(b->nretardation, 2);
    if (!(fabs(b->retardation[0] / 1.9020 - 1) < 1e-3 &&
          fabs(b->retardation[1] / 0.2504 - 1) < 1e-3)) {
        fail_msg("the retardation times are %g and %g s", b->retardation[0], b->retardation[1]);
    }
    pm_basis_free(b);
    pm_field_free(field);
}

// A mode outside of the state comes back slowly after its load is removed.
static void modes_outside_of_the_state_creep(void **state) {
    pm_field *field = make_body(), *again = NULL;
    pm_basis *made = NULL, *b = NULL;
    pm_dataset *d = NULL;
    const char *path = scratch_path(*state, "creeps.h5");
    const int count = NTRAJECTORY - NLEARNED;
    double error[NTRAJECTORY * PM_FIELD_NERROR];
    assert_int_equal(pm_reduce_fit(&made, field, NLEARNED, all, &settings), PM_OK);
    assert_int_equal(pm_basis_save(made, path, "trial"), PM_OK);
    assert_int_equal(pm_basis_load(&b, path), PM_OK);
    assert_int_equal(b->nretardation, 2);
    assert_true(b->retardation[0] == made->retardation[0]);
    assert_int_equal(
        pm_reduce_project(&d, b, field, count, all + NLEARNED, false, PM_LOADS_PRESCRIBED), PM_OK);
    assert_int_equal(pm_reconstruct(&again, b, d, NULL, NULL, NULL, NULL), PM_OK);
    assert_int_equal(pm_field_errors(again, field, all + NLEARNED, error), PM_OK);
    for (int i = 0; i < count; ++i) {
        const double off = error[i * PM_FIELD_NERROR + PM_ERROR_DISPLACEMENT];
        if (!(off < 5e-3)) {
            fail_msg("the displacement is wrong by %g of itself", off);
        }
    }
    pm_dataset_free(d);
    pm_field_free(again);
    pm_basis_free(made);
    pm_basis_free(b);
    pm_field_free(field);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(retardation_times_follow_from_the_fields),
        cmocka_unit_test(modes_outside_of_the_state_creep),
    };
    return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
