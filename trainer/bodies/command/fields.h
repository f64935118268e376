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

// Checks, before the fields are made, that they and their XDMF file may be written to `path`, which
// may be NULL: nothing will be. Fails as pm_files_check_output does.
pm_status pm_fields_check(const char *path);

// Describes the file that pm_field_save wrote from this field to `path` in XDMF, version 2
// (https://www.xdmf.org), so that ParaView's "XDMF Reader" and similar tools can open it. The
// description holds, for each trajectory, the deformed hexahedra over time with displacement u,
// velocity v, the symmetric stress tensor, the von Mises stress and the forces, as far as the field
// has them. Positions are in the body's own frame. The numbers stay in the field file. The
// description has the same name with the ending .xdmf and refers to the file by name alone, so that
// both can be moved together. PM_EDATA: the field has no hexahedra. Fails otherwise as
// pm_python_run does.
pm_status pm_xdmf_save(const pm_field *field, const char *path);

// Writes a field to the file `path`, with notes of its title, the subcommand that made it
// (`source`) and the command line (`command`). If the field has a mesh, writes its XDMF
// file beside it. Prints the names of the files. PM_EFILE, PM_ENOMEM.
pm_status pm_fields_save(const pm_field *field, const char *path, const char *title,
                         const char *source, const char *command);

// Saves the dataset of modal trajectories that `reduce` or `contact` (`source`) has made with the
// command line `command`: adds notes about the fields that were projected (`data`) and the basis,
// unless it is NULL, writes folder/modes.h5, and says so. PM_EFILE, PM_EDATA, PM_ENOMEM.
pm_status pm_modes_save(pm_dataset *modes, const pm_basis *basis, const char *data,
                        const char *source, const char *command, const char *folder);

#endif
