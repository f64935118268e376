// The map between dataset columns and states. A component measured from another (relative_to) is
//     z_i = row[column_i] - row[column of base_i],
// where base_i may be measured from a third component, and so on. A row is written in an order in
// which the column of base_i is there before that of z_i.
#include "scene/columns.h"

#include <string.h>

#include "store/names.h"

static pm_status fail_memory(void) {
    return pm_fail(PM_ENOMEM, "columns: out of memory");
}

static pm_status fail_missing(const pm_scene_subsystem *subsystem, int component,
                              const pm_dataset *dataset, pm_arena *arena) {
    const char *list = pm_names_fold(dataset->column, dataset->ncolumn, arena);
    return pm_fail(PM_EDATA,
                   "%s: subsystem %s: column \"%s\" is not in the dataset, which has: %.255s",
                   subsystem->column_at[component], subsystem->name, subsystem->column[component],
                   list == NULL ? "" : list);
}

// Returns true if a component is one of a solid that nobody measures.
static bool is_internal(const pm_scene_subsystem *subsystem, int component) {
    const pm_layout *layout = &subsystem->layout;
    int g = layout->ngroup - 1;
    while (layout->group[g].first > component) {
        --g;
    }
    return subsystem->mesh != NULL && subsystem->hidden[g];
}

static pm_status bind_subsystem(pm_columns *c, const pm_scene_subsystem *subsystem,
                                const pm_dataset *dataset, const pm_names *names, bool *mapped,
                                pm_arena *arena) {
    if (subsystem->column == NULL) {
        return pm_fail(PM_ECONFIG, "%s: subsystem %s maps no columns of the dataset", subsystem->at,
                       subsystem->name);
    }
    for (int i = 0; i < subsystem->layout.nz; ++i) {
        const int k = pm_names_find(names, subsystem->column[i]);
        if (k < 0 && is_internal(subsystem, i)) {
            c->column[subsystem->first + i] = -1;
            continue;
        }
        if (k < 0) {
            return fail_missing(subsystem, i, dataset, arena);
        }
        if (mapped[k]) {
            return pm_fail(PM_ECONFIG, "%s: subsystem %s: column \"%s\" is mapped twice",
                           subsystem->column_at[i], subsystem->name, subsystem->column[i]);
        }
        mapped[k] = true;
        c->column[subsystem->first + i] = k;
    }
    return PM_OK;
}

pm_status pm_columns_check_unit(const pm_scene_subsystem *subsystem, int group_id,
                                const char *column, const char *unit) {
    const pm_group *group = &subsystem->layout.group[group_id];
    return *unit == '\0' || strcmp(unit, group->unit) == 0
               ? PM_OK
               : pm_fail(PM_EDATA,
                         "%s: group %s.%s has the unit \"%s\", and the dataset's column \"%s\" has "
                         "\"%s\"; values are not converted",
                         subsystem->group_at[group_id], subsystem->name, group->name, group->unit,
                         column, unit);
}

static pm_status check_units(const pm_columns *c, const pm_scene *scene, const pm_dataset *dataset,
                             pm_arena *arena) {
    const char **unit;
    PM_TRY(pm_dataset_units(dataset, arena, &unit));
    for (int s = 0; s < scene->nsubsystem && unit != NULL; ++s) {
        const pm_scene_subsystem *subsystem = &scene->subsystem[s];
        for (int g = 0; g < subsystem->layout.ngroup; ++g) {
            const pm_group *group = &subsystem->layout.group[g];
            for (int i = 0; i < group->size; ++i) {
                const int k = c->column[subsystem->first + group->first + i];
                PM_TRY(k < 0 ? PM_OK
                             : pm_columns_check_unit(subsystem, g, dataset->column[k], unit[k]));
            }
        }
    }
    return PM_OK;
}

static pm_status bind_columns(pm_columns *c, const pm_scene *scene, const pm_dataset *dataset,
                              pm_arena *arena) {
    pm_names names;
    bool *mapped = pm_arena_array(arena, (size_t)dataset->ncolumn, sizeof *mapped);
    if (mapped == NULL) {
        return fail_memory();
    }
    PM_TRY(pm_names_sort(&names, dataset->column, dataset->ncolumn, arena));
    for (int s = 0; s < scene->nsubsystem; ++s) {
        PM_TRY(bind_subsystem(c, &scene->subsystem[s], dataset, &names, mapped, arena));
    }
    return PM_OK;
}

// Returns the index of a group's name, in order of first appearance.
static int group_index(pm_columns *c, const char *name) {
    int g = 0;
    while (g < c->ngroup && strcmp(c->group_name[g], name) != 0) {
        ++g;
    }
    c->group_name[g] = name;
    c->ngroup += g == c->ngroup;
    return g;
}

