// Makes the part from the matrices of an interface, and reads its stiffness back from weights.
#include "bodies/modal/contact_part.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#include "scene/weights.h"

#define FORMULA "k/2*|min(g + creep + u*slope_u + v*slope_v, 0)|^2"

// The groups of the state.
enum { TRAVEL_A, TRAVEL_B, CREEP, ENTROPY, NGROUP };

static pm_status fill_layout(const pm_body_assembly *a, const pm_contact_interface *m,
                             pm_group *group, pm_layout *layout) {
    const char *const body[2] = {a->body[m->body[0]].name, a->body[m->body[1]].name};
    for (int i = 0; i < 2; ++i) {
        // The name must not mean something else in the formula or the layout.
        bool taken =
            strcmp(body[i], "k") == 0 || strcmp(body[i], "creep") == 0 || strcmp(body[i], "s") == 0;
        for (int g = 0; g < PM_CONTACT_GROUPS; ++g) {
            taken = taken || strcmp(body[i], pm_contact_group_name[g]) == 0;
        }
        if (taken) {
            return pm_fail(PM_ECONFIG, "a body that faces another cannot be called \"%s\"",
                           body[i]);
        }
    }
    const int size[NGROUP] = {pm_body_assembly_size(a, m->body[0]),
                              pm_body_assembly_size(a, m->body[1]), m->pairs.npair, 1};
    const char *const name[NGROUP] = {body[0], body[1], "creep", "s"};
    const char *const unit[NGROUP] = {pm_body_assembly_is_solid(a, m->body[0]) ? "m" : "J^0.5",
                                      pm_body_assembly_is_solid(a, m->body[1]) ? "m" : "J^0.5", "m",
                                      "J/K"};
    *layout = (pm_layout){.group = group};
    for (int i = 0; i < NGROUP; ++i) {
        pm_layout_add(layout, name[i], unit[i], size[i]);
    }
    return PM_OK;
}

// Fills in the spec; everything that it points to lies in the arena.
static pm_status fill_spec(const pm_contact_interface *m, const pm_contact_constants *c,
                           pm_part *part, pm_arena *arena) {
    static const char *const names[] = {"k"}, *const entropy[] = {"s"};
    const char **of = pm_arena_array(arena, 2, sizeof *of);
    double *number = pm_arena_array(arena, 2, sizeof *number);
    pm_constants *constants = pm_arena_array(arena, 1, sizeof *constants);
    pm_formula *formula = pm_arena_array(arena, 1, sizeof *formula);
    pm_given_pair *pair = pm_arena_array(arena, 1, sizeof *pair);
    pm_derived_spec *derived = pm_arena_array(arena, PM_CONTACT_GROUPS, sizeof *derived);
    PM_TRY(pm_arena_status(arena, "a part between bodies"));
    of[0] = part->layout.group[TRAVEL_A].name;
    of[1] = part->layout.group[TRAVEL_B].name;
    for (int i = 0; i < PM_CONTACT_GROUPS; ++i) {
        derived[i] = (pm_derived_spec){
            .name = pm_contact_group_name[i], .size = m->pairs.npair, .ngroup = 2, .group = of};
    }
    number[0] = c->stiffness;
    number[1] = c->temperature;
    *constants = (pm_constants){.count = 1, .name = names, .value = number};
    *formula = (pm_formula){FORMULA, constants, NULL};
    *pair = (pm_given_pair){.row = "creep", .col = "s", .coefficient = c->temperature * c->creep};
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

pm_status pm_contact_part_make(const pm_body_assembly *a, const pm_contact_interface *m,
                               const pm_contact_constants *c, pm_arena *arena, pm_part *part) {
    const int n = m->pairs.npair, size[2] = {pm_body_assembly_size(a, m->body[0]),
                                             pm_body_assembly_size(a, m->body[1])};
    *part = (pm_part){0};
    pm_group *group = pm_arena_array(arena, NGROUP, sizeof *group);
    PM_TRY(pm_arena_status(arena, "a part between bodies"));
    PM_TRY(fill_layout(a, m, group, &part->layout));
    PM_TRY(fill_spec(m, c, part, arena));
    PM_TRY(pm_part_declare(part));
    // The matrices of both ends, side by side, and the undeformed gap as the offset of g.
    for (int end = 0; end < 2; ++end) {
        double *one =
            pm_arena_array(arena, (size_t)(PM_CONTACT_GROUPS * n * size[end]), sizeof *one);
        PM_TRY(pm_arena_status(arena, "a part between bodies"));
        PM_TRY(pm_contact_interface_matrix(a, m, end, one));
        for (int i = 0; i < PM_CONTACT_GROUPS; ++i) {
            const char *derived = pm_contact_group_name[i];
            char matrix_name[64], offset_name[64];
            snprintf(matrix_name, sizeof matrix_name, "derived.%s.matrix", derived);
            snprintf(offset_name, sizeof offset_name, "derived.%s.offset", derived);
            double *matrix = pm_params_find(&part->params, matrix_name)->value;
            double *offset = pm_params_find(&part->params, offset_name)->value;
            for (int k = 0; k < n; ++k) {
                memcpy(matrix + (ptrdiff_t)k * (size[0] + size[1]) + (end == 0 ? 0 : size[0]),
                       one + (ptrdiff_t)(i * n + k) * size[end], (size_t)size[end] * sizeof *one);
                offset[k] = i == PM_CONTACT_GAP ? m->pairs.pair[k].gap : 0;
            }
        }
    }
    return PM_OK;
}

// --- from weights ---

const char *pm_contact_part_path(const pm_body_assembly *a, const pm_contact_interface *m,
                                 const char *folder, pm_arena *arena) {
    return pm_arena_printf(arena, "%s/%s_%s.h5", folder, a->body[m->body[0]].name,
                           a->body[m->body[1]].name);
}

pm_status pm_contact_part_stiffness(const pm_body_assembly *a, const pm_contact_interface *m,
                                    const char *folder, double *stiffness) {
    pm_arena arena = {0};
    pm_part part = {0};
    pm_provenance provenance;
    pm_layout expected;
    pm_group group[NGROUP];
    pm_status status;
    const char *path = pm_contact_part_path(a, m, folder, &arena);
    PM_TRY_DONE(pm_arena_status(&arena, "the path of weights"));
    PM_TRY_DONE(pm_weights_load(path, &arena, pm_component_of_part(&part), &provenance));
    PM_TRY_DONE(a->basis == NULL ? PM_OK : pm_basis_check(a->basis, provenance.coordinates, path));
    // The part must have the layout and the energy of the interface's part.
    const pm_potential_spec *energy = &part.spec.energy;
    const pm_constants *constants = part.spec.constants;
    PM_TRY_DONE(fill_layout(a, m, group, &expected));
    const bool same = pm_layout_equal(&part.layout, &expected) && energy->nformula == 1 &&
                      strcmp(energy->formula[0].text, FORMULA) == 0;
    for (int i = 0; same && constants != NULL && i < constants->count; ++i) {
        if (strcmp(constants->name[i], "k") == 0) {
            *stiffness = constants->value[i];
            goto done;
        }
    }
    status = pm_fail(PM_EWEIGHTS,
                     "%s: expected the part between %s and %s with %d contact pairs, which "
                     "`contact` writes",
                     path, a->body[m->body[0]].name, a->body[m->body[1]].name, m->pairs.npair);
done:
    pm_part_free(&part);
    pm_arena_free(&arena);
    return status;
}
