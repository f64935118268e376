// The units of a dataset, as a command uses them.
#ifndef PM_TRAINER_DATA_UNIT_CHANGE_H
#define PM_TRAINER_DATA_UNIT_CHANGE_H

#include "scene/columns.h"

// Converts the columns of a dataset that was just loaded to the units of the scene
// (pm_columns_convert). With `say`, prints which columns are converted. Fails as
// pm_columns_convert does.
pm_status pm_unit_change_apply(const pm_scene *scene, pm_dataset *dataset, bool say);

#endif
