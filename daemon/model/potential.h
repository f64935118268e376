// Scalar potentials E and S: sums of formulas, a known linear form and networks.
#ifndef PM_MODEL_POTENTIAL_H
#define PM_MODEL_POTENTIAL_H

#include "model/formula.h"
#include "model/network.h"

bool pm_potential_exists(const pm_potential_spec *spec);
// Whether a summand names this group or image.
bool pm_potential_mentions(const pm_potential_spec *spec, const char *name);

// Checks groups and features and declares the parameters, "<prefix>.<term>.<...>". Given groups are
// symbols like those in features.
pm_status pm_potential_declare(const pm_potential_spec *spec, const pm_symbols *symbols,
                               pm_params *params, const char *prefix);

// The potential [1][1]; PM_NO_NODE if it does not exist.
pm_node pm_potential_build(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *symbols,
                           const pm_params *params, const char *prefix);

// Its discrete derivative between the states of `from` and `to`, as covector[i] per symbol
// (starting at PM_NO_NODE): the partial derivatives of each network at the mean of its features,
// carried to the states by the features' own discrete derivatives, and corrected along the change
// of the features (Gonzalez, J. Nonlinear Sci. 6, 1996), so that D . (z_to - z_from) = E_to -
// E_from for any network.
void pm_potential_discrete(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *from,
                           const pm_symbols *to, const pm_params *params, const char *prefix,
                           pm_node *covector);
bool pm_potential_is_discrete(const pm_potential_spec *spec);

pm_status pm_potential_visit(const pm_potential_spec *spec, const pm_symbols *symbols,
                             const char *prefix, pm_normaliser_visit *visit, void *context);

#endif
