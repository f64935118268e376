// A learned material that keeps both laws. Its stored energy per undeformed volume depends on the
// deformation gradient F and on inner variables A_b, one symmetric tensor for each branch b:
//
//     psi = spring(I1 - 3, I2 - 3) + volume(J - 1) + sum_b branch_b(t2, t3)
//
// Here Cbar = det(F)^(-2/3) F^T F is the shape without its volume, I1 and I2 are its invariants, J
// is the relative volume of the element, and t_k is the trace of the k-th power of Q_b = 1 - A_b
// Cbar, which is zero in a branch that has relaxed. spring, volume and branch_b are learned
// functions. Since they see invariants alone, the energy does not change with rotations of the body
// or of the material, and the undeformed body is free of stress, whatever the weights are.
//
// The branches relax irreversibly, A' = -M(d psi/dA) with d psi/dA = -Cbar g(Q), where
//     M(Y) = m (1 - s) Cbar^-1 Y Cbar^-1 + m s/2 (A Y Cbar^-1 + Cbar^-1 Y A),
// m > 0 and 0 < s < 1 learned. M is symmetric and positive, so that the energy that a branch loses
// is never negative; it becomes heat. Near rest this is A' = rate (Cbar^-1 - A): `rate` is one over
// the relaxation time.
#ifndef PM_MODEL_SOLID_MATERIAL_H
#define PM_MODEL_SOLID_MATERIAL_H

#include <stdbool.h>

#include "base/status.h"
#include "model/params.h"
#include "model/solid/tensor.h"
#include "model/spec.h"

#define PM_SOLID_MAX_BRANCHES 4
#define PM_SOLID_MAX_UNITS 16

// A learned function of two inputs x, each divided by its scale:
//     unit (a.x + x.B.x/2 + sum_k v_k (tanh(w_k.x + b_k) - tanh(b_k)))
typedef struct pm_learned_function {
    int nunit;
    double unit;             // J/m^3
    const double *scale;     // [2]
    double linear[2];        // a, of which the parameters hold the logarithm of the first
    const double *quadratic; // [3] B11, B12, B22
    const double *units;     // [nunit][4] w, b, v
} pm_learned_function;

typedef struct pm_solid_branch {
    pm_learned_function energy; // of t2, t3
    double m;                   // m^3/(J s)
    double s;                   // 0 to 1
    double rate;                // 1/s, at rest
} pm_solid_branch;

typedef struct pm_solid_material {
    pm_learned_function spring; // of I1 - 3, I2 - 3
    pm_learned_function volume; // of (J - 1)^2, (J - 1)^3
    int nbranch;
    pm_solid_branch branch[PM_SOLID_MAX_BRANCHES];
} pm_solid_material;

// Adds the parameters of a material: "unit" (J/m^3, constant), and for "spring", "volume" and
// "branch0", ... "NAME.scale" (constant), "NAME.linear", "NAME.quadratic", "NAME.units", and
// "branch0.relaxation" [2] (the logarithm of the rate, s^-1, and the logit of s). All are learned,
// except where it says constant. PM_ENOMEM.
pm_status pm_solid_material_declare(const pm_solid_spec *spec, pm_params *params);
// Reads the material from its parameters, which must outlive it. The first number of "linear" is
// the logarithm of the coefficient, so that this coefficient, the stiffness at rest, is positive.
// Call it again after a parameter has changed.
void pm_solid_material_read(const pm_solid_spec *spec, const pm_params *params,
                            pm_solid_material *material);

// The shape at a point.
typedef struct pm_solid_shape {
    double F[9], J;
    double factor;          // J^(-2/3)
    double Cbar[PM_SYM];    // without volume
    double inverse[PM_SYM]; // of Cbar
} pm_solid_shape;

// Computes the shape for the deformation gradient shape->F. Returns false if its determinant is not
// positive.
bool pm_solid_shape_make(pm_solid_shape *shape);

// Returns the energy of the spring, J/m^3, adds d psi/d Cbar to T [PM_SYM] and the modulus at this
// shape to *modulus (J/m^3). T may be NULL; then nothing is added.
double pm_solid_spring(const pm_solid_material *material, const double *Cbar, double *T,
                       double *modulus);
// Returns the energy of volume, J/m^3, for the relative volume J, and its first and second
// derivatives.
double pm_solid_volume(const pm_solid_material *material, double J, double *pressure,
                       double *modulus);
// Returns the energy of a branch, J/m^3, and adds d psi/d Cbar to T [PM_SYM] unless T is NULL.
// `inner` is A - 1.
double pm_solid_branch_energy(const pm_solid_branch *branch, const double *Cbar,
                              const double *inverse, const double *inner, double *T);
// Returns the modulus of a branch at rest under a change of shape that takes h s, J/m^3.
double pm_solid_branch_modulus(const pm_solid_branch *branch, double h);

// The shape at the start and at the end of a step.
typedef struct pm_solid_change {
    const double *Cbar[2], *inverse[2];
} pm_solid_change;

// How a branch relaxes in a step of h s, if it is linear: A = decay A + start Cbar^-1 (before) +
// end Cbar^-1 (after). `mean` is the mean of exp(-rate t) over the step.
typedef struct pm_solid_relaxation {
    double h, decay, start, end, mean;
} pm_solid_relaxation;
pm_solid_relaxation pm_solid_branch_relaxation(const pm_solid_branch *branch, double h);

// Returns the energy that the branch loses with this change of its inner variable, at the mean of
// both shapes, J/m^3. It is not negative: `after` is moved towards `before` where the method's
// error would make it so, or would make A lose its positive eigenvalues. `energy` are the branch's
// energies with `after` at both shapes, and with `before` at the second one; `first` is that with
// `before` at the first one.
double pm_solid_branch_lose(const pm_solid_branch *branch, const pm_solid_change *change,
                            double first, const double *before, double *after, double energy[3]);

#endif
