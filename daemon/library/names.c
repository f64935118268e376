// Composes names of components from those of their owner and their group.
#include "library/names.h"

// A boundary input prescribes three quantities for each component: its value and the two
// co-energies. The state of a subsystem has the value only.
enum { VALUE, ENERGY_SLOPE, ENTROPY_SLOPE, QUANTITIES };

// Writes the names of one quantity of a layout to name and unit [layout->nz].
static void write_names(const char *owner, const pm_layout *layout, int quantity, const char **name,
                        const char **unit, pm_arena *arena) {
    static const char *const derivative[QUANTITIES] = {"", "dE/d", "dS/d"};
    static const char *const before[QUANTITIES] = {"", "J/(", "J/K/("};
    for (int g = 0; g < layout->ngroup; ++g) {
        const pm_group *group = &layout->group[g];
        const char *group_unit = pm_arena_printf(arena, "%s%s%s", before[quantity], group->unit,
                                                 quantity == VALUE ? "" : ")");
        for (int c = group->first; c < group->first + group->size; ++c) {
            name[c] = pm_arena_printf(arena, "%s.%s%s[%d]", owner, derivative[quantity],
                                      group->name, c - group->first);
            unit[c] = group_unit;
        }
    }
}

pm_status pm_scene_variable_names(pm_scene_variables *variables, const pm_scene *scene,
                                  pm_arena *arena) {
    pm_scene_variables *v = variables;
    v->name = pm_arena_array(arena, (size_t)scene->physics.nz, sizeof *v->name);
    v->unit = pm_arena_array(arena, (size_t)scene->physics.nz, sizeof *v->unit);
    v->input_name =
        pm_arena_array(arena, (size_t)scene->physics.nprescribed, sizeof *v->input_name);
    v->input_unit =
        pm_arena_array(arena, (size_t)scene->physics.nprescribed, sizeof *v->input_unit);
    PM_TRY(pm_arena_status(arena, "the names of scene %s", scene->name));
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        const pm_scene_subsystem *s = &scene->physics.subsystem[i];
        write_names(s->name, &s->layout, VALUE, v->name + s->first, v->unit + s->first, arena);
    }
    for (int i = 0; i < scene->physics.nboundary_input; ++i) {
        const pm_scene_boundary_input *b = &scene->physics.boundary_input[i];
        for (int quantity = 0; quantity < QUANTITIES; ++quantity) {
            const int first = b->first + quantity * b->layout.nz;
            write_names(b->name, &b->layout, quantity, v->input_name + first, v->input_unit + first,
                        arena);
        }
    }
    return pm_arena_status(arena, "the names of scene %s", scene->name);
}
