// Integrates over a brick by 2x2x2 Gauss points.
#include "bodies/truth/beam_element.h"

#include <math.h>
#include <string.h>

// The corners in [-1, 1]^3. The Gauss points are these divided by sqrt(3).
static const double sign[PM_BEAM_CORNERS][3] = {{-1, -1, -1}, {1, -1, -1}, {1, 1, -1}, {-1, 1, -1},
                                                {-1, -1, 1},  {1, -1, 1},  {1, 1, 1},  {-1, 1, 1}};

// --- shape functions ---

// Returns the derivative by s_d of a corner's shape function, the product of (1 + sign_e s_e)/2
// over e.
static double shape_slope(int corner, const double s[3], int d) {
    const int e = (d + 1) % 3, f = (d + 2) % 3;
    return sign[corner][d] * (1 + sign[corner][e] * s[e]) * (1 + sign[corner][f] * s[f]) / 8;
}

void pm_beam_element_init(pm_beam_element *element, const double *x) {
    element->volume = 0;
    for (int p = 0; p < PM_BEAM_POINTS; ++p) {
        double s[3], jacobian[9] = {0}, inverse[9];
        for (int d = 0; d < 3; ++d) {
            s[d] = sign[p][d] / sqrt(3);
        }
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            for (int i = 0; i < 9; ++i) {
                jacobian[i] += x[3 * c + i / 3] * shape_slope(c, s, i % 3);
            }
        }
        element->weight[p] = pm_tensor_det3(jacobian);
        element->volume += element->weight[p];
        pm_tensor_inverse3(jacobian, element->weight[p], inverse);
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            for (int j = 0; j < 3; ++j) {
                double *g = &element->gradient[p][c][j];
                *g = 0;
                for (int d = 0; d < 3; ++d) {
                    *g += shape_slope(c, s, d) * inverse[3 * d + j];
                }
            }
        }
    }
}

// --- the response ---

// The deformation at a Gauss point.
typedef struct kinematics {
    double F[9], J;
    double gradient[PM_BEAM_CORNERS][3]; // 1/m, of the shape functions in the deformed body
} kinematics;

// Adds the material stiffness of `tangent` and the geometric stiffness of `stress`, both weighted,
// to the upper triangle of K; g are the gradients of the shape functions.
static void add_stiffness(double g[PM_BEAM_CORNERS][3], double tangent[PM_SYMMETRIC][PM_SYMMETRIC],
                          const double *stress, double K[PM_BEAM_FREEDOMS][PM_BEAM_FREEDOMS]) {
    double side[PM_SYMMETRIC][PM_BEAM_FREEDOMS];
    for (int m = 0; m < PM_SYMMETRIC; ++m) {
        for (int column = 0; column < PM_BEAM_FREEDOMS; ++column) {
            const double *gb = g[column / 3];
            const int *at = pm_tensor_at[column % 3];
            side[m][column] =
                tangent[m][at[0]] * gb[0] + tangent[m][at[1]] * gb[1] + tangent[m][at[2]] * gb[2];
        }
    }
    for (int row = 0; row < PM_BEAM_FREEDOMS; ++row) {
        const double *ga = g[row / 3];
        const int *at = pm_tensor_at[row % 3];
        for (int column = row; column < PM_BEAM_FREEDOMS; ++column) {
            K[row][column] += ga[0] * side[at[0]][column] + ga[1] * side[at[1]][column] +
                              ga[2] * side[at[2]][column];
        }
    }
    for (int a = 0; a < PM_BEAM_CORNERS; ++a) {
        double pull[3];
        for (int j = 0; j < 3; ++j) {
            const int *at = pm_tensor_at[j];
            pull[j] = stress[at[0]] * g[a][0] + stress[at[1]] * g[a][1] + stress[at[2]] * g[a][2];
        }
        for (int b = a; b < PM_BEAM_CORNERS; ++b) {
            const double sum = pull[0] * g[b][0] + pull[1] * g[b][1] + pull[2] * g[b][2];
            for (int i = 0; i < 3; ++i) {
                K[3 * a + i][3 * b + i] += sum;
            }
        }
    }
}

bool pm_beam_element_respond(const pm_beam_element *element, const pm_beam_material *material,
                             double h, const double *q, const pm_beam_memory *before,
                             pm_beam_memory *after, pm_beam_element_response *response) {
    kinematics k[PM_BEAM_POINTS];
    double volume = 0, growth[PM_BEAM_FREEDOMS] = {0}; // d(volume)/dq
    memset(response, 0, sizeof *response);
    for (int p = 0; p < PM_BEAM_POINTS; ++p) {
        double inverse[9];
        memset(k[p].F, 0, sizeof k[p].F);
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            for (int i = 0; i < 9; ++i) {
                k[p].F[i] += q[3 * c + i / 3] * element->gradient[p][c][i % 3];
            }
        }
        k[p].J = pm_tensor_det3(k[p].F);
        if (!(k[p].J > 0)) {
            return false;
        }
        pm_tensor_inverse3(k[p].F, k[p].J, inverse);
        for (int c = 0; c < PM_BEAM_CORNERS; ++c) {
            const double *g = element->gradient[p][c];
            for (int j = 0; j < 3; ++j) {
                k[p].gradient[c][j] =
                    g[0] * inverse[j] + g[1] * inverse[3 + j] + g[2] * inverse[6 + j];
            }
        }
        volume += element->weight[p] * k[p].J;
        for (int row = 0; row < PM_BEAM_FREEDOMS; ++row) {
            growth[row] += element->weight[p] * k[p].J * k[p].gradient[row / 3][row % 3];
        }
    }
    const double excess = volume / element->volume - 1;
    for (int p = 0; p < PM_BEAM_POINTS; ++p) {
        pm_beam_response point;
        pm_beam_material_respond(material, h, k[p].F, k[p].J, &before[p], &after[p], &point);
        const double Jp = k[p].J * (2 * excess / material->D1), weight = element->weight[p];
        double stress[PM_SYMMETRIC], tangent[PM_SYMMETRIC][PM_SYMMETRIC];
        for (int i = 0; i < PM_SYMMETRIC; ++i) {
            stress[i] = weight * (point.stress[i] + (i < 3 ? Jp : 0));
            response->stress[i] += stress[i] / (k[p].J * element->volume);
            for (int j = 0; j < PM_SYMMETRIC; ++j) {
                tangent[i][j] = weight * (point.tangent[i][j] + (i < 3 && j < 3 ? Jp : 0));
            }
            tangent[i][i] -= weight * Jp * (i < 3 ? 2 : 1);
        }
        for (int row = 0; row < PM_BEAM_FREEDOMS; ++row) {
            const double *g = k[p].gradient[row / 3];
            const int *at = pm_tensor_at[row % 3];
            response->force[row] +=
                stress[at[0]] * g[0] + stress[at[1]] * g[1] + stress[at[2]] * g[2];
        }
        add_stiffness(k[p].gradient, tangent, stress, response->stiffness);
        response->energy += weight * point.energy;
        response->dissipated += weight * point.dissipated;
    }
    // The stiffness that follows from the change of the pressure with theta.
    const double factor = 2 / (material->D1 * element->volume);
    for (int row = 0; row < PM_BEAM_FREEDOMS; ++row) {
        for (int column = row; column < PM_BEAM_FREEDOMS; ++column) {
            response->stiffness[row][column] += factor * growth[row] * growth[column];
        }
    }
    response->energy += element->volume * excess * excess / material->D1;
    return true;
}
