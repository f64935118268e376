// Symmetric copies of a body's fields: a beam of square section, clamped at one end, may be
// mirrored and turned about its axis by quarters, and every solution with it. Learning from all
// eight copies makes the learned beam as symmetric as the true one.
#ifndef PM_TRAINER_BODY_SYMMETRY_COPIES_H
#define PM_TRAINER_BODY_SYMMETRY_COPIES_H

#include "store/field.h"

#define PM_SYMMETRY_COPIES_OF_SQUARE 8

// One copy: node i takes the values of node[i], whose components y and z are exchanged if `swap`,
// and then change sign as `sign` says.
typedef struct pm_copy {
    int *node; // [nnode]
    bool swap;
    double sign[3];
} pm_copy;

// The copies of a body whose section is symmetric about its centre, the first as it is; memory from
// the arena. PM_EDATA: its nodes are not symmetric. PM_ENOMEM.
pm_status pm_symmetry_copies_make(pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE], const pm_field *field,
                                  pm_arena *arena);

// The body as it is.
pm_status pm_symmetry_copies_none(pm_copy *copy, const pm_field *field, pm_arena *arena);

// to [nnode][3]: the vectors of a copy, from those of the original, `stride` numbers apart.
void pm_copy_vectors(const pm_copy *copy, int nnode, const double *from, int stride, double *to);
// The same for symmetric tensors xx yy zz xy xz yz: to [nnode][6].
void pm_copy_tensors(const pm_copy *copy, int nnode, const double *from, int stride, double *to);

#endif
