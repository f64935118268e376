// Reads which bodies the configuration of a ground truth places where.
#include "modal/body_assembly.h"
#include "store/yaml.h"

static pm_status read_bodies(pm_yaml root, pm_body_assembly *assembly) {
    const pm_basis *basis = assembly->basis;
    pm_yaml system, beams, key, value;
    PM_TRY(pm_yaml_require(root, "system", &system));
    PM_TRY(pm_yaml_require(system, "beams", &beams));
    PM_TRY(pm_yaml_require_entries(beams));
    assembly->nbody = pm_yaml_count(beams);
    assembly->body =
        pm_arena_array(&assembly->arena, (size_t)assembly->nbody, sizeof *assembly->body);
    assembly->solid =
        pm_arena_array(&assembly->arena, (size_t)assembly->nbody, sizeof *assembly->solid);
    if (assembly->body == NULL || assembly->solid == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for bodies");
    }
    for (int i = 0; i < assembly->nbody; ++i) {
        pm_placed_body *body = &assembly->body[i];
        pm_yaml_entry(beams, i, &key, &value);
        PM_TRY(pm_yaml_text(key, &assembly->arena, &body->name));
        PM_TRY(pm_placement_read(value, &assembly->arena, &body->placement));
        if (basis != NULL) {
            body->nnode = basis->nnode;
            body->nelement = basis->nelement;
            body->position = basis->position;
            body->hexahedron = basis->hexahedron;
        }
    }
    return PM_OK;
}

pm_status pm_body_assembly_read(pm_body_assembly *assembly, const char *path) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status;
    PM_TRY_DONE(pm_yaml_open(&document, path, &root));
    status = read_bodies(root, assembly);
done:
    pm_yaml_close(document);
    return status;
}

pm_status pm_body_assembly_load(pm_body_assembly *assembly, const char *path) {
    PM_TRY(pm_body_assembly_read(assembly, path));
    return pm_body_assembly_find_interfaces(assembly);
}

pm_status pm_body_assembly_make_solid(pm_body_assembly *assembly, int body, const pm_field *field) {
    pm_placed_body *placed = &assembly->body[body];
    if (field->nelement == 0) {
        return pm_fail(PM_EDATA, "the field of %s has no mesh", placed->name);
    }
    assembly->solid[body].field = field;
    placed->nnode = field->nnode;
    placed->nelement = field->nelement;
    placed->position = field->position;
    placed->hexahedron = field->hexahedron;
    return PM_OK;
}
