// The stiffness of all bodies as a sparse matrix over the degrees of freedom that are not clamped,
// three for each node. Elements add to entries whose places are found once; contact couples
// arbitrary nodes. No other file uses CHOLMOD (Chen, Davis, Hager, Rajamanickam, ACM Trans. Math.
// Softw. 35, 2008).
#ifndef PM_TRAINER_TRUTH_BEAM_MATRIX_H
#define PM_TRAINER_TRUTH_BEAM_MATRIX_H

#include <stdbool.h>

#include "base/status.h"
#include "truth/beam_element.h"

typedef struct pm_beam_matrix pm_beam_matrix;

// Makes a zero matrix with room for the elements of this mesh. PM_ENOMEM. The caller frees it.
pm_status pm_beam_matrix_new(pm_beam_matrix **matrix, const pm_beam_mesh *mesh);
void pm_beam_matrix_free(pm_beam_matrix *matrix); // NULL is allowed

// Sets all entries to zero and removes all couplings.
void pm_beam_matrix_clear(pm_beam_matrix *matrix);
// Adds the stiffness of an element, [PM_BEAM_FREEDOMS][PM_BEAM_FREEDOMS] N/m, of which only the
// upper triangle is read.
void pm_beam_matrix_add(pm_beam_matrix *matrix, int element, const double *stiffness);
// Adds a symmetric stiffness [3 n][3 n], N/m, between n nodes. Returns false if memory is
// exhausted.
bool pm_beam_matrix_couple(pm_beam_matrix *matrix, int n, const int *node, const double *stiffness);
// Replaces b [nnode][3], N, by the solution x of K x = b, m, which is zero at clamped nodes.
// Returns false if K is not positive definite or memory is exhausted.
bool pm_beam_matrix_solve(pm_beam_matrix *matrix, double *b);

#endif
