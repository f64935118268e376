// Tensors in three dimensions: 3x3 matrices [9] by rows, and symmetric ones [6] as xx yy zz xy xz
// yz. Functions write results to arrays that must not overlap their arguments.
#ifndef PM_MODEL_SOLID_TENSOR_H
#define PM_MODEL_SOLID_TENSOR_H

#define PM_SYM 6 // components of a symmetric tensor

// The row and the column of each component, and the component at each row and column.
static const int pm_sym_row[PM_SYM] = {0, 1, 2, 0, 0, 1};
static const int pm_sym_column[PM_SYM] = {0, 1, 2, 1, 2, 2};
static const int pm_sym_at[3][3] = {{0, 3, 4}, {3, 1, 5}, {4, 5, 2}};

// Returns the trace of a.
static inline double pm_sym_trace(const double *a) {
    return a[0] + a[1] + a[2];
}

// Returns the trace of the product of two symmetric tensors.
static inline double pm_sym_dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5]);
}

// Computes the inverse of a and returns its determinant.
static inline double pm_sym_inverse(const double *a, double *inverse) {
    const double xx = a[1] * a[2] - a[5] * a[5], xy = a[4] * a[5] - a[3] * a[2],
                 xz = a[3] * a[5] - a[4] * a[1];
    const double det = a[0] * xx + a[3] * xy + a[4] * xz, factor = 1 / det;
    inverse[0] = xx * factor;
    inverse[1] = (a[0] * a[2] - a[4] * a[4]) * factor;
    inverse[2] = (a[0] * a[1] - a[3] * a[3]) * factor;
    inverse[3] = xy * factor;
    inverse[4] = xz * factor;
    inverse[5] = (a[3] * a[4] - a[0] * a[5]) * factor;
    return det;
}

// Computes the product [9] of two symmetric tensors.
static inline void pm_sym_product(const double *a, const double *b, double *ab) {
    ab[0] = a[0] * b[0] + a[3] * b[3] + a[4] * b[4];
    ab[1] = a[0] * b[3] + a[3] * b[1] + a[4] * b[5];
    ab[2] = a[0] * b[4] + a[3] * b[5] + a[4] * b[2];
    ab[3] = a[3] * b[0] + a[1] * b[3] + a[5] * b[4];
    ab[4] = a[3] * b[3] + a[1] * b[1] + a[5] * b[5];
    ab[5] = a[3] * b[4] + a[1] * b[5] + a[5] * b[2];
    ab[6] = a[4] * b[0] + a[5] * b[3] + a[2] * b[4];
    ab[7] = a[4] * b[3] + a[5] * b[1] + a[2] * b[5];
    ab[8] = a[4] * b[4] + a[5] * b[5] + a[2] * b[2];
}

// Computes the product of a matrix m [9] and a symmetric tensor a, for those m and a whose product
// is symmetric.
static inline void pm_matrix_times_sym(const double *m, const double *a, double *ma) {
    for (int i = 0; i < PM_SYM; ++i) {
        const double *row = m + 3 * pm_sym_row[i];
        const int *at = pm_sym_at[pm_sym_column[i]];
        ma[i] = row[0] * a[at[0]] + row[1] * a[at[1]] + row[2] * a[at[2]];
    }
}

// Returns the determinant of a matrix.
static inline double pm_matrix_det(const double *m) {
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
           m[2] * (m[3] * m[7] - m[4] * m[6]);
}

#endif
