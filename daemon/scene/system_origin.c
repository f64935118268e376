// Checks that weights are used where they were trained. The weights of a subsystem record which
// columns of the data were its state, and which of its groups were measured from another subsystem.
#include <string.h>

#include "base/digest.h"
#include "scene/system.h"

uint64_t pm_system_columns_digest(const pm_scene_subsystem *subsystem) {
    if (subsystem->column == NULL) {
        return 0;
    }
    uint64_t digest = PM_DIGEST_INIT;
    for (int i = 0; i < subsystem->layout.nz; ++i) {
        digest = pm_digest_text(digest, subsystem->column[i]);
    }
    return digest == 0 ? 1 : digest;
}

const char *pm_system_relative_groups(const pm_scene_subsystem *subsystem, pm_arena *arena) {
    const char *text = "";
    for (int g = 0; g < subsystem->layout.ngroup && text != NULL; ++g) {
        if (subsystem->relative_subsystem[g] >= 0) {
            text = pm_arena_printf(arena, "%s%s%s", text, *text == '\0' ? "" : " ",
                                   subsystem->layout.group[g].name);
        }
    }
    return text;
}

// Checks that the same groups as in training are measured from another subsystem. The caller has
// checked that the columns have the same names as in training.
static pm_status check_relative(const pm_scene_subsystem *subsystem, const pm_provenance *own,
                                pm_arena *arena) {
    const char *text = pm_system_relative_groups(subsystem, arena);
    if (text == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while checking weights");
    }
    return strcmp(text, own->relative) == 0
               ? PM_OK
               : pm_fail(PM_EWEIGHTS,
                         "%s: subsystem %s: the weights %s were trained with relative_to for "
                         "\"%.200s\", the scene has relative_to for \"%.200s\"",
                         subsystem->group_at[0], subsystem->name, own->path, own->relative, text);
}

// Fails if two subsystems have exchanged their weights: the scene has the columns on which the
// weights of this subsystem were trained, in another subsystem, whose weights were trained on other
// columns. Otherwise weights may serve in many places.
static pm_status check_swapped(const pm_system *system, int id) {
    const pm_scene *scene = system->scene;
    const pm_provenance *own = system->part_provenance[id];
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_provenance *other = system->part_provenance[i];
        if (i != id && other->columns != 0 && other->columns != own->columns &&
            pm_system_columns_digest(&scene->subsystem[i]) == own->columns) {
            return pm_fail(PM_EWEIGHTS,
                           "%s: subsystem %s: the weights %s were trained on the columns of "
                           "subsystem %s, which has other weights: are the two exchanged?",
                           scene->subsystem[id].weights_at, scene->subsystem[id].name, own->path,
                           scene->subsystem[i].name);
        }
    }
    return PM_OK;
}

pm_status pm_system_check_origin(pm_system *system) {
    // One check for exchanged weights serves all subsystems that share them.
    bool *checked =
        pm_arena_array(&system->arena, (size_t)system->scene->nsubsystem, sizeof *checked);
    if (checked == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while checking weights");
    }
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        const pm_scene_subsystem *subsystem = &system->scene->subsystem[i];
        const pm_provenance *own = system->part_provenance[i];
        const uint64_t columns = pm_system_columns_digest(subsystem);
        if (own->columns == 0 || columns == 0) {
            continue; // not known
        }
        if (columns == own->columns) {
            PM_TRY(check_relative(subsystem, own, &system->arena));
        } else if (!checked[system->part_owner[i]]) {
            checked[system->part_owner[i]] = true;
            PM_TRY(check_swapped(system, i));
        }
    }
    return PM_OK;
}
