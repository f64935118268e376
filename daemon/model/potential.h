// The scalar potentials E and S of equation (1), and co-energies (part.h). A potential is a sum of
// formulas, of a known linear form of the state, of networks, and of convex terms.
#ifndef PM_MODEL_POTENTIAL_H
#define PM_MODEL_POTENTIAL_H

#include "model/formula.h"
#include "model/network.h"

// Returns true if the potential has a summand of any kind.
bool pm_potential_exists(const pm_potential_spec *spec);
// Returns true if a summand names this group or derived variable.
bool pm_potential_mentions(const pm_potential_spec *spec, const char *name);

// Checks all names against the symbols and declares the parameters "<prefix>.<term>.<...>".
// PM_ECONFIG, PM_ENOMEM.
pm_status pm_potential_declare(const pm_potential_spec *spec, const pm_symbols *symbols,
                               pm_params *params, const char *prefix);

// Returns the potential [1][1] in J or J/K, or PM_NO_NODE if it does not exist.
pm_node pm_potential_build(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *symbols,
                           const pm_params *params, const char *prefix);

// Adds the discrete derivative D between the states of `from` and `to` to covector[i] [1][size of
// symbol i]. The caller sets every covector to PM_NO_NODE before. For any network D satisfies
//     D . (z_to - z_from) = E_to - E_from.
// D takes the derivative of the network at the mean of its features, corrects it along the change
// of the features, and carries it to the states by the discrete derivatives of the features
// (Gonzalez, J. Nonlinear Sci. 6 (1996) 449). The spec must pass pm_potential_is_discrete.
void pm_potential_discrete(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *from,
                           const pm_symbols *to, const pm_params *params, const char *prefix,
                           pm_node *covector);
// Returns true if all summands have discrete derivatives.
bool pm_potential_is_discrete(const pm_potential_spec *spec);

// Visits the constants of all networks, which training fixes from the data (network.h). Passes on
// the status of `visit`.
pm_status pm_potential_visit(const pm_potential_spec *spec, const pm_symbols *symbols,
                             const char *prefix, pm_normaliser_visit *visit, void *context);

#endif
