// Assembles the stiffness of all bodies as a sparse matrix over the degrees of freedom that are not
// clamped, three for each node, and solves linear systems with it by the Cholesky factorisation of
// CHOLMOD (Chen, Davis, Hager, Rajamanickam, ACM Trans. Math. Softw. 35, 2008). No other file uses
// CHOLMOD.
//
// The elements always fill the same entries, so that their places and the symbolic factorisation
// are computed once. Contact couples arbitrary nodes and changes the pattern: a solution with
// couplings computes a symbolic factorisation of its own.
#ifndef PM_TRAINER_TRUTH_BEAM_MATRIX_H
#define PM_TRAINER_TRUTH_BEAM_MATRIX_H

#include <stdbool.h>

#include "base/status.h"
#include "truth/beam_element.h"

typedef struct pm_beam_matrix pm_beam_matrix;

// Makes a zero matrix for the elements of `mesh`, which must outlive the matrix. The caller frees
// the matrix. PM_ENOMEM.
pm_status pm_beam_matrix_new(pm_beam_matrix **matrix, const pm_beam_mesh *mesh);
void pm_beam_matrix_free(pm_beam_matrix *matrix); // NULL is allowed

// Sets all entries to zero and removes all couplings.
void pm_beam_matrix_clear(pm_beam_matrix *matrix);
// Adds the stiffness of element number `element` of the mesh. `stiffness`
// [PM_BEAM_FREEDOMS][PM_BEAM_FREEDOMS], N/m, is symmetric; only its upper triangle is read.
void pm_beam_matrix_add(pm_beam_matrix *matrix, int element, const double *stiffness);
// Adds a coupling between the nodes node [n] of the mesh. `stiffness` [3 n][3 n], N/m, is
// symmetric; only its upper triangle is read. Returns false if memory is exhausted.
bool pm_beam_matrix_couple(pm_beam_matrix *matrix, int n, const int *node, const double *stiffness);
// Replaces b [nnode][3], N, by the solution x [nnode][3], m, of K x = b, where K is the sum of all
// elements and couplings added since the last pm_beam_matrix_clear. x is zero at clamped nodes.
// Returns false, and leaves b as it was, if K is not positive definite or memory is exhausted.
bool pm_beam_matrix_solve(pm_beam_matrix *matrix, double *b);

#endif
