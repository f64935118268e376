// What lies between two bodies as a part: how far each has travelled, mode by mode, makes the
// openings between all pairs of facing points.
#include <stdbool.h>
#include <string.h>

#include "modal/body_assembly.h"

#define FORMULA "k/2*|min(g + creep + u*slope_u + v*slope_v, 0)|^2"

enum { TRAVEL_A, TRAVEL_B, CREEP, ENTROPY, NGROUP };

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a gap");
}

// Whether a body's name stands for something else in the formula.
static bool is_taken(const char *name) {
    bool taken = strcmp(name, "k") == 0 || strcmp(name, "creep") == 0 || strcmp(name, "s") == 0;
    for (int i = 0; i < PM_CONTACT_GROUPS; ++i) {
        taken = taken || strcmp(name, pm_contact_interface_group[i]) == 0;
    }
    return taken;
}

static pm_status fill_layout(const pm_body_assembly *a, const pm_contact_interface *m,
                             pm_layout *layout) {
    const char *const body[2] = {a->body[m->body[0]].name, a->body[m->body[1]].name};
    for (int i = 0; i < 2; ++i) {
        if (is_taken(body[i])) {
            return pm_fail(PM_ECONFIG, "a body that meets another cannot be called \"%s\"",
                           body[i]);
        }
    }
    const int size[NGROUP] = {a->basis->nstate, a->basis->nstate, m->facing.npair, 1};
    const char *const name[NGROUP] = {body[0], body[1], "creep", "s"};
    const char *const unit[NGROUP] = {"J^0.5", "J^0.5", "m", "J/K"};
    *layout = (pm_layout){0};
    for (int i = 0; i < NGROUP; ++i) {
        layout->group[i] = (pm_group){name[i], unit[i], size[i], layout->nz};
        layout->nz += size[i];
    }
    layout->ngroup = NGROUP;
    return PM_OK;
}

// The spec, with everything it points to in the arena.
static pm_status fill_spec(const pm_body_assembly *a, const pm_contact_interface *m,
                           const pm_gap_constants *c, pm_part *part, pm_arena *arena) {
    static const char *const names[] = {"k"}, *const entropy[] = {"s"};
    const char **of = pm_arena_array(arena, 2, sizeof *of);
    double *number = pm_arena_array(arena, 2, sizeof *number);
    pm_constants *constants = pm_arena_array(arena, 1, sizeof *constants);
    pm_formula *formula = pm_arena_array(arena, 1, sizeof *formula);
    pm_given_pair *pair = pm_arena_array(arena, 1, sizeof *pair);
    pm_derived_spec *derived = pm_arena_array(arena, PM_CONTACT_GROUPS, sizeof *derived);
    if (of == NULL || number == NULL || constants == NULL || formula == NULL || pair == NULL ||
        derived == NULL) {
        return no_memory();
    }
    of[0] = part->layout.group[TRAVEL_A].name;
    of[1] = part->layout.group[TRAVEL_B].name;
    for (int i = 0; i < PM_CONTACT_GROUPS; ++i) {
        derived[i] = (pm_derived_spec){.name = pm_contact_interface_group[i],
                                       .size = m->facing.npair,
                                       .ngroup = 2,
                                       .group = of};
    }
    number[0] = c->stiffness;
    number[1] = a->basis->temperature;
    *constants = (pm_constants){1, names, number};
    *formula = (pm_formula){FORMULA, constants, NULL};
    *pair = (pm_given_pair){"creep", "s", a->basis->temperature * c->creep, {0}};
    part->spec = (pm_part_spec){
        .form = PM_HARD,
        .constants = constants,
        .nderived = PM_CONTACT_GROUPS,
        .derived = derived,
        .energy = {.nformula = 1,
                   .formula = formula,
                   .ngiven = 1,
                   .given = entropy,
                   .given_coefficient = number + 1},
        .entropy = {.ngiven = 1, .given = entropy},
        .irreversible = {.ngiven = c->creep > 0, .given = pair},
    };
    return PM_OK;
}

static double *values_of(const pm_part *part, const char *derived, const char *what,
                         pm_arena *arena) {
    const char *name = pm_arena_printf(arena, "derived.%s.%s", derived, what);
    return name == NULL ? NULL : pm_params_find(&part->params, name)->value;
}

// Both ends' matrices side by side, and the undeformed gap.
static pm_status fill_images(const pm_body_assembly *a, const pm_contact_interface *m,
                             pm_part *part, pm_arena *arena) {
    const int n = m->facing.npair, nstate = a->basis->nstate;
    double *one = pm_arena_array(arena, (size_t)(PM_CONTACT_GROUPS * n * nstate), sizeof *one);
    if (one == NULL) {
        return no_memory();
    }
    for (int end = 0; end < 2; ++end) {
        PM_TRY(pm_contact_interface_matrix(a, m, end, one));
        for (int i = 0; i < PM_CONTACT_GROUPS; ++i) {
            const char *derived = pm_contact_interface_group[i];
            double *matrix = values_of(part, derived, "matrix", arena);
            double *offset = values_of(part, derived, "offset", arena);
            if (matrix == NULL || offset == NULL) {
                return no_memory();
            }
            for (int k = 0; k < n; ++k) {
                memcpy(matrix + (ptrdiff_t)(2 * k + end) * nstate,
                       one + (ptrdiff_t)(i * n + k) * nstate, (size_t)nstate * sizeof *one);
                offset[k] = i == PM_CONTACT_GAP ? m->facing.pair[k].gap : 0;
            }
        }
    }
    return PM_OK;
}

pm_status pm_contact_interface_part(const pm_body_assembly *a, const pm_contact_interface *m,
                                    const pm_gap_constants *c, pm_arena *arena, pm_part *part) {
    *part = (pm_part){0};
    PM_TRY(fill_layout(a, m, &part->layout));
    PM_TRY(fill_spec(a, m, c, part, arena));
    PM_TRY(pm_part_declare(part));
    return fill_images(a, m, part, arena);
}
