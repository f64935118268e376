// Tensors in three dimensions: 3x3 matrices [9] by rows, and symmetric ones [6] as xx yy zz xy xz
// yz.
#ifndef PM_BODIES_TRUTH_BEAM_TENSOR_H
#define PM_BODIES_TRUTH_BEAM_TENSOR_H

enum { PM_XX, PM_YY, PM_ZZ, PM_XY, PM_XZ, PM_YZ, PM_SYMMETRIC };

// Row and column of each component, and the component at each row and column.
static const int pm_tensor_row[PM_SYMMETRIC] = {0, 1, 2, 0, 0, 1};
static const int pm_tensor_column[PM_SYMMETRIC] = {0, 1, 2, 1, 2, 2};
static const int pm_tensor_at[3][3] = {
    {PM_XX, PM_XY, PM_XZ}, {PM_XY, PM_YY, PM_YZ}, {PM_XZ, PM_YZ, PM_ZZ}};

// Returns the trace of a symmetric tensor.
static inline double pm_tensor_trace(const double *a) {
    return a[PM_XX] + a[PM_YY] + a[PM_ZZ];
}

// Returns the double contraction a : b of symmetric tensors.
static inline double pm_tensor_double_dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + 2 * (a[3] * b[3] + a[4] * b[4] + a[5] * b[5]);
}

// Returns the determinant of a matrix.
static inline double pm_tensor_det3(const double F[9]) {
    return F[0] * (F[4] * F[8] - F[5] * F[7]) - F[1] * (F[3] * F[8] - F[5] * F[6]) +
           F[2] * (F[3] * F[7] - F[4] * F[6]);
}

// Computes the inverse [9] of a matrix F with the determinant det.
static inline void pm_tensor_inverse3(const double F[9], double det, double *inverse) {
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            inverse[3 * i + j] = (F[3 * a + c] * F[3 * b + d] - F[3 * a + d] * F[3 * b + c]) / det;
        }
    }
}

// Returns the determinant of a symmetric tensor.
static inline double pm_tensor_det(const double *a) {
    return a[0] * (a[1] * a[2] - a[5] * a[5]) - a[3] * (a[3] * a[2] - a[5] * a[4]) +
           a[4] * (a[3] * a[5] - a[1] * a[4]);
}

// Computes the inverse [6] of a symmetric tensor.
static inline void pm_tensor_inverse(const double *a, double *inverse) {
    const double det = pm_tensor_det(a);
    inverse[PM_XX] = (a[1] * a[2] - a[5] * a[5]) / det;
    inverse[PM_YY] = (a[0] * a[2] - a[4] * a[4]) / det;
    inverse[PM_ZZ] = (a[0] * a[1] - a[3] * a[3]) / det;
    inverse[PM_XY] = (a[4] * a[5] - a[3] * a[2]) / det;
    inverse[PM_XZ] = (a[3] * a[5] - a[4] * a[1]) / det;
    inverse[PM_YZ] = (a[3] * a[4] - a[0] * a[5]) / det;
}

// Pushes a symmetric tensor forward: result = F a F^T.
static inline void pm_tensor_push(const double F[9], const double *a, double *result) {
    double Fa[9];
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            Fa[3 * i + j] = F[3 * i] * a[pm_tensor_at[0][j]] +
                            F[3 * i + 1] * a[pm_tensor_at[1][j]] +
                            F[3 * i + 2] * a[pm_tensor_at[2][j]];
        }
    }
    for (int m = 0; m < PM_SYMMETRIC; ++m) {
        const double *x = Fa + 3 * pm_tensor_row[m], *y = F + 3 * pm_tensor_column[m];
        result[m] = x[0] * y[0] + x[1] * y[1] + x[2] * y[2];
    }
}

#endif
