// An observation gives, for each measured column, a function of the state. A column that the scene
// maps to a component is this component plus, where the scene says `relative_to`, the component
// that it is relative to. Other columns are formulas (`observations` in the scene) of states and
// co-energies, of constants of the models, learned ones too, and of boundary inputs, which have the
// values of the sample: V = U - R I.
#ifndef PM_TRAINER_DATA_OBSERVATION_H
#define PM_TRAINER_DATA_OBSERVATION_H

#include "graph/graph.h"
#include "scene/system.h"

typedef struct pm_observation {
    int count;                   // measured columns
    int *column;                 // [count] positions in a row of the dataset
    int *component;              // [count] component of the scene's state; -1: a formula
    const char **name;           // [count] names of the columns
    const char **unit;           // [count] units of the components; NULL: a formula
    const pm_formula **rule;     // [count] the formula; NULL: a component
    int *base;                   // [nz] component that is added to this one (relative_to); -1: none
    bool *hidden;                // [nz] true for components that no column holds
    double *guess;               // [nz] prior mean of the start of a hidden component
    double *deviation;           // [nz] prior deviation from the guess; 0: not hidden
    const char **component_name; // [nz] "subsystem.group" or "subsystem.group[1]"
} pm_observation;

// Finds the columns of a measured dataset; hidden groups need no columns. The arrays lie in the
// arena. PM_EDATA: the dataset lacks a column of a group that is not hidden, or the column of a
// formula, or a column has another unit than its group; PM_ECONFIG: a formula is wrong, or nothing
// is measured; PM_ENOMEM.
pm_status pm_observation_bind(pm_observation *o, const pm_system *system, const pm_dataset *dataset,
                              pm_arena *arena);

// Returns the values [1][count] of all measured columns in the state z [1][nz] of the scene, where
// its boundary inputs have the values `input` [1][nprescribed], or PM_NO_NODE if there are none.
pm_node pm_observation_build(pm_graph *g, const pm_observation *o, const pm_system *system,
                             pm_node z, pm_node input);

#endif
