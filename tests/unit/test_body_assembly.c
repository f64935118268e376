// Boxes of bricks in a stack that share a basis: which of them face each other, and the openings
// and contact forces that follow from the amplitudes of all.
#include <math.h>
#include <string.h>

#include "base/rng.h"
#include "bodies/modal/contact_force.h"
#include "bodies/modal/contact_part.h"
#include "graph/program.h"
#include "scene/weights.h"
#include "tests/support/boxes.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"

enum { NBODY = 3, NPAIR = 12, NTIME = 4 };
static const int trajectory = 0;

// Of two modes one tilts the box along x, and one shifts it along y.
static void mode_fields(const double *x, double u[2][3]) {
    memset(u, 0, 6 * sizeof **u);
    u[0][2] = x[0];
    u[1][1] = 1;
}

static pm_basis *make_basis(const box *b) {
    pm_basis *basis = NULL;
    assert_int_equal(pm_basis_new(&basis, b->placed.nnode, 2, 2, 0), PM_OK);
    basis->inertia_time = 1;
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

// Makes a field of modes alone, in which contact forces push the upper body up and the lower one
// down, by 5 N more at each time.
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
    pm_body_assembly assembly;
    pm_field *field[NBODY];
} stack;

static void make_stack(stack *s) {
    static const char *const names[NBODY] = {"bottom", "middle", "top"};
    memset(s, 0, sizeof *s);
    box_make(&s->box, (int[3]){3, 2, 1}, 2);
    s->basis = make_basis(&s->box);
    s->assembly = (pm_body_assembly){.basis = s->basis, .nbody = NBODY};
    s->assembly.body = pm_arena_array(&s->assembly.arena, NBODY, sizeof *s->assembly.body);
    for (int i = 0; i < NBODY; ++i) {
        s->assembly.body[i] = s->box.placed;
        s->assembly.body[i].name = names[i];
        s->assembly.body[i].placement.origin[2] = i * (2 + GAP);
        s->field[i] = make_field(&s->box, i);
    }
    assert_int_equal(pm_body_assembly_find_interfaces(&s->assembly), PM_OK);
}

static void free_stack(stack *s) {
    for (int i = 0; i < NBODY; ++i) {
        pm_field_free(s->field[i]);
    }
    pm_arena_free(&s->assembly.arena);
    pm_basis_free(s->basis);
}

