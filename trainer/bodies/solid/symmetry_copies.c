// Finds for every node its partner in each mirrored or turned copy, and copies vectors and tensors.
#include "bodies/solid/symmetry_copies.h"

#include <math.h>
#include <stddef.h>

// Two places count as the same if they are this close, relative to the size of the body.
#define SAME_PLACE 1e-6

pm_status pm_symmetry_copies_make(pm_copy copy[PM_SYMMETRY_COPIES_OF_SQUARE], const pm_field *field,
                                  pm_arena *arena) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int i = 0; i < field->nnode; ++i) {
        for (int d = 0; d < 3; ++d) {
            low[d] = fmin(low[d], field->position[3 * i + d]);
            high[d] = fmax(high[d], field->position[3 * i + d]);
        }
    }
    double size = 0, centre[2]; // of the section
    for (int d = 0; d < 3; ++d) {
        size = fmax(size, high[d] - low[d]);
    }
    for (int d = 0; d < 2; ++d) {
        centre[d] = 0.5 * (low[d + 1] + high[d + 1]);
    }
    for (int c = 0; c < PM_SYMMETRY_COPIES_OF_SQUARE; ++c) {
        pm_copy *k = &copy[c];
        *k = (pm_copy){.swap = (c & 4) != 0, .sign = {1, (c & 1) ? -1 : 1, (c & 2) ? -1 : 1}};
        k->node = pm_arena_array(arena, (size_t)field->nnode, sizeof *k->node);
        PM_TRY(pm_arena_status(arena, "symmetric copies"));
        for (int i = 0; i < field->nnode; ++i) {
            // The place in the original that this copy carries to node i.
            const double *at = field->position + 3 * (ptrdiff_t)i;
            const double y = k->sign[1] * (at[1] - centre[0]), z = k->sign[2] * (at[2] - centre[1]);
            const double place[3] = {at[0], centre[0] + (k->swap ? z : y),
                                     centre[1] + (k->swap ? y : z)};
            int *n = &k->node[i];
            for (const double *x = field->position;
                 *n < field->nnode && (fabs(x[0] - place[0]) > SAME_PLACE * size ||
                                       fabs(x[1] - place[1]) > SAME_PLACE * size ||
                                       fabs(x[2] - place[2]) > SAME_PLACE * size);
                 x += 3) {
                ++*n;
            }
            if (*n == field->nnode) {
                return pm_fail(
                    PM_EDATA,
                    "the body is not symmetric like a square: node %d at (%g, %g, %g) has "
                    "no partner",
                    i, at[0], at[1], at[2]);
            }
        }
    }
    return PM_OK;
}

pm_status pm_symmetry_copies_none(pm_copy *copy, const pm_field *field, pm_arena *arena) {
    *copy = (pm_copy){.sign = {1, 1, 1}};
    copy->node = pm_arena_array(arena, (size_t)field->nnode, sizeof *copy->node);
    PM_TRY(pm_arena_status(arena, "a copy"));
    for (int i = 0; i < field->nnode; ++i) {
        copy->node[i] = i;
    }
    return PM_OK;
}

void pm_copy_vectors(const pm_copy *copy, int nnode, const double *from, int stride, double *to) {
    const int y = copy->swap ? 2 : 1, z = copy->swap ? 1 : 2;
    for (int i = 0; i < nnode; ++i, to += 3) {
        const double *v = from + (ptrdiff_t)copy->node[i] * stride;
        to[0] = v[0];
        to[1] = copy->sign[1] * v[y];
        to[2] = copy->sign[2] * v[z];
    }
}

void pm_copy_tensors(const pm_copy *copy, int nnode, const double *from, int stride, double *to) {
    const bool swap = copy->swap;
    const double sy = copy->sign[1], sz = copy->sign[2];
    for (int i = 0; i < nnode; ++i, to += 6) {
        const double *v = from + (ptrdiff_t)copy->node[i] * stride;
        to[0] = v[0];
        to[1] = v[swap ? 2 : 1];
        to[2] = v[swap ? 1 : 2];
        to[3] = sy * v[swap ? 4 : 3];
        to[4] = sz * v[swap ? 3 : 4];
        to[5] = sy * sz * v[5];
    }
}
