// Saves the fields that the commands `correct` and `reconstruct` make.
#ifndef PM_TRAINER_COMMAND_SAVE_FIELDS_H
#define PM_TRAINER_COMMAND_SAVE_FIELDS_H

#include "store/field.h"

// Writes a field to the file `path`, with notes of its title, the subcommand that made it
// (`source`) and the command line (`command`). If the field has a mesh, writes an XDMF file
// (store/xdmf.h) beside it. Prints the names of the files. PM_EFILE, PM_ENOMEM.
pm_status pm_fields_save(const pm_field *field, const char *path, const char *title,
                         const char *source, const char *command);

#endif
