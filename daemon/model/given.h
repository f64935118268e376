// Known couplings of an operator, pairs of groups or of their components (spec.h): reversible pairs
// and cross products, irreversible pairs of a variable with an entropy, and friction by a
// difference of two flows.
#ifndef PM_MODEL_GIVEN_H
#define PM_MODEL_GIVEN_H

#include "graph/graph.h"
#include "model/support.h"

// Whether a pair names the group, or a component of it.
bool pm_given_names(const pm_operator_spec *spec, const char *group);
// Whether pair i of an irreversible operator is friction by a difference: neither of its groups
// takes up heat, and there is one that does.
bool pm_given_is_difference(const pm_operator_spec *spec, int i, const pm_site *site);

// Names, sizes, coefficients and formulas of all pairs; `what` names the operator. PM_ECONFIG.
pm_status pm_given_check(const pm_operator_spec *spec, bool reversible, const pm_site *site,
                         const char *what);

// The rates over the support (PM_NO_NODE: none), for the driving d and the normal n over it.
// Reversible: rate_row += c d_col, rate_col -= c d_row; cross: rate_row += z_col x d_col and, of
// different groups, rate_col += z_col x d_row.
pm_node pm_given_reversible(pm_graph *g, const pm_operator_spec *spec, const pm_site *site,
                            const pm_support *support, pm_node d);
// Irreversible, degenerate by themselves: with an entropy
//     rate_row += c (d_row - d_col n_row/n_col),  rate_col -= rate_row . n_row/n_col;
// by a difference f = n_row - n_col, with N components that take up heat,
//     rate_row -= c f,  rate_col += c f,  rate_k += c f . f/(N n_k).
pm_node pm_given_irreversible(pm_graph *g, const pm_operator_spec *spec, const pm_site *site,
                              const pm_support *support, pm_node d, pm_node n);

#endif
