// The learned functions of a material, their derivatives, and the relaxation of its branches.
#include "model/solid/material.h"

#include <math.h>
#include <stdio.h>

// Every learned function has two inputs. Those of a branch are t2 and t3.
enum { T2, T3, INPUTS };
// A step whose branch would gain energy is halved this many times, and then not taken.
#define HALVINGS 6

// --- parameters ---

#define MOST_NAME 64

static pm_status declare_function(pm_params *params, const char *name, int nunit) {
    const int n = INPUTS;
    char full[MOST_NAME];
    snprintf(full, sizeof full, "%s.scale", name);
    PM_TRY(pm_params_add(params, full, 1, n, false, 0, 1));
    snprintf(full, sizeof full, "%s.linear", name);
    PM_TRY(pm_params_add(params, full, 1, n, true, 0, 0));
    snprintf(full, sizeof full, "%s.quadratic", name);
    PM_TRY(pm_params_add(params, full, 1, 3, true, 0, 0));
    if (nunit == 0) {
        return PM_OK;
    }
    snprintf(full, sizeof full, "%s.units", name);
    return pm_params_add(params, full, nunit, n + 2, true, 0.5, 0);
}

pm_status pm_solid_material_declare(const pm_solid_spec *spec, pm_params *params) {
    PM_TRY(pm_params_add(params, "unit", 1, 1, false, 0, 1));
    PM_TRY(declare_function(params, "spring", spec->nunit));
    PM_TRY(declare_function(params, "volume", 0));
    for (int b = 0; b < spec->nbranch; ++b) {
        char name[MOST_NAME / 2];
        snprintf(name, sizeof name, "branch%d", b);
        PM_TRY(declare_function(params, name, spec->nunit));
        snprintf(name, sizeof name, "branch%d.relaxation", b);
        PM_TRY(pm_params_add(params, name, 1, 2, true, 0, 0));
    }
    return PM_OK;
}

static const double *values_of(const pm_params *params, const char *name, const char *what) {
    char full[MOST_NAME];
    snprintf(full, sizeof full, "%.31s.%.31s", name, what);
    return pm_params_find(params, full)->value;
}

static pm_learned_function read_function(const pm_params *params, const char *name, int nunit) {
    const double *linear = values_of(params, name, "linear");
    return (pm_learned_function){.nunit = nunit,
                                 .unit = pm_params_find(params, "unit")->value[0],
                                 .scale = values_of(params, name, "scale"),
                                 .linear = {exp(linear[0]), linear[1]},
                                 .quadratic = values_of(params, name, "quadratic"),
                                 .units = nunit == 0 ? NULL : values_of(params, name, "units")};
}

// --- learned functions ---

// Returns the function's value at the inputs x [INPUTS], which become its derivatives.
static double evaluate(const pm_learned_function *f, double *x) {
    const double y[INPUTS] = {x[0] / f->scale[0], x[1] / f->scale[1]}, *B = f->quadratic;
    double slope[INPUTS] = {f->linear[0], f->linear[1]};
    double value = slope[0] * y[0] + slope[1] * y[1] + B[0] * y[0] * y[0] / 2 + B[1] * y[0] * y[1] +
                   B[2] * y[1] * y[1] / 2;
    slope[0] += B[0] * y[0] + B[1] * y[1];
    slope[1] += B[1] * y[0] + B[2] * y[1];
    for (int k = 0; k < f->nunit; ++k) {
        const double *w = f->units + k * (INPUTS + 2), v = w[INPUTS + 1];
        const double t = tanh(w[0] * y[0] + w[1] * y[1] + w[INPUTS]);
        value += v * (t - tanh(w[INPUTS]));
        slope[0] += v * (1 - t * t) * w[0];
        slope[1] += v * (1 - t * t) * w[1];
    }
    x[0] = f->unit * slope[0] / f->scale[0];
    x[1] = f->unit * slope[1] / f->scale[1];
    return f->unit * value;
}

// Returns the derivative of a branch's function by t2 at rest.
static double stiffness_at_rest(const pm_learned_function *f) {
    double x[INPUTS] = {0};
    evaluate(f, x);
    return x[T2];
}

void pm_solid_material_read(const pm_solid_spec *spec, const pm_params *params,
                            pm_solid_material *material) {
    material->spring = read_function(params, "spring", spec->nunit);
    material->volume = read_function(params, "volume", 0);
    material->nbranch = spec->nbranch;
    for (int i = 0; i < spec->nbranch; ++i) {
        pm_solid_branch *branch = &material->branch[i];
        char name[MOST_NAME / 2];
        snprintf(name, sizeof name, "branch%d", i);
        const double *relaxation = values_of(params, name, "relaxation");
        branch->energy = read_function(params, name, spec->nunit);
        const pm_learned_function *f = &branch->energy;
        branch->m = exp(relaxation[0]) * f->scale[T2] / (2 * f->unit * f->linear[T2]);
        branch->s = 1 / (1 + exp(-relaxation[1]));
        branch->rate = fmax(2 * branch->m * stiffness_at_rest(f), 0);
    }
}

// --- energies ---

