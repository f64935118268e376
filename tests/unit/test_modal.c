// A body of known modes: reduce finds them in its fields, and reconstruct makes the fields again.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "bodies/modal/reconstruct.h"
#include "bodies/modal/reduce.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

// Nodes at x = 0..4, y and z = -1, 0, 1, clamped at x = 0.
enum { NX = 5, NNODE = NX * 9, NTRAJECTORY = 6, NTIME = 9, NVARIABLE = 12 };
static const double dt = 0.1, softness = 2e-3, tau = 0.3, share = 0.6;

// The body bends in y and z by a_0 x^2 and a_1 x^2, which follow the load at its end and the
// internal variable of one branch. Its rotating sections shorten it by the squares of both.
static void deform(const double a[2], const double *position, double *u) {
    const double x = position[0];
    u[0] = -0.5 * x * (a[0] * a[0] + a[1] * a[1]);
    u[1] = a[0] * x * x;
    u[2] = a[1] * x * x;
}

static pm_field *make_body(void) {
    const pm_field_shape shape = {
        .ntrajectory = NTRAJECTORY, .ntime = NTIME, .nnode = NNODE, .nvariable = NVARIABLE};
    pm_field *d = NULL;
    pm_rng rng;
    pm_rng_init(&rng, 5, 0);
    assert_int_equal(pm_field_new(&d, shape, dt, "qx qy qz vx vy vz sxx syy szz sxy sxz syz"),
                     PM_OK);
    for (int i = 0; i < NNODE; ++i) {
        d->position[3 * i] = i % NX;
        d->position[3 * i + 1] = i / NX % 3 - 1;
        d->position[3 * i + 2] = i / NX / 3 - 1;
    }
    for (int i = 0; i < NTRAJECTORY; ++i) {
        double c[2] = {0}, before[2] = {0}, dissipated = 0;
        const double top[2] = {pm_rng_normal(&rng), pm_rng_normal(&rng)};
        for (int j = 0; j < NTIME; ++j) {
            double a[2];
            const double ramp = j < 4 ? j / 4.0 : 1;
            const double r = exp(-dt / tau), m = (1 - r) * tau / dt;
            for (int k = 0; k < 2; ++k) {
                // load = (a - share c) / softness, with c after a step in which a is linear.
                const double load = top[k] * ramp, known = r * c[k] + (m - r) * before[k];
                a[k] = j == 0 ? 0 : (softness * load + share * known) / (1 - share * (1 - m));
                c[k] = j == 0 ? 0 : known + (1 - m) * a[k];
                before[k] = a[k];
                // The force acts on the middle node of the end, at which x^2 is 16.
                pm_field_force(d, i, j)[3 * (4 * NX + NX - 1) + 1 + k] = load / 16;
                dissipated += dt * share / softness * (a[k] - c[k]) * (a[k] - c[k]) / tau;
            }
            d->energy[(i * NTIME + j) * PM_FIELD_ENERGIES + 1] = dissipated;
            for (int n = 0; n < NNODE; ++n) {
                double *z = pm_field_state(d, i, j) + n * NVARIABLE;
                double u[3];
                deform(a, d->position + 3 * n, u);
                for (int k = 0; k < 3; ++k) {
                    z[k] = d->position[3 * n + k] + u[k];
                }
                // Bending stress, and shear stress that is uniform over the section.
                z[6] = -1e3 * (a[0] * d->position[3 * n + 1] + a[1] * d->position[3 * n + 2]);
                z[9] = 1e2 * a[0];
                z[10] = 1e2 * a[1];
            }
        }
    }
    return d;
}

static const pm_reduce_settings settings = {
    .nmode = 3,
    .nstate = 3,
    .nlead = 2,
    .nbranch = 1,
    .tau = {0.3},
    .inertia_time = 1e-3,
    .temperature = 300,
    .displacement_rank = 4,
    .stress_rank = 4,
    .reach = 1,
    .square = true,
};
static const int all[NTRAJECTORY] = {0, 1, 2, 3, 4, 5};

