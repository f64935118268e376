// The map between dataset columns and states. A component measured from another (relative_to) is
//     z_i = row[column_i] - row[column of base_i],
// where base_i may be measured from a third component, and so on. A row is written in an order in
// which the column of base_i is there before that of z_i.
#include "scene/columns.h"

#include <string.h>

#include "base/unit.h"
#include "store/names.h"

// Finds the columns of a subsystem's state. `mapped` marks the columns of the dataset that are
// taken.
static pm_status bind_subsystem(pm_columns *c, const pm_scene_subsystem *subsystem,
                                const pm_dataset *dataset, const pm_names *names, bool *mapped,
                                pm_arena *arena) {
    if (subsystem->column == NULL) {
        return pm_fail(PM_ECONFIG, "%s: subsystem %s maps no columns of the dataset", subsystem->at,
                       subsystem->name);
    }
    int g = 0; // the group of component i
    for (int i = 0; i < subsystem->layout.nz; ++i) {
        g += i >= subsystem->layout.group[g].first + subsystem->layout.group[g].size;
        const int k = pm_names_find(names, subsystem->column[i]);
        if (k < 0 && subsystem->mesh != NULL && subsystem->hidden[g]) {
            c->column[subsystem->first + i] = -1; // of a solid, and nobody measures it
            continue;
        }
        if (k < 0 && subsystem->hidden != NULL && subsystem->hidden[g]) {
            return pm_fail(PM_EDATA,
                           "%s: subsystem %s: nobody measures %s, so that its start must be "
                           "estimated: evaluate with --estimate, and run with `estimate` in the "
                           "scene's `reference`, or with `initial` states",
                           subsystem->column_at[i], subsystem->name, subsystem->column[i]);
        }
        if (k < 0) {
            const char *list = pm_names_fold(dataset->column, dataset->ncolumn, arena);
            return pm_fail(
                PM_EDATA,
                "%s: subsystem %s: column \"%s\" is not in the dataset, which has: %.255s",
                subsystem->column_at[i], subsystem->name, subsystem->column[i],
                list == NULL ? "" : list);
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

bool pm_columns_combine(const pm_columns *columns, const pm_scene *scene) {
    int mapped = 0;
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *own = &scene->physics.subsystem[i];
        for (int g = 0; g < own->layout.ngroup; ++g) {
            mapped += columns->group[own->first + own->layout.group[g].first] >= 0;
        }
    }
    return mapped > columns->ngroup;
}

pm_status pm_columns_check_unit(const pm_scene_subsystem *subsystem, int group_id,
                                const char *column, const char *unit) {
    const pm_group *group = &subsystem->layout.group[group_id];
    return *unit == '\0' || strcmp(unit, group->unit) == 0
               ? PM_OK
               : pm_fail(PM_EDATA,
                         "%s: group %s.%s has the unit \"%s\", and the dataset's column \"%s\" has "
                         "\"%s\", which cannot be converted",
                         subsystem->group_at[group_id], subsystem->name, group->name, group->unit,
                         column, unit);
}

// Numbers the group's name among those of all groups, in order of first appearance, and finds what
// its components are measured from.
static pm_status bind_group(pm_columns *c, const pm_scene *scene,
                            const pm_scene_subsystem *subsystem, int group_id) {
    const pm_group *group = &subsystem->layout.group[group_id];
    const int other_id = subsystem->relative_subsystem[group_id];
    int base = -1;
    if (other_id >= 0) {
        const pm_scene_subsystem *other = &scene->physics.subsystem[other_id];
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
    int index = mapped ? 0 : -1;
    if (mapped) {
        while (index < c->ngroup && strcmp(c->group_name[index], group->name) != 0) {
            ++index;
        }
        c->group_name[index] = group->name;
        c->ngroup += index == c->ngroup;
    }
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
    PM_TRY(pm_arena_status(arena, "columns"));
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

// --- units ---

// The columns of a dataset, and what they are converted to. The arrays [ncolumn] lie in the
// dataset's arena.
typedef struct converter {
    pm_arena *arena;
    pm_names names;
    const char **unit;      // of the file, then that of the scene
    pm_unit_change *change; // factor 0: the scene does not use the column yet
} converter;

// Converts a column to a unit, called `to`, in which the scene uses it.
static pm_status convert_column(converter *c, const char *column, const pm_unit *unit,
                                const char *to, const char *at) {
    const int k = column == NULL ? -1 : pm_names_find(&c->names, column);
    pm_unit_change own = {0};
    if (k < 0) {
        return PM_OK;
    }
    pm_unit_change *change = &c->change[k];
    own.from = change->from == NULL ? c->unit[k] : change->from;
    if (*own.from == '\0' || !pm_unit_conversion(own.from, unit, &own.factor, &own.offset)) {
        return PM_OK;
    }
    if (change->factor != 0 && (change->factor != own.factor || change->offset != own.offset)) {
        return pm_fail(PM_ECONFIG, "%s: the column \"%s\" is used in %s, and elsewhere in %s", at,
                       column, to, c->unit[k]);
    }
    if (change->factor == 0 && strcmp(c->unit[k], to) != 0) {
        c->unit[k] = to;
        *change = own;
    } else if (change->factor == 0) {
        change->factor = own.factor;
    }
    return PM_OK;
}

// Converts the columns that a boundary input follows.
static pm_status convert_prescribed(converter *c, const pm_scene_boundary_input *input) {
    const pm_unit joule = pm_unit_parse("J"), entropy = pm_unit_parse("J/K");
    int g = 0;
    for (int i = 0; i < input->layout.nz; ++i) {
        g += i >= input->layout.group[g].first + input->layout.group[g].size;
        const char *own = input->layout.group[g].unit;
        const pm_unit state = pm_unit_parse(own);
        const pm_unit unit[3] = {state, pm_unit_quotient(&joule, &state),
                                 pm_unit_quotient(&entropy, &state)};
        for (int k = 0; k < 3; ++k) {
            const pm_scene_prescribed *value = &input->value[k * input->layout.nz + i];
            const char *symbol = k == 0 ? own : pm_unit_symbol(&unit[k]);
            const char *to = symbol != NULL
                                 ? pm_arena_strdup(c->arena, symbol)
                                 : pm_arena_printf(c->arena, "%s/(%s)", k == 1 ? "J" : "J/K", own);
            PM_TRY(pm_arena_status(c->arena, "units"));
            const int column = value->column == NULL ? -1 : pm_names_find(&c->names, value->column);
            const char *given = column < 0 ? "" : c->unit[column];
            double factor, offset;
            if (*given != '\0' && pm_unit_parse(given).known && unit[k].known &&
                !pm_unit_conversion(given, &unit[k], &factor, &offset)) {
                return pm_fail(PM_EDATA, "%s: the column \"%s\" is in %s, expected %s", value->at,
                               value->column, given, to);
            }
            PM_TRY(convert_column(c, value->column, &unit[k], to, value->at));
        }
    }
    return PM_OK;
}

pm_status pm_columns_convert(const pm_scene *scene, pm_dataset *dataset) {
    converter c = {.arena = &dataset->arena};
    PM_TRY(pm_dataset_units(dataset, c.arena, &c.unit));
    if (c.unit == NULL) {
        return PM_OK;
    }
    PM_TRY(pm_names_sort(&c.names, dataset->column, dataset->ncolumn, c.arena));
    c.change = pm_arena_array(c.arena, (size_t)dataset->ncolumn, sizeof *c.change);
    PM_TRY(pm_arena_status(c.arena, "units"));
    for (int s = 0; s < scene->physics.nsubsystem; ++s) {
        const pm_scene_subsystem *subsystem = &scene->physics.subsystem[s];
        for (int g = 0; g < subsystem->layout.ngroup && subsystem->column != NULL; ++g) {
            const pm_group *group = &subsystem->layout.group[g];
            const char *to = pm_arena_strdup(c.arena, group->unit);
            const pm_unit unit = pm_unit_parse(group->unit);
            PM_TRY(pm_arena_status(c.arena, "units"));
            for (int i = group->first; i < group->first + group->size; ++i) {
                PM_TRY(convert_column(&c, subsystem->column[i], &unit, to, subsystem->group_at[g]));
            }
        }
    }
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        PM_TRY(convert_prescribed(&c, &scene->physics.boundary_input[i]));
    }
    for (int k = 0; k < dataset->ncolumn; ++k) {
        if (c.change[k].from != NULL) {
            return pm_dataset_change_units(dataset, c.change, c.unit);
        }
    }
    return PM_OK;
}

// --- binding ---

pm_status pm_columns_bind(pm_columns *columns, const pm_scene *scene, const pm_dataset *dataset,
                          pm_arena *arena) {
    const size_t nz = (size_t)scene->physics.nz;
    pm_columns c = {
        .nz = scene->physics.nz,
        .column = pm_arena_array(arena, nz, sizeof *c.column),
        .base = pm_arena_array(arena, nz, sizeof *c.base),
        .order = pm_arena_array(arena, nz, sizeof *c.order),
        .group = pm_arena_array(arena, nz, sizeof *c.group),
        .group_name = pm_arena_array(arena, nz, sizeof *c.group_name),
    };
    pm_names names;
    const char **unit;
    bool *mapped = pm_arena_array(arena, (size_t)dataset->ncolumn, sizeof *mapped);
    PM_TRY(pm_arena_status(arena, "columns"));
    PM_TRY(pm_names_sort(&names, dataset->column, dataset->ncolumn, arena));
    for (int s = 0; s < scene->physics.nsubsystem; ++s) {
        PM_TRY(bind_subsystem(&c, &scene->physics.subsystem[s], dataset, &names, mapped, arena));
    }
    PM_TRY(pm_dataset_units(dataset, arena, &unit));
    for (int s = 0; s < scene->physics.nsubsystem; ++s) {
        const pm_scene_subsystem *subsystem = &scene->physics.subsystem[s];
        for (int g = 0; g < subsystem->layout.ngroup && unit != NULL; ++g) {
            const pm_group *group = &subsystem->layout.group[g];
            for (int i = 0; i < group->size; ++i) {
                const int k = c.column[subsystem->first + group->first + i];
                PM_TRY(k < 0 ? PM_OK
                             : pm_columns_check_unit(subsystem, g, dataset->column[k], unit[k]));
            }
        }
    }
    for (int s = 0; s < scene->physics.nsubsystem; ++s) {
        for (int g = 0; g < scene->physics.subsystem[s].layout.ngroup; ++g) {
            PM_TRY(bind_group(&c, scene, &scene->physics.subsystem[s], g));
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
