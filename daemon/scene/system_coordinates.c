// Checks that weights and data that are used together were made in the same coordinates.
#include <string.h>

#include "scene/system.h"

// Returns true if both texts are known and differ.
static bool differ(const char *a, const char *b) {
    return a != NULL && b != NULL && *a != '\0' && *b != '\0' && strcmp(a, b) != 0;
}

static pm_status check_port(const pm_system *system, int port_id) {
    const pm_scene_port *port = &system->scene->port[port_id];
    const pm_provenance *own = system->port_provenance[port_id];
    for (int end = 0; end < 2; ++end) {
        const int id = port->subsystem[end];
        const pm_provenance *other = id < 0 ? NULL : system->part_provenance[id];
        if (other != NULL && differ(own->coordinates, other->coordinates)) {
            return pm_fail(PM_EWEIGHTS,
                           "%s: port %s: the weights %s are made for %.64s, those of %s, %s, for "
                           "%.64s",
                           port->weights_at, port->name, own->path, own->coordinates,
                           pm_scene_end_name(system->scene, port, end), other->path,
                           other->coordinates);
        }
    }
    return PM_OK;
}

pm_status pm_system_check_coordinates(const pm_system *system) {
    for (int i = 0; i < system->scene->nport; ++i) {
        PM_TRY(check_port(system, i));
    }
    return PM_OK;
}

pm_status pm_system_check_dataset(const pm_system *system, const pm_dataset *dataset,
                                  const char *path) {
    const char *own = pm_dataset_find_note(dataset, "coordinates");
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        const pm_provenance *other = system->part_provenance[i];
        if (differ(own, other->coordinates)) {
            return pm_fail(
                PM_EDATA, "%s: made with %.64s; the weights %s of subsystem %s are for %.64s", path,
                own, other->path, system->scene->subsystem[i].name, other->coordinates);
        }
    }
    return PM_OK;
}