static pm_basis *make_basis(const pm_field *field) {
    pm_basis *b = NULL;
    assert_int_equal(pm_reduce_fit(&b, field, 4, all, &settings), PM_OK);
    return b;
}

// Two modes bend the body; the third, which shortens it, accompanies them.
static void modes_that_carry_the_energy_are_found(void **state) {
    (void)state;
    pm_field *field = make_body();
    pm_basis *b = make_basis(field);
    assert_int_equal(b->nstate, 2);
    // The sum of x^4 over all nodes, times the softness.
    double square = 0;
    for (int i = 0; i < NNODE; ++i) {
        square += pow(field->position[3 * i], 4);
    }
    assert_true(fabs(b->stiffness[0] * softness * square - 1) < 1e-3);
    assert_true(fabs(b->stiffness[1] / b->stiffness[0] - 1) < 1e-6);
    pm_basis_free(b);
    pm_field_free(field);
}

// The third mode is not turned, and keeps the stiffness against its own load.
static void few_modes_may_be_turned(void **state) {
    (void)state;
    pm_reduce_settings few = settings;
    pm_field *field = make_body();
    pm_basis *b = make_basis(field), *other = NULL;
    few.nturned = 2;
    assert_int_equal(pm_reduce_fit(&other, field, 4, all, &few), PM_OK);
    assert_int_equal(other->nstate, 2);
    for (int i = 0; i < 2; ++i) {
        assert_true(fabs(other->stiffness[i] / b->stiffness[i] - 1) < 1e-3);
    }
    assert_true(other->stiffness[2] > 0);
    pm_basis_free(other);
    pm_basis_free(b);
    pm_field_free(field);
}

// A feature that is zero but for rounding, whose bits differ from processor to processor, gets no
// coefficient.
static void rounding_is_no_feature(void **state) {
    (void)state;
    enum { COUNT = 100 };
    double feature[COUNT][2], result[COUNT];
    pm_regression r;
    for (int i = 0; i < COUNT; ++i) {
        feature[i][0] = result[i] = sin(i);
        feature[i][1] = 1e-12 * sin(i * i);
    }
    assert_int_equal(pm_regression_open(&r, 2, 1), PM_OK);
    pm_regression_add(&r, COUNT, feature[0], result);
    assert_int_equal(pm_regression_solve(&r, 1e-7), PM_OK);
    assert_true(fabs(r.cross[0] - 1) < 1e-6);
    if (!(fabs(r.cross[1]) < 1e-6)) {
        fail_msg("the coefficient of rounding is %g", r.cross[1]);
    }
    pm_regression_close(&r);
}

// In the coordinates of the basis, load = a - share c.
static void amplitudes_follow_the_loads(void **state) {
    (void)state;
    pm_field *field = make_body();
    pm_basis *b = make_basis(field);
    pm_dataset *d = NULL;
    assert_int_equal(pm_reduce_project(&d, b, field, NTRAJECTORY, all, true, PM_LOADS_PRESCRIBED),
                     PM_OK);
    assert_int_equal(d->ntrajectory, 8 * NTRAJECTORY);
    assert_int_equal(d->ncolumn, 3 * 2 + 1 + 3);
    assert_string_equal(d->column[0], "a0");
    assert_string_equal(d->column[4], "c0_0");
    assert_string_equal(d->column[6], "s");
    assert_string_equal(d->column[9], "h0");
    double largest = 0;
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int j = 0; j < d->ntime; ++j) {
            const double *z = pm_dataset_state(d, i, j), *rate = pm_dataset_rate(d, i, j);
            largest = fmax(largest, fabs(z[0]));
            assert_true(fabs(z[0] - share * z[4] - z[7]) < 2e-3 * fmax(largest, 1e-3));
            assert_true(fabs(rate[4] - (z[0] - z[4]) / tau) < 1e-9);
            assert_true(fabs(z[2] - 1e-6 * rate[0]) < 1e-12);
        }
    }
    assert_true(largest > 0);
    pm_dataset_free(d);
    pm_basis_free(b);
    pm_field_free(field);
}

