// Writes the notes, the field and its XDMF file.
#include "command/save_fields.h"

#include <stdio.h>

#include "store/xdmf.h"

pm_status pm_fields_save(const pm_field *field, const char *path, const char *title,
                         const char *source, const char *command) {
    const char *const notes[][2] = {{"title", title}, {"source", source}, {"command", command}};
    PM_TRY(pm_field_save(field, path, (int)(sizeof notes / sizeof *notes), notes));
    PM_TRY(field->nelement == 0 ? PM_OK : pm_xdmf_save(field, path));
    printf("wrote %s: %d trajectories of %d states, %d nodes\n", path, field->ntrajectory,
           field->ntime, field->nnode);
    return PM_OK;
}
