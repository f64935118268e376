// Joins a solid (model/solid/solid.h) with its mesh. The groups of its state in a scene are
//   u      [nnode][3]  m        displacements
//   p      [nnode][3]  kg m/s   momenta, zero, since a solid has no inertia; ports act on them, and
//                               their co-energy is the velocity
//   inner  [nelement][8][nbranch][6]  inner variables of the branches, if there are any
//   sigma  [nnode][6]  Pa       Cauchy stresses, if the scene asks for them
//   s      J/K                  entropy
//   contact [ncontact][3] kg m/s  momenta of the nodes on which ports of the law `contact` act,
//   zero
//                               like p, if the mesh names such nodes
#include <string.h>

#include "model/solid/solid.h"
#include "scene/system.h"

// Checks that a group has the unit and the size that the mesh demands.
static pm_status check_group(const pm_scene_subsystem *subsystem, const char *name,
                             const char *unit, int size, bool needed) {
    const pm_group *group = pm_layout_find(&subsystem->layout, name);
    if (group == NULL) {
        return !needed
                   ? PM_OK
                   : pm_fail(PM_EWEIGHTS, "%s: the solid %s needs a group %s, in %s, of size %d",
                             subsystem->at, subsystem->name, name, unit, size);
    }
    if (group->size == size && strcmp(group->unit, unit) == 0) {
        return PM_OK;
    }
    return pm_fail(
        PM_EWEIGHTS,
        "%s: group %s of the solid %s has %d components in %s, and its mesh demands %d in %s",
        subsystem->group_at[group - subsystem->layout.group], name, subsystem->name, group->size,
        group->unit, size, unit);
}

static pm_status check_layout(const pm_scene_subsystem *subsystem, const pm_solid_mesh *mesh,
                              int nbranch) {
    const int inner = mesh->nelement * PM_BRICK_POINTS * PM_SYM * nbranch;
    PM_TRY(check_group(subsystem, "u", "m", 3 * mesh->nnode, true));
    PM_TRY(check_group(subsystem, "p", "kg m/s", 3 * mesh->nnode, true));
    PM_TRY(check_group(subsystem, "inner", "1", inner, nbranch > 0));
    PM_TRY(check_group(subsystem, "sigma", "Pa", PM_SYM * mesh->nnode, false));
    PM_TRY(check_group(subsystem, "s", "J/K", 1, true));
    PM_TRY(check_group(subsystem, "contact", "kg m/s", 3 * mesh->ncontact, false));
    for (int i = 0; i < subsystem->layout.ngroup; ++i) {
        const char *name = subsystem->layout.group[i].name;
        if (strcmp(name, "u") != 0 && strcmp(name, "p") != 0 && strcmp(name, "inner") != 0 &&
            strcmp(name, "sigma") != 0 && strcmp(name, "s") != 0 && strcmp(name, "contact") != 0) {
            return pm_fail(PM_EWEIGHTS,
                           "%s: a solid has no group %s: its groups are u, p, inner, sigma, s and "
                           "contact",
                           subsystem->group_at[i], name);
        }
    }
    return PM_OK;
}

pm_status pm_system_load_solid(pm_system *system, int id) {
    const pm_scene_subsystem *subsystem = &system->scene->subsystem[id];
    if (system->part[id]->spec.solid == NULL) {
        return pm_fail(PM_ECONFIG, "%s: subsystem %s has a mesh, but no weights of a solid",
                       subsystem->mesh_at, subsystem->name);
    }
    if (subsystem->mesh == NULL) {
        return pm_fail(PM_EWEIGHTS, "%s: the solid %s needs a mesh", subsystem->at,
                       subsystem->name);
    }
    pm_solid_mesh *mesh = pm_arena_array(&system->arena, 1, sizeof *mesh);
    if (mesh == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a mesh");
    }
    const pm_status status = pm_solid_mesh_load(mesh, subsystem->mesh, &system->arena);
    if (status != PM_OK) {
        return pm_fail(status, "%s: subsystem %s: %s", subsystem->mesh_at, subsystem->name,
                       pm_error());
    }
    PM_TRY(check_layout(subsystem, mesh, system->part[id]->spec.solid->nbranch));
    system->part[id]->layout = subsystem->layout;
    system->mesh[id] = mesh;
    return PM_OK;
}