static void fields_come_back(void **state) {
    pm_field *field = make_body(), *again = NULL;
    pm_basis *made = make_basis(field), *b = NULL;
    const char *path = scratch_path(*state, "basis.h5");
    assert_int_equal(pm_basis_save(made, path, "trial"), PM_OK);
    assert_int_equal(pm_basis_load(&b, path), PM_OK);
    assert_memory_equal(b->mode, made->mode, 9 * NNODE * sizeof *b->mode);
    assert_true(b->tau[0] == made->tau[0] && b->inertia_time == made->inertia_time);
    assert_int_equal(b->local.nsection, NX);
    assert_int_equal(pm_local_features(&b->local), 3 * 3); // one place carries a load
    assert_memory_equal(b->local.kernel, made->local.kernel, 9 * 9 * 6 * sizeof(double));
    pm_dataset *d = NULL;
    double error[2 * PM_FIELD_NERROR];
    // Trajectories from which the basis was not made.
    assert_int_equal(pm_reduce_project(&d, b, field, 2, all + 4, false, PM_LOADS_PRESCRIBED),
                     PM_OK);
    assert_int_equal(pm_reconstruct(&again, b, d, NULL, NULL, NULL, NULL), PM_OK);
    assert_int_equal(pm_field_errors(again, field, all + 4, error), PM_OK);
    for (int i = 0; i < 2; ++i) {
        assert_true(error[i * PM_FIELD_NERROR + PM_ERROR_DISPLACEMENT] < 1e-3);
        assert_true(error[i * PM_FIELD_NERROR + PM_ERROR_STRESS] < 1e-3);
    }
    pm_dataset_free(d);
    pm_field_free(again);
    pm_basis_free(made);
    pm_basis_free(b);
    pm_field_free(field);
}

// Makes a dataset of two bodies. The first has the numbers of `one`, and the single contact pair
// between the bodies is closed by `depth`.
static pm_dataset *with_a_neighbour(const pm_dataset *one, const pm_basis *b, double depth,
                                    pm_arena *arena) {
    const char *name[64];
    const int between = 2 * b->nstate + 1;
    pm_dataset *d = NULL;
    for (int i = 0; i < one->ncolumn; ++i) {
        name[i] = pm_arena_printf(arena, "one_%s", one->column[i]);
    }
    for (int i = 0; i < between; ++i) {
        const bool creep = i == between - 1, second = i >= b->nstate;
        name[one->ncolumn + i] = pm_arena_printf(arena, "one_two_%s%d",
                                                 creep    ? "creep"
                                                 : second ? "two"
                                                          : "one",
                                                 creep ? 0 : i % b->nstate);
    }
    assert_in_range(one->ncolumn + between, 1, 64);
    assert_int_equal(
        pm_dataset_new(&d, one->ntrajectory, one->ntime, one->ncolumn + between, one->dt, name),
        PM_OK);
    for (int j = 0; j < one->ntrajectory * one->ntime; ++j) {
        double *row = d->z + (ptrdiff_t)j * d->ncolumn;
        memcpy(row, one->z + (ptrdiff_t)j * one->ncolumn, (size_t)one->ncolumn * sizeof *row);
        row[d->ncolumn - 1] = -depth;
    }
    return d;
}

// Half of the forces as loads and half as contact forces have the effect of all as loads.
static void forces_of_contact_are_loads(void **state) {
    (void)state;
    pm_field *field = make_body();
    pm_basis *b = make_basis(field), *shared = NULL;
    pm_dataset *d = NULL, *whole = NULL, *half = NULL;
    const size_t count = 3 * (size_t)NTRAJECTORY * NTIME * NNODE;
    assert_int_equal(pm_reduce_project(&d, b, field, 1, all, false, PM_LOADS_PRESCRIBED), PM_OK);
    field->contact = calloc(count, sizeof *field->contact);
    for (size_t i = 0; i < count; ++i) {
        field->contact[i] = field->f[i] /= 2;
    }
    shared = make_basis(field);
    assert_memory_equal(shared->mode, b->mode, 3 * 3 * NNODE * sizeof *b->mode);
    assert_memory_equal(shared->local.kernel, b->local.kernel, 9 * 9 * 6 * sizeof(double));
    assert_int_equal(pm_reduce_project(&whole, b, field, 1, all, false, PM_LOADS_OF_ALL), PM_OK);
    assert_int_equal(pm_reduce_project(&half, b, field, 1, all, false, PM_LOADS_PRESCRIBED), PM_OK);
    for (int i = 0; i < NTIME * d->ncolumn; ++i) {
        const bool is_load = i % d->ncolumn >= d->ncolumn - b->nmode;
        assert_true(whole->z[i] == d->z[i]);
        assert_true(half->z[i] == d->z[i] / (is_load ? 2 : 1));
    }
    free(field->contact);
    pm_dataset_free(d);
    pm_dataset_free(whole);
    pm_dataset_free(half);
    pm_basis_free(b);
    pm_basis_free(shared);
    pm_field_free(field);
}

