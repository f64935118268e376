// Assembles compressed columns. The place of each entry of each element is found once.
#include "truth/beam_matrix.h"

#include <stdlib.h>
#include <string.h>
#include <suitesparse/cholmod.h>

// Declared here because not every compiler provides the header of OpenMP.
void omp_set_max_active_levels(int levels);

#define ENTRIES (PM_BEAM_FREEDOMS * (PM_BEAM_FREEDOMS + 1) / 2)

struct pm_beam_matrix {
    const pm_beam_mesh *mesh;
    cholmod_common common;
    cholmod_sparse *K;         // upper triangle
    cholmod_factor *factor;    // whose symbolic part belongs to K
    cholmod_triplet *coupling; // added to K when solving; NULL until there is one
    cholmod_dense *b;
    int *freedom;          // [nnode] first of three degrees of freedom; -1: clamped
    int (*place)[ENTRIES]; // [nelement] places among the values of K; -1: clamped
};

// Numbers the degrees of freedom and returns how many there are.
static int number_freedoms(pm_beam_matrix *matrix) {
    int count = 0;
    for (int i = 0; i < matrix->mesh->nnode; ++i) {
        const bool clamped = matrix->mesh->clamped[i];
        matrix->freedom[i] = clamped ? -1 : count;
        count += clamped ? 0 : 3;
    }
    return count;
}

// Finds row and column in K of entry i, j of a matrix over these nodes. Returns false if one of the
// nodes is clamped.
static bool locate(const pm_beam_matrix *matrix, const int *node, int i, int j, int *row,
                   int *column) {
    const int a = matrix->freedom[node[i / 3]], b = matrix->freedom[node[j / 3]];
    const int k = a + i % 3, l = b + j % 3;
    *row = k < l ? k : l;
    *column = k < l ? l : k;
    return a >= 0 && b >= 0;
}

// Makes K with all entries that elements need. Returns false if memory is exhausted.
static bool make_pattern(pm_beam_matrix *matrix, int nfreedom) {
    const size_t n = (size_t)nfreedom, capacity = (size_t)matrix->mesh->nelement * ENTRIES;
    cholmod_triplet *triplet =
        cholmod_allocate_triplet(n, n, capacity, 1, CHOLMOD_REAL, &matrix->common);
    if (triplet == NULL) {
        return false;
    }
    int *rows = triplet->i, *columns = triplet->j;
    memset(triplet->x, 0, capacity * sizeof(double));
    for (int e = 0; e < matrix->mesh->nelement; ++e) {
        for (int i = 0; i < PM_BEAM_FREEDOMS; ++i) {
            for (int j = i; j < PM_BEAM_FREEDOMS; ++j) {
                triplet->nnz += locate(matrix, matrix->mesh->hexahedron[e], i, j,
                                       rows + triplet->nnz, columns + triplet->nnz);
            }
        }
    }
    matrix->K = cholmod_triplet_to_sparse(triplet, 0, &matrix->common);
    cholmod_free_triplet(&triplet, &matrix->common);
    return matrix->K != NULL;
}

