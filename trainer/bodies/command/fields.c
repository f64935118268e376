// Writes notes, fields, their XDMF files, and datasets.
#include "bodies/command/fields.h"

#include <limits.h>
#include <stdio.h>

#include "base/files.h"
#include "base/options.h"
#include "base/path.h"
#include "base/python.h"

pm_status pm_trajectories_list(const char *text, int most, pm_arena *arena, int **which,
                               int *count) {
    *which = pm_arena_array(arena, (size_t)most, sizeof **which);
    PM_TRY(pm_arena_status(arena, "a list of trajectories"));
    return pm_options_list(text, most, *which, count);
}

pm_status pm_fields_check(const char *path) {
    if (path == NULL) {
        return PM_OK;
    }
    char stem[PATH_MAX];
    snprintf(stem, sizeof stem, "%.*s", (int)pm_path_stem(path), path);
    PM_TRY(pm_files_check_output(path, PM_FILES_HDF5));
    return pm_python_check_pictures("xdmf", stem);
}

pm_status pm_xdmf_save(const pm_field *field, const char *path) {
    const char *const argument[] = {"xdmf", path, NULL};
    return field->nelement == 0 ? pm_fail(PM_EDATA, "%s: the field has no hexahedra to draw", path)
                                : pm_python_run(&pm_python_pictures, argument, true);
}

pm_status pm_fields_save(const pm_field *field, const char *path, const char *title,
                         const char *source, const char *command) {
    const char *const notes[][2] = {{"title", title}, {"source", source}, {"command", command}};
    PM_TRY(pm_field_save(field, path, (int)(sizeof notes / sizeof *notes), notes));
    PM_TRY(field->nelement == 0 ? PM_OK : pm_xdmf_save(field, path));
    printf("wrote %s: %d trajector%s of %d states, %d nodes\n", path, field->ntrajectory,
           field->ntrajectory == 1 ? "y" : "ies", field->ntime, field->nnode);
    return PM_OK;
}

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
    PM_TRY(pm_arena_status(&modes->arena, "a path"));
    PM_TRY(pm_dataset_save(modes, path));
    printf("wrote %s: %d trajector%s of %d states, %d columns\n", path, modes->ntrajectory,
           modes->ntrajectory == 1 ? "y" : "ies", modes->ntime, modes->ncolumn);
    return PM_OK;
}
