// Formulas: known scalar expressions of named vectors and constants, as text.
//     "|p|^2/(2*m) + m*g*q[1]"     "c*Tr*(exp((s - b*ln(|q|/l0))/c) - 1)"
// Numbers, constants, names of one component, components q[0] of vectors (counted from 0), the
// invariants |q|, <q,p> and |min(q,0)|, the length of what is negative in q; + - * / ^ and
// brackets; exp, ln, sqrt. An exponent is a number; of one that is not whole the base must be
// positive. In |min(x,0)|^2 x may be made of vectors of equal size, component by component:
//     "k/2*|min(g + u*v, 0)|^2"
//
// A formula is a model like any other: its derivatives come from the graph, and it has a discrete
// derivative, made by the chain rule from the divided differences of its operations.
#ifndef PM_MODEL_FORMULA_H
#define PM_MODEL_FORMULA_H

#include "model/feature.h"

// Whether it can be read and names nothing but what there is. PM_ECONFIG: at the formula's place.
pm_status pm_formula_check(const pm_formula *formula, const pm_symbols *symbols);

// The value [1][1]; the formula must have passed pm_formula_check.
pm_node pm_formula_build(pm_graph *g, const pm_formula *formula, const pm_symbols *symbols);

// Adds its discrete derivative between the states of `from` and `to` to covector[i], as
// pm_features_discrete does: D . (z_to - z_from) = f(z_to) - f(z_from), D symmetric in both states.
// (To rounding, if no argument of exp, ln or a broken power changes by more than a factor of 2.)
void pm_formula_discrete(pm_graph *g, const pm_formula *formula, const pm_symbols *from,
                         const pm_symbols *to, pm_node *covector);

// Whether the formula mentions the group, or its co-energies.
bool pm_formula_mentions(const pm_formula *formula, const char *group);

#endif
