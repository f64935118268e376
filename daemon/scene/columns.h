// The map between the columns of a dataset and the states of a scene. It says which column holds
// which component, and which groups are measured from another group (relative_to in the scene).
#ifndef PM_SCENE_COLUMNS_H
#define PM_SCENE_COLUMNS_H

#include "scene/scene.h"
#include "store/dataset.h"

typedef struct pm_columns {
    int nz; // components of the scene's concatenated state
    // [nz] position in the dataset's row; -1: a hidden group of a solid, which the dataset has not
    // and which starts at zero
    int *column;
    int *base;  // [nz] component whose column value is added (relative_to); -1: none
    int *order; // [nz] the components, each after its base
    int *group; // [nz] index into group_name, shared by groups of the same name; -1: no column
    int ngroup;
    const char **group_name; // [ngroup]
} pm_columns;

// Converts the columns of a dataset to the units of the scene: those of groups to the unit of the
// group, those that boundary inputs follow to that of the value or co-energy. Columns of groups
// that are other quantities, or whose unit is not known, stay as they are; so do those of
// observations, whose formulas say what they show. The dataset notes what was converted. Call it
// after loading, before the dataset is used. PM_ECONFIG: a column has two uses in different units;
// PM_EDATA: a column that a boundary input follows is another quantity; PM_ENOMEM.
pm_status pm_columns_convert(const pm_scene *scene, pm_dataset *dataset);

// Finds the scene's columns in the dataset. The arrays lie in the arena; the names are borrowed
// from the scene. PM_EDATA: the dataset lacks a column, and the message lists those that it has; or
// the unit of a column in the dataset (dataset.h) differs from the unit in the scene. PM_ECONFIG:
// the scene maps no columns or maps one twice; a group is measured from a group of another size; or
// relative_to leads from a group back to itself. PM_ENOMEM.
pm_status pm_columns_bind(pm_columns *columns, const pm_scene *scene, const pm_dataset *dataset,
                          pm_arena *arena);

// Returns true if a name in group_name stands for groups of several subsystems.
bool pm_columns_combine(const pm_columns *columns, const pm_scene *scene);

// Compares the unit of a column in the dataset with that of the group that the scene maps it to,
// after pm_columns_convert; an empty unit is not known and equals any. PM_EDATA: they differ.
pm_status pm_columns_check_unit(const pm_scene_subsystem *subsystem, int group_id,
                                const char *column, const char *unit);

// Converts a row of the dataset to the concatenated state z [nz], and back. The latter writes only
// the mapped columns of the row.
void pm_columns_to_state(const pm_columns *columns, const double *row, double *z);
void pm_columns_to_row(const pm_columns *columns, const double *z, double *row);

#endif
