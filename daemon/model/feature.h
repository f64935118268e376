// Features: expressions of named vectors, which are the inputs of networks and the vectors of
// frames (pm_operator_spec in spec.h).
//   x                          the components of x themselves
//   |x|  ln|x|  |x|^2  <x,y>   one number, invariant under rotations
//   |x-y|  ln|x-y|             the length of a difference, also invariant
//   |min(x,0)|  |min(x,0)|^2   the length of the negative components of x: zero, with a zero slope,
//                              while no component is negative
//   sin(x)  cos(x)             of each component of x, an angle, in rad or in its unit (deg)
//   ln(x)                      ln|x_i| of each component of x
//   x/|x|  x/|x|^2             vectors along x
// The names are those of groups, with a prefix where there are two ends ("a.q"), and of co-energies
// ("dE.s", "a.dE.s"). A new expression is one line in the table of feature.c.
#ifndef PM_MODEL_FEATURE_H
#define PM_MODEL_FEATURE_H

#include "graph/graph.h"
#include "model/spec.h"

// The most symbols of an expression: those of both ends of a port, the learned constants, and the
// forces of an operator.
#define PM_MAX_SYMBOLS (6 * PM_MAX_GROUPS + PM_MAX_LEARNED + 1)
#define PM_MAX_NAME 64

// A named vector [1][size] that an expression may use. `node` is PM_NO_NODE while a spec is only
// being checked.
typedef struct pm_symbol {
    char name[PM_MAX_NAME];
    int size;
    pm_node node;
    double radians; // of one unit of an angle; 1 for all else
} pm_symbol;

typedef struct pm_symbols {
    int count;
    pm_symbol symbol[PM_MAX_SYMBOLS];
} pm_symbols;

// Adds every group of `layout` as "<prefix><group>", a slice of `vector` [1][layout->nz]. Where the
// vector is PM_NO_NODE the symbols are zero. g is NULL while a spec is only being checked.
void pm_symbols_add(pm_symbols *symbols, pm_graph *g, const pm_layout *layout, const char *prefix,
                    pm_node vector);

// Adds one symbol. The name is copied.
void pm_symbols_add_one(pm_symbols *symbols, const char *name, int size, pm_node node);

// Returns true if the name occurs in the expression as a whole word.
bool pm_feature_mentions(const char *expression, const char *name);

// Computes the number of components of an expression. PM_ECONFIG: the form or a name is unknown
// (the message lists the known ones), or two vectors differ in size.
pm_status pm_feature_size(const char *expression, const pm_symbols *symbols, int *size);

// Returns the value of the expression [1][size], which must have passed pm_feature_size.
pm_node pm_feature_build(pm_graph *g, const char *expression, const pm_symbols *symbols);

// --- discrete derivatives, between two states ---

// Returns true if every expression of the list has a discrete derivative. Scalar expressions, x
// itself, sin(x) and cos(x) have one; x/|x| and x/|x|^2 have none.
bool pm_features_are_discrete(int count, const char *const *expression);

// Adds to covector[i] [1][size of symbol i] (PM_NO_NODE: zero so far) the discrete derivative of
// sum weight . features between the states of `from` and `to`, which list the same symbols. Every
// feature f satisfies  D f . (x_to - x_from) = f(x_to) - f(x_from)  (Gonzalez, J. Nonlinear Sci. 6
// (1996) 449). weight: [1][sum of sizes].
void pm_features_discrete(pm_graph *g, int count, const char *const *expression,
                          const pm_symbols *from, const pm_symbols *to, pm_node weight,
                          pm_node *covector);

// Returns the reciprocal (ln b - ln a) / (b - a) of the logarithmic mean of two positive numbers
// [1][1]. It is accurate also where a = b. The result is the divided difference of ln between a and
// b; its reciprocal is the divided difference of exp between ln a and ln b.
pm_node pm_inverse_logarithmic_mean(pm_graph *g, pm_node a, pm_node b);

// Returns the divided difference of sin or cos, component by component, between a and b.
pm_node pm_trigonometric_difference(pm_graph *g, bool sine, pm_node a, pm_node b);

// Returns, for each component, the divided difference of min(x,0)^2 between `from` and `to`, all
// [1][n].
pm_node pm_negative_squared_slope(pm_graph *g, pm_node from, pm_node to);

// Compute the size of a list of expressions, and their values side by side, [1][sum of sizes].
// PM_ECONFIG: as pm_feature_size, or there are more than PM_MAX_FEATURES expressions.
pm_status pm_features_size(int count, const char *const *expression, const pm_symbols *symbols,
                           int *size);
pm_node pm_features_build(pm_graph *g, int count, const char *const *expression,
                          const pm_symbols *symbols);

#endif