// Contact forces on a body change its fields in the same way as loads of the same size.
static void contact_is_a_load(void **state) {
    (void)state;
    const int node = 4 * NX + NX - 1; // the one that carries loads
    const double force = 20, stiffness = 50;
    pm_arena arena = {0};
    pm_field *field = make_body(), *pressed = NULL, *loaded = NULL;
    pm_basis *b = make_basis(field);
    pm_dataset *d = NULL;
    assert_int_equal(pm_reduce_project(&d, b, field, 1, all, false, PM_LOADS_PRESCRIBED), PM_OK);
    pm_dataset *two = with_a_neighbour(d, b, force / stiffness, &arena);

    pm_placed_body body[2] = {{.name = "one", .nnode = NNODE, .placement = PM_PLACEMENT_IDENTITY},
                              {.name = "two", .nnode = NNODE, .placement = PM_PLACEMENT_IDENTITY}};
    body[0].position = body[1].position = b->position;
    pm_contact_pair pair = {.normal = {0, 0, 1}, .point = {{1, {node}, {1}, {{0}}, {0}}}};
    pm_contact_interface interface = {{0, 1}, {1, &pair}};
    const pm_body_assembly assembly = {
        .basis = b, .nbody = 2, .body = body, .ninterface = 1, .interface = &interface};
    pm_contact_force contact;
    assert_int_equal(pm_contact_force_open(&contact, &assembly, 0, two, &stiffness, &arena), PM_OK);
    assert_int_equal(pm_reconstruct(&pressed, b, two, "one", &contact, NULL, NULL), PM_OK);

    memset(field->f, 0, 3 * NTRAJECTORY * NTIME * NNODE * sizeof *field->f);
    for (int j = 0; j < NTIME; ++j) {
        double *load = pm_dataset_state(d, 0, j) + d->ncolumn - b->nmode;
        pm_field_force(field, 0, j)[3 * node + 2] = -force; // what is above presses down
        for (int i = 0; i < b->nmode; ++i) {
            load[i] -= force * b->mode[3 * (i * NNODE + node) + 2];
        }
    }
    assert_int_equal(pm_reconstruct(&loaded, b, d, NULL, NULL, field, all), PM_OK);
    double largest = 0;
    for (int i = 0; i < NTIME * NNODE * NVARIABLE; ++i) {
        largest = fmax(largest, fabs(loaded->z[i]));
        assert_true(fabs(pressed->z[i] - loaded->z[i]) <= 1e-12 * largest);
    }
    assert_true(largest > 1);
    pm_dataset_free(two);
    pm_dataset_free(d);
    pm_field_free(pressed);
    pm_field_free(loaded);
    pm_basis_free(b);
    pm_field_free(field);
    pm_arena_free(&arena);
}