static void neighbours_have_interfaces(void **state) {
    (void)state;
    stack s;
    make_stack(&s);
    assert_int_equal(s.assembly.ninterface, 2); // bottom and top have the middle between them
    for (int m = 0; m < 2; ++m) {
        assert_int_equal(s.assembly.interface[m].body[0], m);
        assert_int_equal(s.assembly.interface[m].body[1], m + 1);
        assert_int_equal(s.assembly.interface[m].pairs.npair, NPAIR);
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

// Openings are those of the undeformed boxes plus the matrices times the amplitudes.
static void matrices_give_the_openings(void **state) {
    (void)state;
    static const char *const a_names[2] = {"middle_a0", "top_a0"};
    static const char *const travels[2] = {"middle_top_middle0", "middle_top_top0"};
    stack s;
    make_stack(&s);
    pm_dataset *d = NULL;
    assert_int_equal(pm_body_assembly_project(&d, &s.assembly, (const pm_field *const *)s.field, 1,
                                              &trajectory, 300),
                     PM_OK);
    const pm_contact_interface *m = &s.assembly.interface[1];
    pm_contact_openings openings;
    double matrix[2][PM_CONTACT_GROUPS * NPAIR][2];
    for (int end = 0; end < 2; ++end) {
        assert_int_equal(pm_contact_interface_matrix(&s.assembly, m, end, matrix[end][0]), PM_OK);
    }
    assert_int_equal(pm_contact_openings_open(&openings, &s.assembly, m, d, &s.assembly.arena),
                     PM_OK);
    const int creep = column_of(d, "middle_top_creep0");
    for (int j = 0; j < NTIME; ++j) {
        double *row = pm_dataset_state(d, 0, j);
        boxes_check("creep", j, row[creep + 1], 0);
        boxes_check("entropy", j, row[column_of(d, "middle_top_s")], 0);
        row[creep + 1] = 0.5;
        for (int i = 0; i < PM_CONTACT_GROUPS * NPAIR; ++i) {
            double expected = i == 1 ? GAP + 0.5 : i < NPAIR ? GAP : 0;
            for (int end = 0; end < 2; ++end) {
                const double *a = row + column_of(d, a_names[end]);
                boxes_check("amplitude", end, a[0], amplitude(1 + end, 0, j));
                boxes_check("travel", end, row[column_of(d, travels[end]) + 1], a[1]);
                expected += matrix[end][i][0] * a[0] + matrix[end][i][1] * a[1];
            }
            boxes_check("opening", i, pm_contact_openings_compute(&openings, row)[i], expected);
        }
    }
    boxes_check("the tilt opens", 0, matrix[1][NPAIR - 1][0], -matrix[0][NPAIR - 1][0]);
    // A tilt does not slide a side itself. Sliding is taken half way to the axis of the tilt, and
    // is half the slope there.
    for (int i = 0; i < 2 * NPAIR; ++i) {
        const double slid = matrix[1][PM_CONTACT_SLID_U * NPAIR + i][0];
        boxes_check("slid", i, slid, 0.5 * matrix[1][PM_CONTACT_SLOPE_U * NPAIR + i][0]);
    }
    const double slope_u = matrix[1][PM_CONTACT_SLOPE_U * NPAIR][0];
    const double slope_v = matrix[1][PM_CONTACT_SLOPE_V * NPAIR][0];
    boxes_check("slope", 0, hypot(slope_u, slope_v), 0.5);
    pm_dataset_free(d);
    free_stack(&s);
}

// The energy of the part, built as a graph, is that of the openings in a row with the same numbers.
static void the_part_stores_the_openings(void **state) {
    (void)state;
    const pm_contact_constants constants = {.stiffness = 30, .creep = 0.01, .temperature = 1};
    stack s;
    make_stack(&s);
    pm_dataset *d = NULL;
    pm_part part;
    pm_contact_openings openings;
    pm_graph *g = NULL;
    pm_program *program = NULL;
    pm_rng rng;
    pm_rng_init(&rng, 5, 0);
    const pm_contact_interface *m = &s.assembly.interface[0];
    assert_int_equal(pm_body_assembly_project(&d, &s.assembly, (const pm_field *const *)s.field, 1,
                                              &trajectory, 300),
                     PM_OK);
    assert_int_equal(pm_contact_openings_open(&openings, &s.assembly, m, d, &s.assembly.arena),
                     PM_OK);
    assert_int_equal(pm_contact_part_make(&s.assembly, m, &constants, &s.assembly.arena, &part),
                     PM_OK);
    assert_int_equal(part.layout.nz, 2 + 2 + NPAIR + 1);
    assert_int_equal(pm_graph_open(&g), PM_OK);
    const pm_node z = pm_input(g, true, 1, part.layout.nz), E = pm_part_energy(g, &part, z);
    assert_int_equal(pm_program_open(&program, g, 1, &E, 1), PM_OK);
    double *row = pm_dataset_state(d, 0, 0), *state_z = pm_program_value(program, z);
    row += column_of(d, "bottom_middle_bottom0");
    int closed = 0;
    for (int trial = 0; trial < 100; ++trial) {
        for (int c = 0; c < part.layout.nz; ++c) {
            row[c] = state_z[c] = 0.3 * pm_rng_normal(&rng);
        }
        const double *v = pm_contact_openings_compute(&openings, pm_dataset_state(d, 0, 0));
        double energy = s.basis->temperature * row[part.layout.nz - 1];
        for (int i = 0; i < NPAIR; ++i) {
            const double x =
                v[i] + v[NPAIR + i] * v[3 * NPAIR + i] + v[2 * NPAIR + i] * v[4 * NPAIR + i];
            energy += constants.stiffness / 2 * fmin(x, 0) * fmin(x, 0);
            closed += x < 0;
        }
        pm_program_run(program, 1);
        boxes_check("energy", trial, *pm_program_value(program, E), energy);
    }
    assert_true(closed > 20 && closed < 100 * NPAIR - 20);
    pm_program_close(program);
    pm_graph_close(g);
    pm_part_free(&part);
    pm_dataset_free(d);
    free_stack(&s);
}

// Sets the creep in a row such that one pair of the interface has the given opening and all
// others 1.
static void fill_creep(const pm_contact_openings *o, double opening, double *row) {
    for (int i = 0; i < NPAIR; ++i) {
        row[o->creep + i] = 0;
    }
    const double *v = pm_contact_openings_compute(o, row);
    double now[NPAIR];
    for (int i = 0; i < NPAIR; ++i) {
        now[i] = v[i] + v[NPAIR + i] * v[3 * NPAIR + i] + v[2 * NPAIR + i] * v[4 * NPAIR + i];
    }
    for (int i = 0; i < NPAIR; ++i) {
        row[o->creep + i] = (i == 2 ? opening : 1) - now[i];
    }
}

static void forces_are_compared(void **state) {
    (void)state;
    stack s;
    make_stack(&s);
    pm_dataset *d = NULL;
    assert_int_equal(pm_body_assembly_project(&d, &s.assembly, (const pm_field *const *)s.field, 1,
                                              &trajectory, 300),
                     PM_OK);
    for (int m = 0; m < 2; ++m) {
        const pm_contact_interface *interface = &s.assembly.interface[m];
        const pm_field *const *field = (const pm_field *const *)s.field;
        pm_contact_openings openings;
        double error = -1;
        assert_int_equal(
            pm_contact_openings_open(&openings, &s.assembly, interface, d, &s.assembly.arena),
            PM_OK);
        // One pair is closed such that 10 N/m give the force of the truth.
        for (int j = 0; j < NTIME; ++j) {
            fill_creep(&openings, -0.5 * j, pm_dataset_state(d, 0, j));
        }
        assert_int_equal(
            pm_contact_force_errors(&s.assembly, interface, d, 10, field, &trajectory, &error),
            PM_OK);
        boxes_check("all of the force", m, error, 0);
        assert_int_equal(
            pm_contact_force_errors(&s.assembly, interface, d, 5, field, &trajectory, &error),
            PM_OK);
        boxes_check("half of the force", m, error, 0.5);
    }
    pm_dataset_free(d);
    free_stack(&s);
}

// The energy of the openings of the middle box in a row, with its nodes displaced further by u.
static double energy_of(const stack *s, double (*u)[3], const double *row, const pm_dataset *d,
                        double stiffness) {
    double energy = 0;
    for (int m = 0; m < 2; ++m) {
        const pm_contact_interface *interface = &s->assembly.interface[m];
        pm_arena arena = {0};
        pm_contact_openings openings;
        double v[PM_CONTACT_GROUPS * NPAIR];
        assert_int_equal(pm_contact_openings_open(&openings, &s->assembly, interface, d, &arena),
                         PM_OK);
        memcpy(v, pm_contact_openings_compute(&openings, row), sizeof v);
        pm_contact_pairs_measure(&interface->pairs, m == 0 ? 1 : 0, &s->assembly.body[1], u[0], v);
        for (int i = 0; i < NPAIR; ++i) {
            const double x =
                v[i] + v[NPAIR + i] * v[3 * NPAIR + i] + v[2 * NPAIR + i] * v[4 * NPAIR + i];
            energy += stiffness / 2 * fmin(x, 0) * fmin(x, 0);
        }
        pm_arena_free(&arena);
    }
    return energy;
}

// The middle box is pressed from both sides.
static void forces_are_the_slope_of_the_energy(void **state) {
    (void)state;
    static double u[MOST_NODES][3];
    const double stiffness = 30, both[2] = {stiffness, stiffness}, h = 1e-5, tolerance = 1e-6;
    stack s;
    pm_contact_force contact;
    pm_dataset *d = NULL;
    pm_rng rng;
    pm_rng_init(&rng, 22, 0);
    make_stack(&s);
    assert_int_equal(pm_body_assembly_project(&d, &s.assembly, (const pm_field *const *)s.field, 1,
                                              &trajectory, 300),
                     PM_OK);
    assert_int_equal(pm_contact_force_open(&contact, &s.assembly, 1, d, both, &s.assembly.arena),
                     PM_OK);
    double f[MOST_NODES][3] = {{0}}, largest = 0, *row = pm_dataset_state(d, 0, 0);
    for (int c = column_of(d, "bottom_middle_bottom0"); c < d->ncolumn; ++c) {
        row[c] = 0.3 * pm_rng_normal(&rng);
    }
    pm_contact_force_add(&contact, row, f[0]);
    for (int i = 0; i < 3 * s.box.placed.nnode; ++i) {
        double *own = &u[i / 3][i % 3], force = f[i / 3][i % 3];
        *own = h;
        double slope = energy_of(&s, u, row, d, stiffness);
        *own = -h;
        slope = (slope - energy_of(&s, u, row, d, stiffness)) / (2 * h);
        *own = 0;
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

// Saves the part of an interface as weights in a folder.
static void save_part(const stack *s, const pm_contact_interface *m, double stiffness,
                      const char *folder) {
    const pm_contact_constants constants = {.stiffness = stiffness, .temperature = 1};
    const pm_provenance provenance = {.command = "trial", .data = "none"};
    pm_arena arena = {0};
    pm_part part;
    assert_int_equal(pm_contact_part_make(&s->assembly, m, &constants, &arena, &part), PM_OK);
    const char *path = pm_contact_part_path(&s->assembly, m, folder, &arena);
    assert_int_equal(pm_weights_save(path, pm_component_of_part(&part), &provenance), PM_OK);
    pm_part_free(&part);
    pm_arena_free(&arena);
}

// Weights of another interface, and missing weights, are refused.
static void the_stiffness_comes_back_from_weights(void **state) {
    const char *folder = ((scratch *)*state)->folder;
    stack s;
    make_stack(&s);
    const pm_contact_interface *interface = s.assembly.interface;
    double stiffness = 0;
    save_part(&s, &interface[0], 1.0 / 3, folder);
    assert_int_equal(pm_contact_part_stiffness(&s.assembly, &interface[0], folder, &stiffness),
                     PM_OK);
    assert_true(stiffness == 1.0 / 3);
    assert_int_equal(pm_contact_part_stiffness(&s.assembly, &interface[1], folder, &stiffness),
                     PM_EWEIGHTS);
    s.assembly.body[0].name = "middle", s.assembly.body[1].name = "top";
    save_part(&s, &interface[0], 7, folder);
    s.assembly.body[0].name = "bottom", s.assembly.body[1].name = "middle";
    assert_int_equal(pm_contact_part_stiffness(&s.assembly, &interface[1], folder, &stiffness),
                     PM_OK);
    --s.assembly.interface[1].pairs.npair;
    assert_int_equal(pm_contact_part_stiffness(&s.assembly, &interface[1], folder, &stiffness),
                     PM_EWEIGHTS);
    assert_non_null(strstr(pm_error(), "expected the part between middle and top"));
    assert_true(stiffness == 7);
    free_stack(&s);
}

// Fields with different numbers of trajectories, states or nodes are refused.
static void fields_that_do_not_fit_are_refused(void **state) {
    (void)state;
    stack s;
    make_stack(&s);
    pm_dataset *d = NULL;
    double error = -1;
    const pm_field *const *field = (const pm_field *const *)s.field;
    assert_int_equal(pm_body_assembly_project(&d, &s.assembly, field, 1, &trajectory, 300), PM_OK);
    int *const number[] = {&s.field[2]->ntrajectory, &s.field[2]->ntime, &s.field[2]->nnode};
    for (int i = 0; i < 3; ++i) {
        pm_dataset *none = NULL;
        --*number[i];
        assert_int_equal(pm_body_assembly_check(&s.assembly, field), PM_EDATA);
        assert_non_null(strstr(pm_error(), "the field of top has"));
        assert_int_equal(pm_body_assembly_project(&none, &s.assembly, field, 1, &trajectory, 300),
                         PM_EDATA);
        assert_int_equal(pm_contact_force_errors(&s.assembly, &s.assembly.interface[1], d, 1, field,
                                                 &trajectory, &error),
                         PM_EDATA);
        ++*number[i];
    }
    assert_int_equal(pm_body_assembly_check(&s.assembly, field), PM_OK);
    pm_dataset_free(d);
    free_stack(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(neighbours_have_interfaces),
        cmocka_unit_test(matrices_give_the_openings),
        cmocka_unit_test(the_part_stores_the_openings),
        cmocka_unit_test(forces_are_compared),
        cmocka_unit_test(forces_are_the_slope_of_the_energy),
        cmocka_unit_test_setup_teardown(the_stiffness_comes_back_from_weights, scratch_setup,
                                        scratch_teardown),
        cmocka_unit_test(fields_that_do_not_fit_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