bool pm_solid_shape_make(pm_solid_shape *shape) {
    const double *F = shape->F;
    double C[PM_SYM];
    shape->J = pm_matrix_det(F);
    if (!(shape->J > 0)) {
        return false;
    }
    for (int i = 0; i < PM_SYM; ++i) {
        const int r = pm_sym_row[i], c = pm_sym_column[i];
        C[i] = F[r] * F[c] + F[3 + r] * F[3 + c] + F[6 + r] * F[6 + c];
    }
    const double root = cbrt(shape->J);
    shape->factor = 1 / (root * root);
    for (int i = 0; i < PM_SYM; ++i) {
        shape->Cbar[i] = shape->factor * C[i];
    }
    pm_sym_inverse(shape->Cbar, shape->inverse);
    return true;
}

double pm_solid_spring(const pm_solid_material *material, const double *Cbar, double *T,
                       double *modulus) {
    const double I1 = pm_sym_trace(Cbar), I2 = (I1 * I1 - pm_sym_dot(Cbar, Cbar)) / 2;
    double x[2] = {I1 - 3, I2 - 3};
    const double energy = evaluate(&material->spring, x);
    if (T != NULL) {
        for (int i = 0; i < PM_SYM; ++i) {
            T[i] += (i < 3 ? x[0] + x[1] * I1 : 0) - x[1] * Cbar[i];
        }
        *modulus += 2 * (x[0] * I1 + x[1] * I2) / 3;
    }
    return energy;
}

double pm_solid_volume(const pm_solid_material *material, double J, double *pressure,
                       double *modulus) {
    const double e = J - 1;
    double x[2] = {e * e, e * e * e};
    const double energy = evaluate(&material->volume, x);
    *pressure = 2 * e * x[0] + 3 * e * e * x[1];
    *modulus = 2 * x[0] + 6 * e * x[1];
    return energy;
}

// Computes Q = (Cbar^-1 - A) Cbar and, into x, the inputs of the function of a branch.
static void deviation(const double *Cbar, const double *inverse, const double *inner, double *Q,
                      double x[INPUTS]) {
    double open[PM_SYM];
    for (int i = 0; i < PM_SYM; ++i) {
        open[i] = (inverse[i] - (i < 3)) - inner[i];
    }
    pm_sym_product(open, Cbar, Q);
    double square = 0, cube = 0;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const double entry =
                Q[3 * i] * Q[j] + Q[3 * i + 1] * Q[3 + j] + Q[3 * i + 2] * Q[6 + j];
            square += i == j ? entry : 0;
            cube += entry * Q[3 * j + i];
        }
    }
    x[T2] = square;
    x[T3] = cube;
}

double pm_solid_branch_energy(const pm_solid_branch *branch, const double *Cbar,
                              const double *inverse, const double *inner, double *T) {
    double Q[9], x[INPUTS];
    deviation(Cbar, inverse, inner, Q, x);
    const double energy = evaluate(&branch->energy, x);
    if (T != NULL) {
        double A[PM_SYM], QA[PM_SYM], QQA[PM_SYM];
        for (int i = 0; i < PM_SYM; ++i) {
            A[i] = inner[i] + (i < 3);
        }
        pm_matrix_times_sym(Q, A, QA);
        pm_matrix_times_sym(Q, QA, QQA);
        for (int i = 0; i < PM_SYM; ++i) {
            T[i] -= 2 * x[T2] * QA[i] + 3 * x[T3] * QQA[i];
        }
    }
    return energy;
}

// --- relaxation ---

pm_solid_relaxation pm_solid_branch_relaxation(const pm_solid_branch *branch, double h) {
    const double a = h * branch->rate;
    const double decay = exp(-a), mean = a > 0 ? -expm1(-a) / a : 1;
    return (pm_solid_relaxation){h, decay, mean - decay, 1 - mean, mean};
}

double pm_solid_branch_modulus(const pm_solid_branch *branch, double h) {
    return 4 * stiffness_at_rest(&branch->energy) * pm_solid_branch_relaxation(branch, h).mean;
}

double pm_solid_branch_lose(const pm_solid_branch *branch, const pm_solid_change *change,
                            double first, const double *before, double *after, double energy[3]) {
    energy[2] = pm_solid_branch_energy(branch, change->Cbar[1], change->inverse[1], before, NULL);
    for (int k = 0; k <= HALVINGS; ++k) {
        for (int j = 0; j < 2; ++j) {
            energy[j] =
                pm_solid_branch_energy(branch, change->Cbar[j], change->inverse[j], after, NULL);
        }
        const double lost = (first - energy[0] + energy[2] - energy[1]) / 2;
        // A = 1 + inner must be positive definite, without which M would not be positive.
        const double A[PM_SYM] = {1 + after[0], 1 + after[1], 1 + after[2],
                                  after[3],     after[4],     after[5]};
        const double minor = A[0] * A[1] - A[3] * A[3];
        const double whole =
            A[2] * minor - A[0] * A[5] * A[5] - A[1] * A[4] * A[4] + 2 * A[3] * A[4] * A[5];
        if (lost >= 0 && lost < INFINITY && A[0] > 0 && minor > 0 && whole > 0) {
            return lost;
        }
        for (int i = 0; i < PM_SYM; ++i) {
            after[i] = k == HALVINGS ? before[i] : (before[i] + after[i]) / 2;
        }
    }
    energy[0] = first;
    energy[1] = energy[2];
    return 0;
}