// Makes the same field with its variables in another order.
static pm_field *reordered(const pm_field *field) {
    const pm_field_shape shape = {
        .ntrajectory = NTRAJECTORY, .ntime = NTIME, .nnode = NNODE, .nvariable = NVARIABLE};
    pm_field *d = NULL;
    assert_int_equal(pm_field_new(&d, shape, dt, "sxx syy szz sxy sxz syz qx qy qz vx vy vz"),
                     PM_OK);
    memcpy(d->position, field->position, 3 * NNODE * sizeof *d->position);
    memcpy(d->f, field->f, 3 * NTRAJECTORY * NTIME * NNODE * sizeof *d->f);
    for (int i = 0; i < NTRAJECTORY * NTIME * NNODE * NVARIABLE; i += NVARIABLE) {
        for (int k = 0; k < NVARIABLE; ++k) {
            d->z[i + (k + 6) % NVARIABLE] = field->z[i + k];
        }
    }
    return d;
}

static void variables_are_found_by_name(void **state) {
    (void)state;
    pm_field *field = make_body(), *other = reordered(field);
    pm_basis *expected = make_basis(field), *b = make_basis(other);
    assert_memory_equal(b->mode, expected->mode, 9 * NNODE * sizeof *b->mode);
    assert_int_equal(b->stress.rank, expected->stress.rank);
    assert_memory_equal(b->stress.pattern, expected->stress.pattern,
                        (size_t)(b->stress.rank * b->stress.width) * sizeof(double));
    double error[NTRAJECTORY * PM_FIELD_NERROR];
    assert_int_equal(pm_field_errors(other, field, all, error), PM_OK);
    for (int i = 0; i < NTRAJECTORY * PM_FIELD_NERROR; ++i) {
        assert_true(error[i] == 0);
    }
    other->variable = "T syy szz sxy sxz syz qx qy qz vx vy vz";
    assert_int_equal(pm_field_errors(field, other, all, error), PM_EDATA);
    assert_non_null(strstr(pm_error(), "has no \"sxx syy"));
    other->variable = "T";
    pm_dataset *none = NULL;
    assert_int_equal(pm_reduce_project(&none, b, other, 1, all, false, PM_LOADS_PRESCRIBED),
                     PM_EDATA);
    assert_non_null(strstr(pm_error(), "no positions"));
    pm_basis_free(expected);
    pm_basis_free(b);
    pm_field_free(other);
    pm_field_free(field);
}

static void only_like_fields_are_compared(void **state) {
    (void)state;
    pm_field *field = make_body(), *other = make_body();
    double error[NTRAJECTORY * PM_FIELD_NERROR];
    other->dt *= 2;
    assert_int_equal(pm_field_errors(field, other, all, error), PM_EDATA);
    assert_non_null(strstr(pm_error(), "0.2 s apart"));
    other->dt = dt;
    other->position[7] += 0.1;
    assert_int_equal(pm_field_errors(field, other, all, error), PM_EDATA);
    assert_non_null(strstr(pm_error(), "lies 0.1 m from"));
    pm_field_free(other);
    pm_field_free(field);
}

// A basis without a mesh gives fields without one.
static void a_body_may_have_no_mesh(void **state) {
    (void)state;
    pm_field *field = make_body(), *again = NULL;
    field->hexahedron = NULL;
    pm_basis *b = make_basis(field);
    pm_dataset *d = NULL;
    assert_int_equal(b->nelement, 0);
    assert_int_equal(pm_reduce_project(&d, b, field, 1, all, false, PM_LOADS_PRESCRIBED), PM_OK);
    assert_int_equal(pm_reconstruct(&again, b, d, NULL, NULL, NULL, NULL), PM_OK);
    assert_int_equal(again->nelement, 0);
    pm_dataset_free(d);
    pm_field_free(again);
    pm_basis_free(b);
    pm_field_free(field);
}

