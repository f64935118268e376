// Finds the columns of an interface, and applies its matrices to a row.
#include "modal/contact_openings.h"

#include <string.h>

// Finds the first of `count` columns by its name; the others follow it.
static pm_status find_column(const pm_dataset *d, const char *name, int count, int *first) {
    *first = 0;
    while (*first < d->ncolumn && strcmp(d->column[*first], name) != 0) {
        ++*first;
    }
    return *first + count <= d->ncolumn
               ? PM_OK
               : pm_fail(PM_EDATA, "the dataset has no columns from \"%s\" on", name);
}

// Finds the first column of a group of the interface.
static pm_status find_group(const pm_body_assembly *a, const pm_contact_interface *m,
                            const pm_dataset *d, const char *group, int count, pm_arena *arena,
                            int *first) {
    const char *name = pm_arena_printf(arena, "%s_%s_%s0", a->body[m->body[0]].name,
                                       a->body[m->body[1]].name, group);
    return name == NULL ? pm_fail(PM_ENOMEM, "out of memory for the name of a column")
                        : find_column(d, name, count, first);
}

pm_status pm_contact_openings_open(pm_contact_openings *o, const pm_body_assembly *a,
                                   const pm_contact_interface *m, const pm_dataset *modes,
                                   pm_arena *arena) {
    const size_t count = PM_CONTACT_GROUPS * (size_t)m->pairs.npair;
    *o = (pm_contact_openings){.interface = m};
    o->value = pm_arena_array(arena, count, sizeof *o->value);
    for (int end = 0; end < 2; ++end) {
        o->size[end] = pm_body_assembly_size(a, m->body[end]);
        o->matrix[end] = pm_arena_array(arena, count * (size_t)o->size[end], sizeof(double));
        if (o->value == NULL || o->matrix[end] == NULL) {
            return pm_fail(PM_ENOMEM, "out of memory for openings");
        }
        PM_TRY(pm_contact_interface_matrix(a, m, end, o->matrix[end]));
        PM_TRY(find_group(a, m, modes, a->body[m->body[end]].name, o->size[end], arena,
                          &o->travel[end]));
    }
    return find_group(a, m, modes, "creep", m->pairs.npair, arena, &o->creep);
}

const double *pm_contact_openings_compute(const pm_contact_openings *o, const double *row) {
    const int n = o->interface->pairs.npair;
    for (int i = 0; i < PM_CONTACT_GROUPS * n; ++i) {
        double sum = i < n ? o->interface->pairs.pair[i].gap + row[o->creep + i] : 0;
        for (int end = 0; end < 2; ++end) {
            for (int k = 0; k < o->size[end]; ++k) {
                sum += o->matrix[end][(ptrdiff_t)i * o->size[end] + k] * row[o->travel[end] + k];
            }
        }
        o->value[i] = sum;
    }
    return o->value;
}
