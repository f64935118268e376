// Learned irreversible rates whose heat goes into named entropies: THE SECOND LAW IS ENFORCED HERE
// for operators with `heats`. With the driving d = dS, the normal n = dE, and of each entropy k
// that takes up heat the temperature T_k = n_k/d_k, column j of the factor stands for one process:
// it moves the other variables along u_j with the force F_j = n . u_j, carries heat h_jk between
// the entropies, and heats entropy k by the share lambda_jk of its power (lambda >= 0, sum_k
// lambda_jk = 1):
//     v_j = (u_j, (h_jk - lambda_jk sum_l (F_j + h_jl)) / T_k)          so n . v_j = 0
//     rate = sum_j v_j (v_j . d) / |theta_j|,   theta_j = sum_k lambda_jk / T_k
// M = sum_j v_j v_j^T / |theta_j| is symmetric, positive semi-definite and degenerate for any
// factor. The division by theta is what makes constants of it: a process without h is friction -u_j
// F_j of constant coefficient whatever the temperatures, between two bodies, too, if u_j is a
// difference; a process without u is conduction of constant conductance between two entropies,
// since h_jk is measured in sqrt(m_j) with m_j = sum_k (1 - lambda_jk) T_k / (n - 1). Coefficients
// that depend on temperature by a power law, such as a viscosity, conduction by differences of 1/T
// (power -2) and nearly radiation (3), need no more: process j is multiplied by (m_j/T_ref)^a_j, of
// one entropy by (T/T_ref)^a_j.
#ifndef PM_MODEL_DISSIPATION_H
#define PM_MODEL_DISSIPATION_H

#include "graph/graph.h"

#define PM_MAX_HEATS 64 // components of entropies that one operator heats

typedef struct pm_dissipation {
    pm_node driving, normal; // [1][n] batched
    pm_node factor;          // [rank][n]: u_j, and h_jk in sqrt(W/K) at the entropies' places
    int nheat;
    int heat[PM_MAX_HEATS]; // the entropies' components, rising
    pm_node split; // [rank][nheat - 1]: logarithms of lambda_jk/lambda_j0 for k > 0; PM_NO_NODE
                   // where there is one entropy
    pm_node power, reference; // a [1][rank] and T_ref [1][1]; PM_NO_NODE: no dependence
} pm_dissipation;

// The rate [1][n].
pm_node pm_dissipation_build(pm_graph *g, const pm_dissipation *dissipation);

#endif