// Files with numbers that arithmetic cannot use are refused.
static void spoiled_bases_are_refused(void **state) {
    pm_field *field = make_body();
    pm_basis *b = make_basis(field), *none = NULL;
    const char *path = scratch_path(*state, "spoiled.h5");
    assert_int_equal(pm_basis_add_mesh(b, 1), PM_OK);
    const struct {
        double *at, value;
    } spoiled[] = {
        {&b->hexahedron[3], NNODE},
        {&b->hexahedron[0], -1},
        {&b->hexahedron[0], 1.5},
        {&b->hexahedron[7], NAN},
        {&b->mode[7], NAN},
        {&b->position[1], INFINITY},
        {&b->position[3 * 2], 1e-5}, // very many sections
        {&b->displacement.coefficient[0], NAN},
        {&b->stress.pattern[5], NAN},
        {&b->local.kernel[3], NAN},
        {&b->stiffness[1], 0},
        {&b->lead_scale[0], 0},
        {&b->tau[0], 0},
        {&b->retardation[0], NAN},
        {&b->inertia_time, 0},
        {&b->temperature, -1},
    };
    for (size_t i = 0; i < sizeof spoiled / sizeof *spoiled; ++i) {
        const double good = *spoiled[i].at;
        *spoiled[i].at = spoiled[i].value;
        assert_int_equal(pm_basis_save(b, path, "trial"), PM_OK);
        if (pm_basis_load(&none, path) != PM_EDATA || none != NULL) {
            fail_msg("basis %zu was read", i);
        }
        *spoiled[i].at = good;
    }
    assert_int_equal(pm_basis_save(b, path, "trial"), PM_OK);
    assert_int_equal(pm_basis_load(&none, path), PM_OK);
    pm_basis_free(none);
    pm_basis_free(b);
    pm_field_free(field);
}

// The number of features grows with that of the modes, so that too many modes are refused at once.
static void bases_of_many_modes_are_refused(void **state) {
    const char *path = scratch_path(*state, "many.h5");
    for (int n = PM_BASIS_MAX_MODES; n <= PM_BASIS_MAX_MODES + 1; ++n) {
        pm_basis *b = NULL, *again = NULL;
        assert_int_equal(pm_basis_new(&b, 1, n, n, n), PM_OK);
        b->inertia_time = b->temperature = 1;
        for (int i = 0; i < n; ++i) {
            b->stiffness[i] = b->lead_scale[i] = 1;
        }
        assert_int_equal(pm_basis_add_pattern(b, &b->displacement, 1, 3), PM_OK);
        assert_int_equal(pm_basis_save(b, path, "trial"), PM_OK);
        assert_int_equal(pm_basis_load(&again, path), n > PM_BASIS_MAX_MODES ? PM_EDATA : PM_OK);
        pm_basis_free(again);
        pm_basis_free(b);
    }
    assert_non_null(strstr(pm_error(), "65 modes of 1 nodes"));
}

static void what_does_not_fit_is_told(void **state) {
    pm_field *field = make_body(), *again = NULL;
    pm_basis *b = make_basis(field);
    pm_dataset *d = NULL;
    const char *column[] = {"a0", "a1"};
    assert_int_equal(pm_dataset_new(&d, 1, 2, 2, dt, column), PM_OK);
    assert_int_equal(pm_reconstruct(&again, b, d, NULL, NULL, NULL, NULL), PM_EDATA);
    assert_non_null(strstr(pm_error(), "no column \"p0\""));
    field->position[3] += 0.3; // no longer like a square
    pm_basis *none = NULL;
    assert_int_equal(pm_reduce_fit(&none, field, 4, all, &settings), PM_EDATA);
    assert_non_null(strstr(pm_error(), "not symmetric"));
    assert_int_equal(pm_basis_load(&none, scratch_path(*state, "none.h5")), PM_EFILE);
    pm_dataset_free(d);
    pm_basis_free(b);
    pm_field_free(field);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rounding_is_no_feature),
        cmocka_unit_test(modes_that_carry_the_energy_are_found),
        cmocka_unit_test(few_modes_may_be_turned),
        cmocka_unit_test(amplitudes_follow_the_loads),
        cmocka_unit_test(fields_come_back),
        cmocka_unit_test(spoiled_bases_are_refused),
        cmocka_unit_test(bases_of_many_modes_are_refused),
        cmocka_unit_test(a_body_may_have_no_mesh),
        cmocka_unit_test(forces_of_contact_are_loads),
        cmocka_unit_test(contact_is_a_load),
        cmocka_unit_test(variables_are_found_by_name),
        cmocka_unit_test(only_like_fields_are_compared),
        cmocka_unit_test(what_does_not_fit_is_told),
    };
    return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
