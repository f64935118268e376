// Learned irreversible rates whose heat goes into named entropies: THE SECOND LAW IS ENFORCED HERE
// for operators with `heats`. The rate is the term M dS of equation (1), or B B^T eta of (3).
//
// With the driving d = dS and the normal n = dE, each entropy k that takes up heat has the
// temperature T_k = n_k/d_k. Row j of the factor describes one irreversible process. The process
// changes the other variables along u_j against the force F_j = n . u_j, carries heat h_jk between
// the entropies, and heats entropy k by the share lambda_jk of the power that it dissipates, where
// lambda_jk >= 0 and sum_k lambda_jk = 1:
//     v_j = (u_j, (h_jk - lambda_jk sum_l (F_j + h_jl)) / T_k)          so that n . v_j = 0
//     rate = sum_j v_j (v_j . d) / |theta_j|,   theta_j = sum_k lambda_jk / T_k
// Hence M = sum_j v_j v_j^T / |theta_j| is symmetric, positive semi-definite and degenerate for any
// factor.
//
// Because of the division by theta, a constant factor describes a constant material property:
//   - A process without h is friction -u_j F_j, with a coefficient that does not depend on the
//     temperatures. It acts between two bodies if u_j is a difference.
//   - A process without u is conduction between two entropies with a constant conductance. For this
//     purpose the factor holds h_jk/sqrt(m_j), with the mean temperature
//     m_j = sum_k (1 - lambda_jk) T_k / (N - 1) of N entropies.
// Coefficients may also depend on temperature by power laws. The rate of process j is multiplied by
// (m_j/T_ref)^a_j, where m_j = T if there is one entropy. If there are several, it is also
// multiplied by (m_j/g_j)^c_j, where g_j is the geometric mean of the T_k with the weights of m_j.
// Examples are viscosities, conduction driven by differences of 1/T (a = -2, c = 2, exactly), and
// radiation between bodies (a = 3, c = 2, to fourth order of the difference). Any other dependence
// on the state, such as that of a friction which grows with the velocity, is a further positive
// factor exp(f_j) of process j.
#ifndef PM_MODEL_DISSIPATION_H
#define PM_MODEL_DISSIPATION_H

#include "graph/graph.h"

#define PM_MAX_HEATS 64 // components of entropies that one operator heats

typedef struct pm_dissipation {
    pm_node driving, normal; // [1][n] batched: d and n
    pm_node factor; // [rank][n]: u_j; in the columns of the entropies h_jk/sqrt(m_j), in sqrt(W/K)
    int nheat;
    int heat[PM_MAX_HEATS]; // [nheat] components of the entropies, in ascending order
    pm_node split; // [rank][nheat - 1]: logarithms of lambda_jk/lambda_j0 for k > 0; PM_NO_NODE:
                   // equal shares
    pm_node power, reference; // the exponents a [1][rank], and T_ref [1][1] in K; power PM_NO_NODE:
                              // coefficients do not depend on temperature
    pm_node strength;    // [1][rank] logarithms of a further factor of each process, functions of
                         // the state and of the forces; PM_NO_NODE: the factor is 1
    pm_node warmth;      // ln w [1][1]: conductances and T_ref are multiplied by w. PM_NO_NODE:
                         // w = 1
    pm_node ratio_power; // the exponents c [1][rank]; PM_NO_NODE where there is one entropy
} pm_dissipation;

// Returns the forces [1][rank] that drive the processes, sum_l (F_j + h_jl). They do not depend on
// the strength.
pm_node pm_dissipation_force(pm_graph *g, const pm_dissipation *dissipation);

// Returns the rate [1][n], in the units of the variables per second.
pm_node pm_dissipation_build(pm_graph *g, const pm_dissipation *dissipation);

#endif
