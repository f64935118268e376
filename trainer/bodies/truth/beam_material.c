// Computes stress and tangent as functions of Cbar first, and then projects them onto their
// isochoric parts (Holzapfel, Nonlinear Solid Mechanics, 2000, section 6.6).
#include "bodies/truth/beam_material.h"

#include <math.h>
#include <string.h>

static const double unit[PM_SYMMETRIC] = {1, 1, 1, 0, 0, 0};

void pm_beam_memory_init(pm_beam_memory *memory) {
    memcpy(memory->inverse, unit, sizeof unit);
    for (int i = 0; i < PM_BEAM_MAX_BRANCHES; ++i) {
        memcpy(memory->inner[i], unit, sizeof unit);
    }
}

// --- stress and tangent as functions of Cbar ---

// Adds the spring, which carries `share` of the instantaneous stress.
static void add_spring(const pm_beam_material *m, double share, const double *b,
                       pm_beam_response *r) {
    const double C10 = share * m->C10, C01 = share * m->C01, I1 = pm_tensor_trace(b);
    const double I2 = (I1 * I1 - pm_tensor_double_dot(b, b)) / 2;
    r->energy += C10 * (I1 - 3) + C01 * (I2 - 3);
    for (int m1 = 0; m1 < PM_SYMMETRIC; ++m1) {
        const int i = pm_tensor_row[m1], j = pm_tensor_column[m1];
        double bb = 0;
        for (int k = 0; k < 3; ++k) {
            bb += b[pm_tensor_at[i][k]] * b[pm_tensor_at[k][j]];
        }
        r->stress[m1] += 2 * (C10 + C01 * I1) * b[m1] - 2 * C01 * bb;
        for (int m2 = 0; m2 < PM_SYMMETRIC; ++m2) {
            const int k = pm_tensor_row[m2], l = pm_tensor_column[m2];
            const double cross = b[pm_tensor_at[i][k]] * b[pm_tensor_at[j][l]] +
                                 b[pm_tensor_at[i][l]] * b[pm_tensor_at[j][k]];
            r->tangent[m1][m2] += 4 * C01 * (b[m1] * b[m2] - cross / 2);
        }
    }
}

// Computes the inner strain A of a branch after h s in which Cbar^-1 went linearly from `before` to
// `inverse`. Returns dA / d(Cbar^-1).
static double relax(double h, double tau, const double *before, const double *inner,
                    const double *inverse, double *A) {
    const double a = h / tau, decay = exp(-a), mean = a > 0 ? -expm1(-a) / a : 1;
    const double start = mean - decay, end = 1 - mean;
    for (int i = 0; i < PM_SYMMETRIC; ++i) {
        A[i] = decay * inner[i] + start * before[i] + end * inverse[i];
    }
    return end;
}

// Returns the energy that a branch of modulus 1 dissipates in that time, by two Gauss points.
static double dissipate(double h, double tau, const double *before, const double *inner,
                        const double *inverse) {
    double sum = 0;
    for (int p = 0; p < 2; ++p) {
        const double part = 0.5 + (p - 0.5) / sqrt(3);
        double A[PM_SYMMETRIC], Cbar[PM_SYMMETRIC], here[PM_SYMMETRIC], A_inverse[PM_SYMMETRIC];
        for (int i = 0; i < PM_SYMMETRIC; ++i) {
            here[i] = before[i] + part * (inverse[i] - before[i]);
        }
        relax(part * h, tau, before, inner, here, A);
        pm_tensor_inverse(here, Cbar);
        pm_tensor_inverse(A, A_inverse);
        sum += pm_tensor_double_dot(Cbar, A) + pm_tensor_double_dot(A_inverse, here) - 6;
    }
    return h / (4 * tau) * sum;
}

// --- the isochoric part ---

// Removes the trace from the stress and from both sides of the tangent.
static void project(pm_beam_response *r) {
    const double trace = pm_tensor_trace(r->stress);
    double side[PM_SYMMETRIC], total = 0;
    for (int i = 0; i < PM_SYMMETRIC; ++i) {
        side[i] = (r->tangent[i][0] + r->tangent[i][1] + r->tangent[i][2]) / 3;
        r->stress[i] -= trace / 3 * unit[i];
    }
    total = pm_tensor_trace(side) / 3;
    for (int i = 0; i < PM_SYMMETRIC; ++i) {
        for (int j = 0; j < PM_SYMMETRIC; ++j) {
            r->tangent[i][j] += -unit[i] * side[j] - side[i] * unit[j] +
                                (total - 2 * trace / 9) * unit[i] * unit[j] -
                                2.0 / 3 * (unit[i] * r->stress[j] + r->stress[i] * unit[j]);
        }
        r->tangent[i][i] += 2 * trace / 3 * (i < 3 ? 1 : 0.5);
    }
}

void pm_beam_material_respond(const pm_beam_material *material, double h, const double F[9],
                              double J, const pm_beam_memory *before, pm_beam_memory *after,
                              pm_beam_response *response) {
    const double scale = pow(J, -1.0 / 3);
    double Fbar[9], transposed[9], b[PM_SYMMETRIC], Cbar[PM_SYMMETRIC], spring = 1;
    for (int i = 0; i < 9; ++i) {
        Fbar[i] = scale * F[i];
        transposed[i % 3 * 3 + i / 3] = Fbar[i];
    }
    pm_tensor_push(Fbar, unit, b);
    pm_tensor_push(transposed, unit, Cbar);
    pm_tensor_inverse(Cbar, after->inverse);
    memset(response, 0, sizeof *response);
    response->J = J;
    for (int k = 0; k < material->nbranch; ++k) {
        const double mu = 2 * material->g[k] * (material->C10 + material->C01),
                     tau = material->tau[k];
        const double *inner = before->inner[k];
        double *A = after->inner[k], pushed[PM_SYMMETRIC];
        const double end = relax(h, tau, before->inverse, inner, after->inverse, A);
        pm_tensor_push(Fbar, A, pushed);
        for (int i = 0; i < PM_SYMMETRIC; ++i) {
            response->stress[i] += mu * pushed[i];
            response->tangent[i][i] -= mu * end * (i < 3 ? 2 : 1);
        }
        response->energy += mu / 2 * (pm_tensor_double_dot(Cbar, A) - 3 - log(pm_tensor_det(A)));
        response->dissipated += mu * dissipate(h, tau, before->inverse, inner, after->inverse);
        spring -= material->g[k];
    }
    add_spring(material, spring, b, response);
    project(response);
}
