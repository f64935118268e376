// Reads the source of the model of a subsystem or port: a weights file, or a known model. A known
// model is defined in the section `models` and may be used by several components, each with
// constants of its own.
#include "scene/model_reader.h"
#include "scene/scene_reader.h"

// Reads `weights` or `model`. `made_by` receives the block in the section `models`; it is absent if
// there are weights.
static pm_status read_maker(pm_scene_reader *r, pm_yaml block, const char **weights,
                            const char **at, pm_yaml *made_by) {
    const pm_yaml file = pm_yaml_get(block, "weights"), model = pm_yaml_get(block, "model");
    const pm_yaml constants = pm_yaml_get(block, "constants");
    if (pm_yaml_exists(file) == pm_yaml_exists(model)) {
        return pm_yaml_fail(block, "expected either \"weights\", a file, or \"model\", a name");
    }
    PM_TRY(pm_scene_read_at(r, pm_yaml_exists(file) ? file : model, at));
    if (pm_yaml_exists(file)) {
        *made_by = (pm_yaml){0};
        return pm_yaml_exists(constants) ? pm_yaml_fail(constants, "only a model has constants")
                                         : pm_scene_read_path(r, file, weights);
    }
    const char *name;
    PM_TRY(pm_yaml_text(model, r->arena, &name));
    *made_by = pm_yaml_get(pm_yaml_get(r->root, "models"), name);
    return pm_yaml_exists(*made_by)
               ? PM_OK
               : pm_yaml_fail(model, "there is no model \"%.64s\" under models", name);
}

pm_status pm_scene_read_part_maker(pm_scene_reader *r, pm_yaml block,
                                   pm_scene_subsystem *subsystem) {
    pm_yaml model;
    PM_TRY(read_maker(r, block, &subsystem->weights, &subsystem->weights_at, &model));
    if (!pm_yaml_exists(model)) {
        return PM_OK;
    }
    pm_part_spec *spec = pm_arena_array(r->arena, 1, sizeof *spec);
    subsystem->model = spec;
    return spec == NULL ? pm_scene_no_memory()
                        : pm_part_spec_read(model, pm_yaml_get(block, "constants"), r->arena, spec);
}

pm_status pm_scene_read_port_maker(pm_scene_reader *r, pm_yaml block, pm_scene_port *port) {
    pm_yaml model;
    PM_TRY(read_maker(r, block, &port->weights, &port->weights_at, &model));
    if (!pm_yaml_exists(model)) {
        return PM_OK;
    }
    pm_port_spec *spec = pm_arena_array(r->arena, 1, sizeof *spec);
    port->model = spec;
    return spec == NULL ? pm_scene_no_memory()
                        : pm_port_spec_read(model, pm_yaml_get(block, "constants"), r->arena, spec);
}