// Returns the place of an entry among the values of K, whose rows are sorted within a column.
static int find(const cholmod_sparse *K, int row, int column) {
    const int *start = K->p, *rows = K->i;
    int low = start[column], high = start[column + 1] - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (rows[middle] < row) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

static void find_places(pm_beam_matrix *matrix) {
    for (int e = 0; e < matrix->mesh->nelement; ++e) {
        int *place = matrix->place[e], row, column;
        for (int i = 0; i < PM_BEAM_FREEDOMS; ++i) {
            for (int j = i; j < PM_BEAM_FREEDOMS; ++j) {
                *place++ = locate(matrix, matrix->mesh->hexahedron[e], i, j, &row, &column)
                               ? find(matrix->K, row, column)
                               : -1;
            }
        }
    }
}

pm_status pm_beam_matrix_new(pm_beam_matrix **result, const pm_beam_mesh *mesh) {
    pm_beam_matrix *matrix = calloc(1, sizeof *matrix);
    if (matrix == NULL) {
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    matrix->mesh = mesh;
    // CHOLMOD would start four threads for every block of the factor, at more cost than gain.
    omp_set_max_active_levels(0);
    cholmod_start(&matrix->common);
    matrix->common.print = 0;
    matrix->freedom = calloc((size_t)mesh->nnode, sizeof *matrix->freedom);
    matrix->place = calloc((size_t)mesh->nelement, sizeof *matrix->place);
    bool good = matrix->freedom != NULL && matrix->place != NULL;
    if (good) {
        const int nfreedom = number_freedoms(matrix);
        good = make_pattern(matrix, nfreedom);
        matrix->b = cholmod_zeros((size_t)nfreedom, 1, CHOLMOD_REAL, &matrix->common);
        matrix->factor = good ? cholmod_analyze(matrix->K, &matrix->common) : NULL;
    }
    if (!good || matrix->b == NULL || matrix->factor == NULL) {
        pm_beam_matrix_free(matrix);
        return pm_fail(PM_ENOMEM, "beam: out of memory");
    }
    find_places(matrix);
    *result = matrix;
    return PM_OK;
}

void pm_beam_matrix_free(pm_beam_matrix *matrix) {
    if (matrix != NULL) {
        cholmod_free_factor(&matrix->factor, &matrix->common);
        cholmod_free_dense(&matrix->b, &matrix->common);
        cholmod_free_sparse(&matrix->K, &matrix->common);
        cholmod_free_triplet(&matrix->coupling, &matrix->common);
        cholmod_finish(&matrix->common);
        free(matrix->place);
        free(matrix->freedom);
        free(matrix);
    }
}

void pm_beam_matrix_clear(pm_beam_matrix *matrix) {
    memset(matrix->K->x, 0, matrix->K->nzmax * sizeof(double));
    if (matrix->coupling != NULL) {
        matrix->coupling->nnz = 0;
    }
}

void pm_beam_matrix_add(pm_beam_matrix *matrix, int element, const double *stiffness) {
    const int *place = matrix->place[element];
    double *value = matrix->K->x;
    for (int i = 0; i < PM_BEAM_FREEDOMS; ++i) {
        for (int j = i; j < PM_BEAM_FREEDOMS; ++j, ++place) {
            if (*place >= 0) {
                value[*place] += stiffness[PM_BEAM_FREEDOMS * i + j];
            }
        }
    }
}

// Makes room for `count` more entries of the coupling.
static bool reserve(pm_beam_matrix *matrix, size_t count) {
    cholmod_triplet *t = matrix->coupling;
    if (t == NULL) {
        const size_t n = matrix->K->nrow;
        matrix->coupling = cholmod_allocate_triplet(n, n, count, 1, CHOLMOD_REAL, &matrix->common);
        return matrix->coupling != NULL;
    }
    return t->nnz + count <= t->nzmax ||
           cholmod_reallocate_triplet(2 * (t->nnz + count), t, &matrix->common);
}

bool pm_beam_matrix_couple(pm_beam_matrix *matrix, int n, const int *node,
                           const double *stiffness) {
    if (!reserve(matrix, (size_t)(3 * n * (3 * n + 1) / 2))) {
        return false;
    }
    cholmod_triplet *t = matrix->coupling;
    int *rows = t->i, *columns = t->j;
    double *value = t->x;
    for (int i = 0; i < 3 * n; ++i) {
        for (int j = i; j < 3 * n; ++j) {
            if (locate(matrix, node, i, j, rows + t->nnz, columns + t->nnz)) {
                value[t->nnz++] = stiffness[3 * n * i + j];
            }
        }
    }
    return true;
}

// Factorizes the sum of K and the coupling, with a symbolic factor of its own.
static bool factorize_coupled(pm_beam_matrix *matrix, cholmod_factor **factor) {
    double one[2] = {1, 0};
    cholmod_common *common = &matrix->common;
    cholmod_sparse *coupling = cholmod_triplet_to_sparse(matrix->coupling, 0, common);
    cholmod_sparse *sum =
        coupling == NULL ? NULL : cholmod_add(matrix->K, coupling, one, one, 1, 1, common);
    *factor = sum == NULL ? NULL : cholmod_analyze(sum, common);
    const bool good =
        *factor != NULL && cholmod_factorize(sum, *factor, common) && common->status == CHOLMOD_OK;
    cholmod_free_sparse(&sum, common);
    cholmod_free_sparse(&coupling, common);
    return good;
}

// Solves K x = b, with the couplings added to K if there are any. NULL: the matrix is not positive
// definite, or memory is exhausted.
static cholmod_dense *solve(pm_beam_matrix *matrix) {
    cholmod_common *common = &matrix->common;
    if (matrix->coupling == NULL || matrix->coupling->nnz == 0) {
        return cholmod_factorize(matrix->K, matrix->factor, common) && common->status == CHOLMOD_OK
                   ? cholmod_solve(CHOLMOD_A, matrix->factor, matrix->b, common)
                   : NULL;
    }
    cholmod_factor *factor;
    cholmod_dense *x = factorize_coupled(matrix, &factor)
                           ? cholmod_solve(CHOLMOD_A, factor, matrix->b, common)
                           : NULL;
    cholmod_free_factor(&factor, common);
    return x;
}

bool pm_beam_matrix_solve(pm_beam_matrix *matrix, double *b) {
    double *right = matrix->b->x;
    for (int i = 0; i < matrix->mesh->nnode; ++i) {
        if (matrix->freedom[i] >= 0) {
            memcpy(right + matrix->freedom[i], b + 3 * i, 3 * sizeof *b);
        }
    }
    cholmod_dense *x = solve(matrix);
    if (x == NULL) {
        return false;
    }
    const double *solution = x->x;
    for (int i = 0; i < matrix->mesh->nnode; ++i) {
        for (int d = 0; d < 3; ++d) {
            b[3 * i + d] = matrix->freedom[i] >= 0 ? solution[matrix->freedom[i] + d] : 0;
        }
    }
    cholmod_free_dense(&x, &matrix->common);
    return true;
}
