// Saves the datasets of modal trajectories that the commands `reduce` and `contact` write.
#ifndef PM_TRAINER_MODAL_SAVE_MODES_H
#define PM_TRAINER_MODAL_SAVE_MODES_H

#include "modal/basis.h"
#include "store/dataset.h"

// Adds notes about the fields that were projected (`data`), the basis, the subcommand (`source`)
// and the command line (`command`), writes folder/modes.h5, and says so on standard output.
// PM_EFILE, PM_EDATA, PM_ENOMEM.
pm_status pm_modes_save(pm_dataset *modes, const pm_basis *basis, const char *data,
                        const char *source, const char *command, const char *folder);

#endif
