// The stiffness of bodies as a sparse matrix over the freedoms that are not clamped, node by node,
// three each: elements, whose places are known, and couplings of any nodes (contact). The only door
// to CHOLMOD (Chen, Davis, Hager, Rajamanickam, ACM Trans. Math. Softw. 35, 2008).
#ifndef PM_TRAINER_TRUTH_BEAM_MATRIX_H
#define PM_TRAINER_TRUTH_BEAM_MATRIX_H

#include <stdbool.h>

#include "base/status.h"
#include "truth/beam_element.h"

typedef struct pm_beam_matrix pm_beam_matrix;

// Zero, with room for the elements of this mesh. PM_ENOMEM. The caller frees.
pm_status pm_beam_matrix_new(pm_beam_matrix **matrix, const pm_beam_mesh *mesh);
void pm_beam_matrix_free(pm_beam_matrix *matrix); // NULL is allowed

void pm_beam_matrix_clear(pm_beam_matrix *matrix);
// Adds an element's stiffness [PM_BEAM_FREEDOMS][PM_BEAM_FREEDOMS], given by its upper triangle.
void pm_beam_matrix_add(pm_beam_matrix *matrix, int element, const double *stiffness);
// Adds a symmetric stiffness [3 n][3 n] between n nodes. False: out of memory.
bool pm_beam_matrix_couple(pm_beam_matrix *matrix, int n, const int *node, const double *stiffness);
// b [nnode][3] becomes the solution x of K x = b, zero at clamped nodes. False if K is not positive
// definite or memory is exhausted.
bool pm_beam_matrix_solve(pm_beam_matrix *matrix, double *b);

#endif
