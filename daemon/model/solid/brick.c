// Shape functions of the brick, and its Gauss points, two along each axis.
#include "model/solid/brick.h"

#include <math.h>

#include "model/solid/tensor.h"

// The corners of the cube [-1, 1]^3, which are the nodes. The Gauss points are these divided by
// sqrt(3).
static const double corner[PM_BRICK_NODES][3] = {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1},
                                                 {-1, -1, 1},  {1, -1, 1},  {1, 1, 1},  {-1, 1, 1}};

bool pm_brick_make(pm_brick *brick, const double *x) {
    brick->volume = 0;
    for (int p = 0; p < PM_BRICK_POINTS; ++p) {
        double s[3], local[PM_BRICK_NODES][3], jacobian[9] = {0};
        for (int d = 0; d < 3; ++d) {
            s[d] = corner[p][d] / sqrt(3);
        }
        for (int n = 0; n < PM_BRICK_NODES; ++n) {
            for (int i = 0; i < 9; ++i) {
                local[n][i % 3] = corner[n][i % 3] / 8; // the slope of the shape function
                for (int e = 0; e < 3; ++e) {
                    local[n][i % 3] *= e == i % 3 ? 1 : 1 + corner[n][e] * s[e];
                }
                jacobian[i] += x[3 * n + i / 3] * local[n][i % 3];
            }
        }
        const double det = pm_matrix_det(jacobian);
        if (!(det > 0)) {
            return false;
        }
        brick->weight[p] = det;
        brick->volume += det;
        for (int n = 0; n < PM_BRICK_NODES; ++n) {
            for (int j = 0; j < 3; ++j) {
                // The columns of the inverse are cross products of rows of the Jacobian.
                const double *a = jacobian + 3 * ((j + 1) % 3), *b = jacobian + 3 * ((j + 2) % 3);
                brick->gradient[n][j][p] = (local[n][0] * (a[1] * b[2] - a[2] * b[1]) +
                                            local[n][1] * (a[2] * b[0] - a[0] * b[2]) +
                                            local[n][2] * (a[0] * b[1] - a[1] * b[0])) /
                                           det;
            }
        }
    }
    return true;
}

void pm_brick_deform(const pm_brick *brick, const double *u, double F[PM_BRICK_POINTS][9]) {
    for (int i = 0; i < 9; ++i) {
        double sum[PM_BRICK_POINTS] = {0};
        for (int n = 0; n < PM_BRICK_NODES; ++n) {
            const double *g = brick->gradient[n][i % 3];
            for (int p = 0; p < PM_BRICK_POINTS; ++p) {
                sum[p] += u[3 * n + i / 3] * g[p];
            }
        }
        for (int p = 0; p < PM_BRICK_POINTS; ++p) {
            F[p][i] = sum[p] + (i % 4 == 0);
        }
    }
}
