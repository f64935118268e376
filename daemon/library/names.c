// Composes names of components from those of their owner and their group.
#include "library/names.h"

#include "base/unit.h"

// These quantities have names: the value of a variable, the derivatives of energy and entropy by
// it, and its rate. A boundary input prescribes the first three.
enum { VALUE, ENERGY_SLOPE, ENTROPY_SLOPE, PRESCRIBED, RATE = PRESCRIBED };

// Returns the unit of a quantity of a variable in `unit`, such as "m/s" for the slope of the energy
// by a momentum. Where it has no short name it is written as a quotient.
static const char *unit_of(int quantity, const char *unit, pm_arena *arena) {
    static const char *const above[] = {"", "J/(%s)", "J/K/(%s)", "(%s)/s"};
    static const char *const numerator[] = {"", "J", "J/K", "s"};
    if (quantity == VALUE) {
        return unit;
    }
    const pm_unit own = pm_unit_parse(unit), other = pm_unit_parse(numerator[quantity]);
    const pm_unit whole =
        quantity == RATE ? pm_unit_quotient(&own, &other) : pm_unit_quotient(&other, &own);
    char text[PM_UNIT_NAME];
    return pm_unit_name(&whole, text) ? pm_arena_strdup(arena, text)
                                      : pm_arena_printf(arena, above[quantity], unit);
}

// Writes the names of one quantity of a layout from names->name[first] on.
static void write_names(const char *owner, const pm_layout *layout, int quantity,
                        pm_name_list names, int first, pm_arena *arena) {
    static const char *const before[] = {"", "dE/d", "dS/d", "d"};
    for (int g = 0; g < layout->ngroup; ++g) {
        const pm_group *group = &layout->group[g];
        const char *unit = unit_of(quantity, group->unit, arena);
        for (int c = 0; c < group->size; ++c) {
            const int i = first + group->first + c;
            names.name[i] = pm_arena_printf(arena, "%s.%s%s%s[%d]", owner, before[quantity],
                                            group->name, quantity == RATE ? "/dt" : "", c);
            names.unit[i] = unit;
        }
    }
}

pm_status pm_scene_variable_names(pm_scene_variables *variables, const pm_scene *scene,
                                  pm_arena *arena) {
    const pm_physics *physics = &scene->physics;
    pm_scene_variables *v = variables;
    pm_name_list *const all[] = {&v->state, &v->slope[0], &v->slope[1],
                                 &v->rate,  &v->input,    &v->reaction};
    for (int i = 0; i < 6; ++i) {
        const int n = i < 4    ? physics->nz
                      : i == 4 ? physics->nprescribed
                               : physics->nprescribed / PRESCRIBED;
        all[i]->name = pm_arena_array(arena, (size_t)n, sizeof *all[i]->name);
        all[i]->unit = pm_arena_array(arena, (size_t)n, sizeof *all[i]->unit);
    }
    PM_TRY(pm_arena_status(arena, "the names of scene %s", scene->name));
    for (int i = 0; i < physics->nsubsystem; ++i) {
        const pm_scene_subsystem *s = &physics->subsystem[i];
        for (int quantity = VALUE; quantity <= RATE; ++quantity) {
            write_names(s->name, &s->layout, quantity, *all[quantity], s->first, arena);
        }
    }
    for (int i = 0; i < physics->nboundary_input; ++i) {
        const pm_scene_boundary_input *b = &physics->boundary_input[i];
        for (int quantity = VALUE; quantity < PRESCRIBED; ++quantity) {
            write_names(b->name, &b->layout, quantity, v->input, b->first + quantity * b->layout.nz,
                        arena);
        }
        write_names(b->name, &b->layout, RATE, v->reaction, b->first / PRESCRIBED, arena);
    }
    return pm_arena_status(arena, "the names of scene %s", scene->name);
}
