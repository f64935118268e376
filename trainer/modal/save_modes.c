// Writes the notes and the file, and reports it.
#include "modal/save_modes.h"

#include <stdio.h>

pm_status pm_modes_save(pm_dataset *modes, const pm_basis *basis, const char *data,
                        const char *source, const char *command, const char *folder) {
    if (basis != NULL) {
        char coordinates[PM_BASIS_COORDINATES];
        pm_basis_coordinates(basis, coordinates);
        PM_TRY(pm_dataset_note(modes, "coordinates", "%s", coordinates));
    }
    PM_TRY(pm_dataset_note(modes, "title", "Amplitudes of modes of %s", data));
    PM_TRY(pm_dataset_note(modes, "source", "portmet-train %s", source));
    PM_TRY(pm_dataset_note(modes, "command", "%s", command));
    const char *path = pm_arena_printf(&modes->arena, "%s/modes.h5", folder);
    PM_TRY(path == NULL ? pm_fail(PM_ENOMEM, "out of memory for a path")
                        : pm_dataset_save(modes, path));
    printf("wrote %s: %d trajectories of %d states, %d columns\n", path, modes->ntrajectory,
           modes->ntime, modes->ncolumn);
    return PM_OK;
}
