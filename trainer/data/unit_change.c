// Converts units, and says so.
#include "data/unit_change.h"

#include <stdio.h>

pm_status pm_unit_change_apply(const pm_scene *scene, pm_dataset *dataset, bool say) {
    PM_TRY(pm_columns_convert(scene, dataset));
    const char **unit = NULL;
    PM_TRY(pm_dataset_units(dataset, &dataset->arena, &unit));
    const char *word = "converts";
    for (int k = 0; k < dataset->ncolumn && say && dataset->change != NULL; ++k) {
        const pm_unit_change *change = &dataset->change[k];
        if (change->from != NULL && (change->factor != 1 || change->offset != 0)) {
            printf("%s %s from %s to %s", word, dataset->column[k], change->from, unit[k]);
            word = ",";
        }
    }
    printf("%s", *word == ',' ? "\n" : "");
    return PM_OK;
}
