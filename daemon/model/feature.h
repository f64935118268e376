// Features: expressions over named vectors, the inputs of networks and the vectors of frames.
//   x          the components of x themselves
//   |x|  ln|x|  |x|^2  <x,y>    invariants under rotation: one number
//   |min(x,0)|  |min(x,0)|^2   length of what is negative in x: exactly flat where nothing is
//   x/|x|  x/|x|^2              vectors along x
// Names are those of groups, with a prefix where there are two ends ("a.q"), or of co-energies
// ("dE.s", "a.dE.s"). To add an expression: one line in the table of feature.c.
#ifndef PM_MODEL_FEATURE_H
#define PM_MODEL_FEATURE_H

#include "graph/graph.h"
#include "model/spec.h"

// As many as two ends of a port have, and learned constants.
#define PM_MAX_SYMBOLS (6 * PM_MAX_GROUPS + PM_MAX_LEARNED)
#define PM_MAX_NAME 64

// The named vectors [1][size] an expression may use. `node` is PM_NO_NODE while a spec is only
// being checked.
typedef struct pm_symbol {
    char name[PM_MAX_NAME];
    int size;
    pm_node node;
} pm_symbol;

typedef struct pm_symbols {
    int count;
    pm_symbol symbol[PM_MAX_SYMBOLS];
} pm_symbols;

// Adds every group of `layout` as "<prefix><group>", a slice of `vector` [1][layout->nz] (or
// PM_NO_NODE: zero).
void pm_symbols_add(pm_symbols *symbols, pm_graph *g, const pm_layout *layout, const char *prefix,
                    pm_node vector);

// Adds one more.
void pm_symbols_add_one(pm_symbols *symbols, const char *name, int size, pm_node node);

// Whether an expression is one of this name.
bool pm_feature_mentions(const char *expression, const char *name);

// The number of components of an expression. PM_ECONFIG: unknown form or name (the error lists what
// there is).
pm_status pm_feature_size(const char *expression, const pm_symbols *symbols, int *size);

// The expression's value [1][size]; it must have passed pm_feature_size.
pm_node pm_feature_build(pm_graph *g, const char *expression, const pm_symbols *symbols);

// --- discrete derivatives, between two states ---

// Whether every expression of a list has a discrete derivative: the scalar ones and x itself.
bool pm_features_are_discrete(int count, const char *const *expression);

// Adds to covector[i] [1][size of symbol i] (PM_NO_NODE: zero so far) the discrete derivative of
// sum weight . features between the states of `from` and `to`, which list the same symbols. For
// every feature f it satisfies  D f . (x_to - x_from) = f(x_to) - f(x_from)  (Gonzalez, J.
// Nonlinear Sci. 6 (1996) 449). weight: [1][sum of sizes].
void pm_features_discrete(pm_graph *g, int count, const char *const *expression,
                          const pm_symbols *from, const pm_symbols *to, pm_node weight,
                          pm_node *covector);

// The reciprocal of the logarithmic mean (b - a) / (ln b - ln a) of two positive numbers [1][1],
// accurate also where a = b: the divided difference of ln, and of exp its inverse.
pm_node pm_inverse_logarithmic_mean(pm_graph *g, pm_node a, pm_node b);

// The sum of the squares of what is negative in x [1][n], and its divided differences [1][n] from
// one x to another, component by component.
pm_node pm_negative_squared(pm_graph *g, pm_node x);
pm_node pm_negative_squared_slope(pm_graph *g, pm_node from, pm_node to);

// Sizes and values of a list of at most PM_MAX_FEATURES, side by side: [1][sum of sizes].
pm_status pm_features_size(int count, const char *const *expression, const pm_symbols *symbols,
                           int *size);
pm_node pm_features_build(pm_graph *g, int count, const char *const *expression,
                          const pm_symbols *symbols);

#endif
