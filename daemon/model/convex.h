// Terms of a co-energy C that are convex for all weights (pm_convex_spec in spec.h).
//
// An inertia of the flows y is C = |A^T D y|^2/2. A is lower triangular, and its diagonal is
// exp(f), so that it is positive; f and the entries below are the outputs of a network, row by row.
// D = diag(1/l) divides each group by its typical length l in the data. If the inertia of the first
// component is known, the first entry of A is l times the root of it.
//
// A heat capacity is, with r = T/T0 and the mean T0 of the data,
//     c(T) = c_0 sum_k w_k f_k(r),   f_k = 1, r, 2r/(1 + r), 1/r^2, r^2,   c_0 > 0, w_k > 0
// where the weights w_k have the sum 1, so that c is c_0 at T0. It is positive for all T > 0, and
// the entropy s = dC/dT and the energy T s - C are explicit.
#ifndef PM_MODEL_CONVEX_H
#define PM_MODEL_CONVEX_H

#include "model/network.h"

#define PM_MAX_INERTIA 8 // components that share an inertia
#define PM_MAX_TERMS 5   // of a heat capacity

// The parameters of convex term number i of the potential `potential` are
// "<potential>.inertia.<i>.<...>" or "<potential>.capacity.<i>.<...>".

// Checks all names against the symbols and declares the parameters. PM_ECONFIG, PM_ENOMEM.
pm_status pm_convex_declare(const pm_convex_spec *spec, int i, const pm_symbols *symbols,
                            pm_params *params, const char *potential);

// Returns the term [1][1] in J.
pm_node pm_convex_build(pm_graph *g, const pm_convex_spec *spec, int i, const pm_symbols *symbols,
                        const pm_params *params, const char *potential);

// Visits the constants that training fixes from the data (network.h). Passes on the status of
// `visit`.
pm_status pm_convex_visit(const pm_convex_spec *spec, int i, const pm_symbols *symbols,
                          const char *potential, pm_normaliser_visit *visit, void *context);

#endif
