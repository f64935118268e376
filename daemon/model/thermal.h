// Energies whose temperature and heat capacity are positive whatever the weights. Of the entropies
// s and other features x
//     E = unit f(x) + Theta sum_i exp(g_i(x)) (exp(b_i . (s - mean)/deviation) - 1) / B_i,   b_i >
//     0 B_i = mean over the entropies of b_ik / deviation_k
// so that dE/ds > 0 and E is convex in s: every summand is the exponential of a rising linear form.
// At the mean of s the temperature of one entropy is Theta sum_i exp(g_i). f and g are the outputs
// of one network of x, "<prefix>.body". An ideal gas (g linear in ln v), a body of constant heat
// capacity, and mixtures whose heat capacity rises with temperature are of this form exactly.
// Parameters beside the body's: "<prefix>.mean", ".deviation" of the entropies, ".unit",
// ".exponent" (the logarithms of b).
#ifndef PM_MODEL_THERMAL_H
#define PM_MODEL_THERMAL_H

#include "model/network.h"

// As pm_network_declare with one output, for a spec with nthermal > 0.
pm_status pm_thermal_declare(const pm_network_spec *spec, const pm_symbols *symbols,
                             pm_params *params, const char *prefix);

// The energy [1][1] from the values of all features, the entropies last.
pm_node pm_thermal_build_from(pm_graph *g, const pm_network_spec *spec, pm_node features,
                              const pm_params *params, const char *prefix);

// The deviations of all features side by side.
pm_node pm_thermal_deviation(pm_graph *g, const pm_network_spec *spec, const pm_params *params,
                             const char *prefix);

pm_status pm_thermal_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context);

#endif