static pm_status bind_group(pm_columns *c, const pm_scene *scene,
                            const pm_scene_subsystem *subsystem, int group_id) {
    const pm_group *group = &subsystem->layout.group[group_id];
    const int other_id = subsystem->relative_subsystem[group_id];
    int base = -1;
    if (other_id >= 0) {
        const pm_scene_subsystem *other = &scene->subsystem[other_id];
        const pm_group *from = &other->layout.group[subsystem->relative_group[group_id]];
        if (from->size != group->size) {
            return pm_fail(PM_ECONFIG,
                           "%s: group %s.%s has %d components, but is measured from %s.%s, which "
                           "has %d",
                           subsystem->group_at[group_id], subsystem->name, group->name, group->size,
                           other->name, from->name, from->size);
        }
        base = other->first + from->first;
    }
    const bool mapped = c->column[subsystem->first + group->first] >= 0;
    const int index = mapped ? group_index(c, group->name) : -1;
    for (int i = 0; i < group->size; ++i) {
        c->group[subsystem->first + group->first + i] = index;
        c->base[subsystem->first + group->first + i] = base < 0 ? -1 : base + i;
    }
    return PM_OK;
}

// Puts the components into an order in which each comes after the one that it is measured from.
// Refuses a chain of bases that comes back to itself.
static pm_status order_components(pm_columns *c, const pm_scene *scene, const pm_dataset *dataset,
                                  pm_arena *arena) {
    enum { UNSEEN, IN_CHAIN, ORDERED };
    char *mark = pm_arena_array(arena, (size_t)c->nz, sizeof *mark); // zeroed: UNSEEN
    int *chain = pm_arena_array(arena, (size_t)c->nz, sizeof *chain);
    if (mark == NULL || chain == NULL) {
        return fail_memory();
    }
    int count = 0;
    for (int i = 0; i < c->nz; ++i) {
        int length = 0;
        int k = i;
        for (; k >= 0 && mark[k] == UNSEEN; k = c->base[k]) {
            mark[k] = IN_CHAIN;
            chain[length++] = k;
        }
        if (k >= 0 && mark[k] == IN_CHAIN) {
            return pm_fail(PM_ECONFIG, "%s: column \"%s\" is measured from itself (relative_to)",
                           scene->path, dataset->column[c->column[i]]);
        }
        while (length > 0) {
            k = chain[--length];
            mark[k] = ORDERED;
            c->order[count++] = k;
        }
    }
    return PM_OK;
}

pm_status pm_columns_bind(pm_columns *columns, const pm_scene *scene, const pm_dataset *dataset,
                          pm_arena *arena) {
    const size_t nz = (size_t)scene->nz;
    pm_columns c = {
        .nz = scene->nz,
        .column = pm_arena_array(arena, nz, sizeof *c.column),
        .base = pm_arena_array(arena, nz, sizeof *c.base),
        .order = pm_arena_array(arena, nz, sizeof *c.order),
        .group = pm_arena_array(arena, nz, sizeof *c.group),
        .group_name = pm_arena_array(arena, nz, sizeof *c.group_name),
    };
    if (c.column == NULL || c.base == NULL || c.order == NULL || c.group == NULL ||
        c.group_name == NULL) {
        return fail_memory();
    }
    PM_TRY(bind_columns(&c, scene, dataset, arena));
    PM_TRY(check_units(&c, scene, dataset, arena));
    for (int s = 0; s < scene->nsubsystem; ++s) {
        for (int g = 0; g < scene->subsystem[s].layout.ngroup; ++g) {
            PM_TRY(bind_group(&c, scene, &scene->subsystem[s], g));
        }
    }
    PM_TRY(order_components(&c, scene, dataset, arena));
    *columns = c;
    return PM_OK;
}

void pm_columns_to_state(const pm_columns *columns, const double *row, double *z) {
    for (int i = 0; i < columns->nz; ++i) {
        const int base = columns->base[i];
        z[i] = columns->column[i] < 0
                   ? 0
                   : row[columns->column[i]] - (base < 0 ? 0 : row[columns->column[base]]);
    }
}

void pm_columns_to_row(const pm_columns *columns, const double *z, double *row) {
    for (int i = 0; i < columns->nz; ++i) {
        const int k = columns->order[i];
        const int base = columns->base[k];
        if (columns->column[k] >= 0) {
            row[columns->column[k]] = z[k] + (base < 0 ? 0 : row[columns->column[base]]);
        }
    }
}
