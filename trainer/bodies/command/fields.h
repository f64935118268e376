// What several commands of bodies share: lists of trajectories, and files of results.
#ifndef PM_BODIES_COMMAND_FIELDS_H
#define PM_BODIES_COMMAND_FIELDS_H

#include "bodies/field/field.h"
#include "bodies/modal/basis.h"
#include "store/dataset.h"

// Makes a list, in the arena, of those of `most` trajectories that `text` names as pm_options_list
// reads it. PM_EUSAGE, PM_ENOMEM.
pm_status pm_trajectories_list(const char *text, int most, pm_arena *arena, int **which,
                               int *count);

// Writes a field to the file `path`, with notes of its title, the subcommand that made it
// (`source`) and the command line (`command`). If the field has a mesh, writes an XDMF file
// (bodies/field/xdmf.h) beside it. Prints the names of the files. PM_EFILE, PM_ENOMEM.
pm_status pm_fields_save(const pm_field *field, const char *path, const char *title,
                         const char *source, const char *command);

// Saves the dataset of modal trajectories that `reduce` or `contact` (`source`) has made with the
// command line `command`: adds notes about the fields that were projected (`data`) and the basis,
// unless it is NULL, writes folder/modes.h5, and says so. PM_EFILE, PM_EDATA, PM_ENOMEM.
pm_status pm_modes_save(pm_dataset *modes, const pm_basis *basis, const char *data,
                        const char *source, const char *command, const char *folder);

#endif
