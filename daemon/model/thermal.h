// Energies whose temperature and heat capacity are positive for all weights. The energy is a
// function of the entropies s and of other features x:
//     E = unit f(x) + Theta sum_i A_i (exp(b_i . (s - mean)/deviation + beta_i h_i(x)) - 1) / B_i
//     A_i > 0,  b_i > 0,  beta_i = mean over k of b_ik,  B_i = mean over k of b_ik/deviation_k
// Every summand is the exponential of an increasing linear form of s, so that dE/ds > 0 and E is
// convex in s. For one entropy the temperature at s = mean and h = 0 is Theta sum_i A_i. f and h
// are the outputs of one network of x, with the parameters "<prefix>.body". An ideal gas (f = 0, h
// linear in ln v), a body of constant heat capacity with thermal expansion (h is how far expansion
// shifts its entropy), and sums whose heat capacity rises with temperature have exactly this form.
// Since h is multiplied by beta, it shifts the entropy by an amount that does not depend on the
// heat capacity. The other parameters are "<prefix>.mean" and ".deviation" of the entropies,
// ".unit", ".amplitude", the logarithms of A, and ".exponent", which gives b by exp(exponent) +
// 1e-5.
//
// In all functions `spec` has nthermal > 0, and its last nthermal features are the entropies.
#ifndef PM_MODEL_THERMAL_H
#define PM_MODEL_THERMAL_H

#include "model/network.h"

// Checks the features and declares the parameters. PM_ECONFIG, PM_ENOMEM.
pm_status pm_thermal_declare(const pm_network_spec *spec, const pm_symbols *symbols,
                             pm_params *params, const char *prefix);

// Returns the energy [1][1] in J from the values of all features [1][sum of sizes].
pm_node pm_thermal_build_from(pm_graph *g, const pm_network_spec *spec, pm_node features,
                              const pm_params *params, const char *prefix);

// Returns the standard deviations by which the features are divided, for all features [1][sum of
// sizes].
pm_node pm_thermal_deviation(pm_graph *g, const pm_network_spec *spec, const pm_params *params,
                             const char *prefix);

// Visits the constants that training fixes from the data: means and deviations of the features, and
// the unit. Passes on the status of `visit`.
pm_status pm_thermal_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context);

#endif
