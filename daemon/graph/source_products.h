
// Products of matrices, with the order of sums of portmetd.

// c [m][n] = a b. Neighbouring rows of a are a_row numbers apart, and neighbouring columns a_col;
// b_row and b_col are the same distances in b.
static inline void pm_product(int m, int n, int k, const double *a, int a_row, int a_col,
                              const double *b, int b_row, int b_col, double *restrict c) {
    for (int i = 0; i < m; ++i) {
        for (int j = 0; j < n; ++j) {
            c[i * n + j] = 0;
        }
        for (int l = 0; l < k; ++l) {
            const double factor = a[i * a_row + l * a_col];
            for (int j = 0; j < n; ++j) {
                c[i * n + j] += factor * b[l * b_row + j * b_col];
            }
        }
    }
}

// c [m][n] = a b, where b is stored by columns [n][k]. Every entry of c is an inner product of
// eight partial sums.
static inline void pm_inner_products(int m, int n, int k, const double *a, int a_row, int a_col,
                                     const double *b, double *restrict c) {
    for (int i = 0; i < m; ++i) {
        for (int j = 0; j < n; ++j) {
            double lane[8] = {0};
            for (int l = 0; l < k; ++l) {
                lane[l % 8] += a[i * a_row + l * a_col] * b[j * k + l];
            }
            c[i * n + j] = ((lane[0] + lane[4]) + (lane[1] + lane[5])) +
                           ((lane[2] + lane[6]) + (lane[3] + lane[7]));
        }
    }
}
