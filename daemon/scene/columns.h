// The map between a dataset's columns and a scene's states: which column is which component, and
// positions measured from a neighbour (relative_to).
#ifndef PM_SCENE_COLUMNS_H
#define PM_SCENE_COLUMNS_H

#include "scene/scene.h"
#include "store/dataset.h"

typedef struct pm_columns {
    int nz;      // components of the scene's concatenated state
    int *column; // [nz] position in the dataset's row
    int *base;   // [nz] component whose column value is added (relative_to), or -1
    int *group;  // [nz] index into group_name: groups of the same name are pooled for scores
    int ngroup;
    const char **group_name;
} pm_columns;

// Fails with PM_EDATA if a column the scene names is not in the dataset (the error lists what is),
// PM_ECONFIG if the scene maps no columns, one column twice, or measures a group from one of
// another size or, by whatever chain, from itself. The arrays live in the arena; names are the
// scene's.
pm_status pm_columns_bind(pm_columns *columns, const pm_scene *scene, const pm_dataset *dataset,
                          pm_arena *arena);

// Dataset row -> concatenated state z [nz], and back; _to_row writes only the mapped columns.
void pm_columns_to_state(const pm_columns *columns, const double *row, double *z);
void pm_columns_to_row(const pm_columns *columns, const double *z, double *row);

#endif
