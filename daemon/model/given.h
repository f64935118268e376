// The given pairs of an operator: couplings with a known coefficient between two groups of a site,
// or between two of their components (pm_given_pair in spec.h). They are part of L or M of equation
// (1), and of the operators of a port in equation (3).
#ifndef PM_MODEL_GIVEN_H
#define PM_MODEL_GIVEN_H

#include "graph/graph.h"
#include "model/given_pair.h"
#include "model/support.h"

// Checks names, sizes and signs of all pairs against the site. `what` names the operator in error
// messages. PM_ECONFIG. pm_formula_check checks the formulas.
pm_status pm_given_check(const pm_operator_spec *spec, bool reversible, const pm_site *site,
                         const char *what);

// Returns the rate [1][support->n] of all reversible pairs for the driving co-energies d
// [1][support->n], or PM_NO_NODE if there is no pair. A pair with coefficient c adds
//     rate_row += c d_col,  rate_col -= c d_row
// and a cross product of three components each, for a state z,
//     rate_row += z_col x d_col  and, where the groups differ,  rate_col += z_col x d_row.
// Each sum does no work: d . rate = 0.
pm_node pm_given_reversible(pm_graph *g, const pm_operator_spec *spec, const pm_site *site,
                            const pm_support *support, pm_node d);
// Returns the rate [1][support->n] of all irreversible pairs for the driving d = dS and the normal
// n = dE, both [1][support->n], or PM_NO_NODE if there is no pair. A pair of a variable and an
// entropy adds
//     rate_row += c (d_row - d_col n_row/n_col),  rate_col -= rate_row . n_row/n_col
// and friction by the difference f = n_row - n_col, whose heat N components k take up, adds
//     rate_row -= c f,  rate_col += c f,  rate_k += c f . f/(N n_k).
// Every pair is degenerate by itself, n . rate = 0, and produces entropy for c >= 0.
pm_node pm_given_irreversible(pm_graph *g, const pm_operator_spec *spec, const pm_site *site,
                              const pm_support *support, pm_node d, pm_node n);

#endif
