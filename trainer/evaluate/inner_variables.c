// Lets a body of each solid follow the displacements of a dataset.
#include "evaluate/inner_variables.h"

#include <string.h>

static pm_status open_body(pm_inner_body *body, const pm_system *system, int id) {
    const pm_part *part = system->part[id];
    const int first = system->scene->subsystem[id].first;
    *body = (pm_inner_body){.u = first + pm_layout_find(&part->layout, "u")->first,
                            .inner = first + pm_layout_find(&part->layout, "inner")->first};
    pm_solid_material_read(part->spec.solid, &part->params, &body->material);
    return pm_solid_open(&body->solid, system->mesh[id], &body->material);
}

// Returns true if subsystem number `id` is a solid whose inner variables have no columns.
static bool lacks_inner(const pm_system *system, const pm_columns *columns, int id) {
    const pm_part *part = system->part[id];
    const pm_group *group =
        part->spec.solid == NULL ? NULL : pm_layout_find(&part->layout, "inner");
    return group != NULL && columns->column[system->scene->subsystem[id].first + group->first] < 0;
}

pm_status pm_inner_variables_open(pm_inner_variables *inner, pm_arena *arena,
                                  const pm_system *system, const pm_columns *columns) {
    const int n = system->scene->nsubsystem;
    *inner = (pm_inner_variables){.body = pm_arena_array(arena, (size_t)n, sizeof *inner->body)};
    if (inner->body == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for inner variables");
    }
    for (int i = 0; i < n; ++i) {
        if (lacks_inner(system, columns, i)) {
            PM_TRY(open_body(&inner->body[inner->count++], system, i));
        }
    }
    return PM_OK;
}

void pm_inner_variables_close(pm_inner_variables *inner) {
    for (int i = 0; i < inner->count; ++i) {
        pm_solid_close(inner->body[i].solid);
    }
    inner->count = 0;
}

void pm_inner_variables_start(pm_inner_variables *inner, const double *z) {
    for (int i = 0; i < inner->count; ++i) {
        pm_solid_set_state(inner->body[i].solid, z + inner->body[i].u, z + inner->body[i].inner);
    }
}

void pm_inner_variables_follow(pm_inner_variables *inner, double h, double *z) {
    for (int i = 0; i < inner->count; ++i) {
        const pm_inner_body *b = &inner->body[i];
        pm_solid_follow(b->solid, h, z + b->u, NULL);
        memcpy(z + b->inner, pm_solid_inner(b->solid),
               (size_t)pm_solid_ninner(b->solid) * sizeof *z);
    }
}
