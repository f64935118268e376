// Saves the fields that the commands `correct` and `reconstruct` make.
#ifndef PM_TRAINER_COMMAND_SAVE_FIELDS_H
#define PM_TRAINER_COMMAND_SAVE_FIELDS_H

#include "store/field.h"

// Writes a field to `path`, with notes of its title, the subcommand that made it (`source`) and the
// command line (`command`), and an XDMF file (store/xdmf.h) beside it if the field has a mesh. Says
// so on standard output. PM_EFILE, PM_ENOMEM.
pm_status pm_fields_save(const pm_field *field, const char *path, const char *title,
                         const char *source, const char *command);

#endif
