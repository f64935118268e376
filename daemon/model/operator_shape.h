// The shape of the learned matrix of an operator, for the two files that implement operator.h and
// for the trainer, which rotates factors.
//
// The matrix is C [rows][columns] of a reversible operator or the factor G [rows][columns] of an
// irreversible one. Its rows are those of the frame (spec.h).
#ifndef PM_MODEL_OPERATOR_SHAPE_H
#define PM_MODEL_OPERATOR_SHAPE_H

#include "model/operator.h"

typedef struct pm_operator_shape {
    int rows;
    // A reversible operator has as many columns as rows or, with `against`, as the other end has
    // rows. An irreversible operator has as many columns as its rank.
    int columns;
} pm_operator_shape;

// Returns the shape of the learned matrix of an operator on its support.
pm_operator_shape pm_operator_shape_of(const pm_operator *op, const pm_support *support);

// Returns the number of rows that a group of this size has in the frame: one for each vector of
// `along` if the group is a vector, else one for each component.
int pm_operator_frame_rows(const pm_operator_spec *spec, int group_size);

// Writes "<prefix>.<name>", the name of a parameter, to the buffer and returns it.
typedef char pm_operator_name[96];
const char *pm_operator_join(pm_operator_name buffer, const char *prefix, const char *name);

#endif
