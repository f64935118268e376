// Makes the part from the matrices of an interface, and reads its stiffness back from weights.
#include "modal/contact_part.h"

#include <stdbool.h>
#include <string.h>

#include "scene/weights.h"

#define FORMULA "k/2*|min(g + creep + u*slope_u + v*slope_v, 0)|^2"

// The groups of the state.
enum { TRAVEL_A, TRAVEL_B, CREEP, ENTROPY, NGROUP };

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a part between bodies");
}

// Returns true if the name of a body already means something else in the formula or the layout.
static bool is_taken(const char *name) {
    bool taken = strcmp(name, "k") == 0 || strcmp(name, "creep") == 0 || strcmp(name, "s") == 0;
    for (int i = 0; i < PM_CONTACT_GROUPS; ++i) {
        taken = taken || strcmp(name, pm_contact_group_name[i]) == 0;
    }
    return taken;
}

static pm_status fill_layout(const pm_body_assembly *a, const pm_contact_interface *m,
                             pm_group *group, pm_layout *layout) {
    const char *const body[2] = {a->body[m->body[0]].name, a->body[m->body[1]].name};
    for (int i = 0; i < 2; ++i) {
        if (is_taken(body[i])) {
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
        layout->group[i] = (pm_group){name[i], unit[i], size[i], layout->nz};
        layout->nz += size[i];
    }
    layout->ngroup = NGROUP;
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
    if (of == NULL || number == NULL || constants == NULL || formula == NULL || pair == NULL ||
        derived == NULL) {
        return no_memory();
    }
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

// Returns the values of a parameter of a derived variable; NULL if memory is exhausted.
static double *values_of(const pm_part *part, const char *derived, const char *what,
                         pm_arena *arena) {
    const char *name = pm_arena_printf(arena, "derived.%s.%s", derived, what);
    return name == NULL ? NULL : pm_params_find(&part->params, name)->value;
}

// Fills in the matrices of both ends, side by side, and the undeformed gap as the offset of g.
static pm_status fill_derived(const pm_body_assembly *a, const pm_contact_interface *m,
                              pm_part *part, pm_arena *arena) {
    const int n = m->pairs.npair;
    const int size[2] = {pm_body_assembly_size(a, m->body[0]),
                         pm_body_assembly_size(a, m->body[1])};
    for (int end = 0; end < 2; ++end) {
        double *one =
            pm_arena_array(arena, (size_t)(PM_CONTACT_GROUPS * n * size[end]), sizeof *one);
        if (one == NULL) {
            return no_memory();
        }
        PM_TRY(pm_contact_interface_matrix(a, m, end, one));
        for (int i = 0; i < PM_CONTACT_GROUPS; ++i) {
            const char *derived = pm_contact_group_name[i];
            double *matrix = values_of(part, derived, "matrix", arena);
            double *offset = values_of(part, derived, "offset", arena);
            if (matrix == NULL || offset == NULL) {
                return no_memory();
            }
            for (int k = 0; k < n; ++k) {
                memcpy(matrix + (ptrdiff_t)k * (size[0] + size[1]) + (end == 0 ? 0 : size[0]),
                       one + (ptrdiff_t)(i * n + k) * size[end], (size_t)size[end] * sizeof *one);
                offset[k] = i == PM_CONTACT_GAP ? m->pairs.pair[k].gap : 0;
            }
        }
    }
    return PM_OK;
}

pm_status pm_contact_part_make(const pm_body_assembly *a, const pm_contact_interface *m,
                               const pm_contact_constants *c, pm_arena *arena, pm_part *part) {
    *part = (pm_part){0};
    pm_group *group = pm_arena_array(arena, NGROUP, sizeof *group);
    PM_TRY(group == NULL ? no_memory() : fill_layout(a, m, group, &part->layout));
    PM_TRY(fill_spec(m, c, part, arena));
    PM_TRY(pm_part_declare(part));
    return fill_derived(a, m, part, arena);
}

// --- from weights ---

const char *pm_contact_part_path(const pm_body_assembly *a, const pm_contact_interface *m,
                                 const char *folder, pm_arena *arena) {
    return pm_arena_printf(arena, "%s/%s_%s.h5", folder, a->body[m->body[0]].name,
                           a->body[m->body[1]].name);
}

// Finds k in a part, provided that it has the layout and the energy of the interface's part.
static pm_status find_stiffness(const pm_body_assembly *a, const pm_contact_interface *m,
                                const pm_part *part, const char *path, double *stiffness) {
    const pm_potential_spec *energy = &part->spec.energy;
    const pm_constants *constants = part->spec.constants;
    pm_layout expected;
    pm_group group[NGROUP];
    PM_TRY(fill_layout(a, m, group, &expected));
    const bool same = pm_layout_equal(&part->layout, &expected) && energy->nformula == 1 &&
                      strcmp(energy->formula[0].text, FORMULA) == 0;
    for (int i = 0; same && constants != NULL && i < constants->count; ++i) {
        if (strcmp(constants->name[i], "k") == 0) {
            *stiffness = constants->value[i];
            return PM_OK;
        }
    }
    return pm_fail(PM_EWEIGHTS,
                   "%s: expected the part between %s and %s with %d contact pairs, which `contact` "
                   "writes",
                   path, a->body[m->body[0]].name, a->body[m->body[1]].name, m->pairs.npair);
}

pm_status pm_contact_part_stiffness(const pm_body_assembly *a, const pm_contact_interface *m,
                                    const char *folder, double *stiffness) {
    pm_arena arena = {0};
    pm_part part = {0};
    pm_provenance provenance;
    pm_status status;
    const char *path = pm_contact_part_path(a, m, folder, &arena);
    if (path == NULL) {
        status = no_memory();
        goto done;
    }
    PM_TRY_DONE(pm_weights_load_part(path, &arena, &part, &provenance));
    PM_TRY_DONE(a->basis == NULL ? PM_OK : pm_basis_check(a->basis, provenance.coordinates, path));
    status = find_stiffness(a, m, &part, path, stiffness);
done:
    pm_part_free(&part);
    pm_arena_free(&arena);
    return status;
}
