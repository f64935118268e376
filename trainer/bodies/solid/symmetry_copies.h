// Symmetric copies of the fields of a body. A beam of square section that is clamped at one end can
// be mirrored in y and in z and turned about its axis by quarters, and every solution with it.
// Training on all eight copies makes the learned beam as symmetric as the true one.
#ifndef PM_BODIES_SOLID_SYMMETRY_COPIES_H
#define PM_BODIES_SOLID_SYMMETRY_COPIES_H

#include "bodies/field/field.h"

#define PM_SYMMETRY_COPIES_OF_SQUARE 8

// A copy takes the value at node i from node[i] of the original, exchanges the components y and z
// if `swap` is set, and then multiplies the components by `sign`.
typedef struct pm_copy {
    int *node; // [nnode]
    bool swap;
    double sign[3]; // 1 or -1
} pm_copy;

// Makes the eight copies of a body whose section is symmetric about its centre; the first is the
// original. Memory from the arena. PM_EDATA (the nodes are not symmetric), PM_ENOMEM.
pm_status pm_symmetry_copies_make(pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE], const pm_field *field,
                                  pm_arena *arena);

// Makes the copy that is the original itself. Memory from the arena. PM_ENOMEM.
pm_status pm_symmetry_copies_none(pm_copy *copy, const pm_field *field, pm_arena *arena);

// Writes the copy of a vector field into the array `to` [nnode][3]. The vectors of the original
// begin at `from` and are `stride` numbers apart.
void pm_copy_vectors(const pm_copy *copy, int nnode, const double *from, int stride, double *to);
// Writes the copy of a field of symmetric tensors (xx yy zz xy xz yz) into the array `to`
// [nnode][6] in the same way.
void pm_copy_tensors(const pm_copy *copy, int nnode, const double *from, int stride, double *to);

#endif
