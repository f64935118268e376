// Energies whose temperature and heat capacity are positive for all weights. The energy is a
// function of the entropies s and of other features x:
//     E = unit f(x) + Theta w sum_i A_i H_i/B_i
//     H_i = exp(u_i) - 1 - y_i - y_i^2/2
//     u_i = b_i . (s - mean)/deviation + y_i,   y_i = beta_i h_i(x)
//     A_i > 0,   sum_i A_i = 1,   b_i > 0
//     beta_i = mean over k of b_ik,   B_i = mean over k of b_ik/deviation_k
// Here i counts the exponentials and k the entropies. Theta is `temperature` of the spec, in K. The
// factor w of Theta is learned, starts at 1, and is one number for the whole system (see below).
// Every summand contains the exponential of an increasing linear form of s, so that dE/ds > 0 and E
// is convex in s. For one entropy the temperature at s = mean and h = 0 is Theta w. f and h are the
// outputs of one network of x, whose parameters have names that begin with "<prefix>.body". A body
// of constant heat capacity with thermal expansion (h is how far expansion shifts its entropy), an
// ideal gas (h linear, f quadratic in ln v), and sums whose heat capacity falls with temperature
// have exactly this form. Since h is multiplied by beta, it shifts the entropy by an amount that
// does not depend on the heat capacity.
//
// With `rising` of the spec heat capacities may also rise with the temperature, as those of metals
// do:
//     H_i = (1 + k_i)/k_i ln((1 + k_i exp(u_i))/(1 + k_i)) - y_i - y_i^2/2/(1 + k_i),   k_i > 0
// where k -> 0 is the exponential. It is convex and rises in u as well, with the slope 1 at u = 0,
// and the heat capacity of one summand is (1 + k exp(u))/b.
//
// With `separate` of the spec every component of the entropies has exponentials of its own, and E
// is the sum over the components k of
//     Theta w sum_i A_ik H_ik/B_ik,   H_ik as above with b_ik (s_k - mean_k)/deviation_k + y_ik,
//     beta_ik = b_ik,   B_ik = b_ik/deviation_k,   sum_i A_ik = 1
// These are bodies that have nothing but x in common, such as the segments of a rod. Each has a
// temperature and a heat capacity of its own, and at s = mean and h = 0 all have the temperature
// Theta w.
//
// The data of bodies that are coupled by conduction and by reversible forces determine their
// temperatures only up to a common offset: E + c S with one c for all bodies has the same L dE, and
// conduction depends on the ratios of temperatures. Therefore w is one weight of the whole system
// (network.h). To third order in s and h, a change of w changes that common offset alone, for two
// reasons. First, b_i = exp(exponent_i)/w, so that the slope dT/ds does not depend on w. Second,
// the terms -1 - y - y^2/2 keep a change of w or h from changing the energy at s = mean, which f
// should describe. Conductances are proportional to w, too (dissipation.h).
//
// The other parameters are "<prefix>.mean" and ".deviation" of the entropies, ".unit",
// ".amplitude", of which A is the softmax, ".exponent", and with `rising` ".bend", of which k is
// the square. A single exponential has no ".amplitude".
//
// In all functions `spec` has nthermal > 0, and its last nthermal features are the entropies.
// `prefix` is the beginning of the names of all parameters of this energy. A "[1][sum of sizes]"
// holds the components of all features of `spec` side by side, in the order of the spec.
#ifndef PM_MODEL_THERMAL_H
#define PM_MODEL_THERMAL_H

#include "model/network.h"

// Checks the features of `spec` and declares the parameters in `params`. PM_ECONFIG: a feature is
// not valid for these symbols; PM_ENOMEM.
pm_status pm_thermal_declare(const pm_network_spec *spec, const pm_symbols *symbols,
                             pm_params *params, const char *prefix);

// Returns the energy [1][1], J, as a node of g, never PM_NO_NODE. `features` [1][sum of sizes]
// holds the values of the features.
pm_node pm_thermal_build_from(pm_graph *g, const pm_network_spec *spec, pm_node features,
                              const pm_params *params, const char *prefix);

// Returns the standard deviations [1][sum of sizes] by which the features are divided, in the units
// of the features, as a node of g, never PM_NO_NODE.
pm_node pm_thermal_deviation(pm_graph *g, const pm_network_spec *spec, const pm_params *params,
                             const char *prefix);

// Calls `visit` with `context` for the constants that training fixes from the data: the means and
// deviations of the features, and the unit. Returns the first status of `visit` that is not PM_OK.
pm_status pm_thermal_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context);

#endif
