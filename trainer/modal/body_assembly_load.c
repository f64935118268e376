// Bodies placed in the world, from the configuration of a truth.
#include <string.h>

#include "modal/body_assembly.h"
#include "store/yaml.h"

static pm_status read_axes(pm_yaml list, double axis[3][3]) {
    static const char *const names[] = {"+x", "-x", "+y", "-y", "+z", "-z", NULL};
    if (pm_yaml_count(list) != 3) {
        return pm_yaml_fail(list, "expected [+x, +y, +z] or a rotation of it");
    }
    memset(axis, 0, 9 * sizeof **axis);
    for (int d = 0; d < 3; ++d) {
        int id = 0;
        PM_TRY(pm_yaml_choice(pm_yaml_item(list, d), names, &id));
        axis[d][id / 2] = id % 2 == 0 ? 1 : -1;
    }
    double volume = 0;
    for (int d = 0; d < 3; ++d) {
        const int e = (d + 1) % 3, f = (d + 2) % 3;
        volume += axis[0][d] * (axis[1][e] * axis[2][f] - axis[1][f] * axis[2][e]);
    }
    return volume > 0 ? PM_OK : pm_yaml_fail(list, "expected three different axes, right-handed");
}

static pm_status read_body(pm_yaml map, const pm_basis *basis, pm_arena *arena, pm_placed *body) {
    pm_yaml origin, axes;
    double *number = NULL;
    int count = 0;
    PM_TRY(pm_yaml_require(map, "origin", &origin));
    PM_TRY(pm_yaml_doubles(origin, arena, &count, &number));
    if (count != 3) {
        return pm_yaml_fail(origin, "expected three numbers");
    }
    memcpy(body->origin, number, sizeof body->origin);
    PM_TRY(pm_yaml_require(map, "axes", &axes));
    PM_TRY(read_axes(axes, body->axis));
    body->nnode = basis->nnode;
    body->nelement = basis->nelement;
    body->position = basis->position;
    body->hexahedron = basis->hexahedron;
    return PM_OK;
}

static pm_status read_bodies(pm_yaml root, pm_body_assembly *assembly) {
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
        pm_placed *body = &assembly->body[i];
        pm_yaml_entry(beams, i, &key, &value);
        PM_TRY(pm_yaml_text(key, &assembly->arena, &body->name));
        PM_TRY(read_body(value, assembly->basis, &assembly->arena, body));
    }
    return PM_OK;
}

pm_status pm_body_assembly_load(pm_body_assembly *assembly, const char *path) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status;
    PM_TRY_DONE(pm_yaml_open(&document, path, &root));
    PM_TRY_DONE(read_bodies(root, assembly));
    status = pm_body_assembly_meet(assembly);
done:
    pm_yaml_close(document);
    return status;
}
