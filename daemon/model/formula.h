// Formulas: known scalar expressions of named vectors and constants, as text.
//     "|p|^2/(2*m) + m*g*q[1]"     "c*Tr*(exp((s - b*ln(|q|/l0))/c) - 1)"
// A formula consists of numbers, constants, names of one component, components q[0] of vectors
// (counted from 0), the invariants |q|, <q,p> and |min(q,0)| (the length of the negative components
// of q), the operations + - * / ^, brackets, and the functions exp, ln, sqrt, sin and cos (of an
// angle in rad). An exponent is a number; if it is not an integer, the base must be positive. In
// |min(x,0)|^2 x may be an expression of vectors of equal size, evaluated component by component:
//     "k/2*|min(g + u*v, 0)|^2"
//
// The graph gives the derivatives of a formula. Its discrete derivative follows by the chain rule
// from the divided differences of its operations.
#ifndef PM_MODEL_FORMULA_H
#define PM_MODEL_FORMULA_H

#include "model/feature.h"

// Checks that the text is a formula of these symbols and of the formula's constants. PM_ECONFIG;
// the message begins with the place of the formula in its file.
pm_status pm_formula_check(const pm_formula *formula, const pm_symbols *symbols);

// Returns the value [1][1] of a formula that has passed pm_formula_check.
pm_node pm_formula_build(pm_graph *g, const pm_formula *formula, const pm_symbols *symbols);

// Adds the discrete derivative D between the states of `from` and `to` to covector[i] [1][size of
// symbol i], as pm_features_discrete does. D satisfies D . (z_to - z_from) = f(z_to) - f(z_from),
// and does not change if the two states are exchanged. The equation holds to rounding if no
// argument of exp, ln or a fractional power changes by more than a factor of 2.
void pm_formula_discrete(pm_graph *g, const pm_formula *formula, const pm_symbols *from,
                         const pm_symbols *to, pm_node *covector);

// Returns true if the formula names the group or its co-energies.
bool pm_formula_mentions(const pm_formula *formula, const char *group);

#endif
