// The normal equations of a loss, in three forms.
//
// The Gauss-Newton matrix is the approximation J^T W J of the Hessian of half the mean loss, where
// J is the Jacobian of the residuals of all samples with respect to all weights (Nocedal, Wright,
// Numerical Optimization, 2006, section 10.3) and W holds the weights of the samples.
//
// Products of the matrix with vectors need neither J nor the matrix (Schraudolph, Neural
// Computation 14 (2002) 1723). A reverse pass computes J^T u as a function of u. This function is
// linear, and the reverse pass through it computes J v. One more reverse pass multiplies W J v by
// J^T. A product costs about as much as three gradients, for any number of weights and residuals.
//
// The damped equations of Levenberg-Marquardt are
//     (H + R + S + damping D + near I) step = -gradient - g,
// where H is the matrix of a batch and D its diagonal. They are solved by a Cholesky factorisation
// of the matrix, or by conjugate gradients with products.
//
// A step v follows the tangent of the residuals, and soon leaves a narrow curved valley. An
// accelerated step bends with the valley: the second derivative r'' of the residuals along v gives
// (H + ...) a = -J^T W r''/2 with the same factor, and the step is v + a (Transtrum, Sethna,
// arXiv:1201.5885, 2012). Its three evaluations and one reverse pass cost far less than the matrix.
//
// R is zero except for weights that are held (model/params.h), such as a common size of
// temperatures, which data determine weakly. While the rest of a model is wrong, a step without R
// would move such weights arbitrarily far. For these weights R = loss/width^2, so that a step as
// long as the width pays only if it removes the whole loss. R vanishes with the loss, so that the
// convergence stays quadratic (Yamashita, Fukushima, Computing Suppl. 15 (2001) 239).
//
// g and S are the gradient and the curvature of a penalty shrinkage/4 sum theta^4 over the weights
// that shrink (model/params.h), those of hidden layers. It keeps large weights from growing where
// the data do not need them, and hardly acts on small ones: a square would let all layers vanish
// together, from where no gradient leads back.
#ifndef PM_TRAINER_OPTIMISE_NORMAL_EQUATIONS_H
#define PM_TRAINER_OPTIMISE_NORMAL_EQUATIONS_H

#include <stdint.h>

#include "loss/objective.h"

// --- the matrix and its products ---

typedef struct pm_gauss_newton pm_gauss_newton;

// Prepares the Jacobian for the loss of `objective`, which must outlive the result; without
// `matrix` it prepares products instead. The matrix leaves out the derivatives with respect to
// weights that are frozen [n], which count as zero; the weights of one array of a model are frozen
// together. NULL: none is. The caller closes it. PM_ENOMEM.
//
// The functions below take samples index [count]; n is pm_objective_size. The last call of
// pm_objective_evaluate must have covered these samples at the present weights, since its robust
// weights are used.
pm_status pm_gauss_newton_open(pm_gauss_newton **form, pm_objective *objective, bool matrix,
                               const bool *frozen);
void pm_gauss_newton_close(pm_gauss_newton *form); // NULL is allowed

// Computes the gradient [n] and the upper triangle of the matrix hessian [n][n] of half the mean
// loss. The form must have been opened for the matrix.
void pm_gauss_newton_evaluate(pm_gauss_newton *form, int count, const int *index, double *gradient,
                              double *hessian);

// Computes the gradient [n] of half the mean loss, and an estimate of the diagonal [n] of the
// matrix: the mean of the squares of J^T u over some vectors u of random signs, which are drawn
// with `seed` (Bekas, Kokiopoulou, Saad, Appl. Numer. Math. 57 (2007) 1214). The form must have
// been opened for products.
void pm_gauss_newton_linearise(pm_gauss_newton *form, int count, const int *index, uint64_t seed,
                               double *gradient, double *diagonal);

// Computes result [n] = matrix * vector [n], with the matrix of half the mean loss at the present
// weights. The form must have been opened for products.
void pm_gauss_newton_apply(pm_gauss_newton *form, int count, const int *index, const double *vector,
                           double *result);

// --- damped equations ---

typedef struct pm_damped_equations {
    pm_arena arena; // owns the arrays below
    int size;
    pm_objective *objective; // borrowed
    pm_gauss_newton *form;
    bool accelerates;            // steps that can be are; true at first, the caller may change it
    double *gradient, *diagonal; // [size]
    double *held;                // [size] 1 for weights that are held, else 0
    double hold;                 // what is added to the diagonal for weights that are held
    double *shrinks;             // [size] 1 for weights that shrink, else 0
    double *bend;                // [size] the diagonal of S
    double shrinkage;            // the factor of the penalty; 0 at first, the caller may change it
    double *hessian, *damped;    // [size][size] H and the damped matrix; NULL: conjugate gradients
    double *bent;                // [size] the acceleration; NULL: conjugate gradients
    double *residual, *conditioned, *direction, *image; // [size] vectors of conjugate gradients
    double near;          // `near` in the equation; 0 at first, the caller may change it
    const bool *frozen;   // [size] weights whose step is zero, borrowed; NULL: none
    int *active, nactive; // [nactive] the other weights
    int count;            // the batch of the last linearisation
    const int *index;     // [count], borrowed
} pm_damped_equations;

// Prepares the equations for the loss of `objective`, which must outlive them. With `matrix` they
// are solved by a Cholesky factorisation, otherwise by conjugate gradients. Steps of the
// factorisation can be accelerated if a batch has at most `accelerated` samples. `frozen` [size]
// marks weights whose step is zero; it is borrowed and may be NULL. The caller closes the
// equations, after a failure too. PM_ENOMEM.
pm_status pm_damped_equations_open(pm_damped_equations *e, pm_objective *objective, int accelerated,
                                   bool matrix, const bool *frozen);
void pm_damped_equations_close(pm_damped_equations *e);

// Computes the gradient and the matrix, or its diagonal, on the samples index [count], at the
// present weights `theta` [size]. The last call of pm_objective_evaluate must have covered these
// samples at these weights, and returned `loss`. `seed` decides the estimate of the diagonal.
// `index` is borrowed until the next call.
void pm_damped_equations_linearise(pm_damped_equations *e, int count, const int *index,
                                   uint64_t seed, double loss, const double *theta);
// Returns the penalty on the weights `theta` [size] that shrink.
double pm_damped_equations_penalty(const pm_damped_equations *e, const double *theta);

#define PM_MOST_CONJUGATE_GRADIENTS 100

// Replaces step [size], the initial guess of conjugate gradients, by the solution. Without a matrix
// the function takes at most `most` iterations, up to PM_MOST_CONJUGATE_GRADIENTS. The weights of
// the objective may have changed since the linearisation; `theta` [size] are those of the
// linearisation. Returns false if the equations cannot be solved with this damping, or if an
// accelerated step would bend too much.
bool pm_damped_equations_solve(pm_damped_equations *e, const double *theta, double damping,
                               int most, double *step);

#endif
