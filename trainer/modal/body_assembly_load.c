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
    if (assembly->body == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for bodies");
    }
    for (int i = 0; i < assembly->nbody; ++i) {
        pm_placed_body *body = &assembly->body[i];
        pm_yaml_entry(beams, i, &key, &value);
        PM_TRY(pm_yaml_text(key, &assembly->arena, &body->name));
        PM_TRY(pm_placement_read(value, &assembly->arena, &body->placement));
        body->nnode = basis->nnode;
        body->nelement = basis->nelement;
        body->position = basis->position;
        body->hexahedron = basis->hexahedron;
    }
    return PM_OK;
}

pm_status pm_body_assembly_load(pm_body_assembly *assembly, const char *path) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status;
    PM_TRY_DONE(pm_yaml_open(&document, path, &root));
    PM_TRY_DONE(read_bodies(root, assembly));
    status = pm_body_assembly_find_interfaces(assembly);
done:
    pm_yaml_close(document);
    return status;
}
