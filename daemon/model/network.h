// Multi-layer networks from features to numbers. With x = (features - mean) / deviation,
//     output = W_n act(... act(W_0 x + b_0) ...) + b + linear x + quadratic (x x^T)
// where the last two terms depend on the skip (spec.h). The parameters are "<prefix>.mean",
// ".deviation", ".layer<i>.weight", ".layer<i>.bias", ".output.weight", ".output.bias", ".linear",
// ".quadratic". A network without features is one learned constant, "<prefix>.constant".
//
// Networks on meshes are in mesh/message.h, thermal energies in thermal.h; the functions here take
// specs without a message and with nthermal = 0.
#ifndef PM_MODEL_NETWORK_H
#define PM_MODEL_NETWORK_H

#include "model/feature.h"
#include "model/params.h"

// Checks the features and declares the parameters of a network with `nout` outputs. The output
// biases, or the constant, start around `start` [nout], or around 0 if it is NULL. PM_ECONFIG,
// PM_ENOMEM.
pm_status pm_network_declare(const pm_network_spec *spec, const pm_symbols *symbols, int nout,
                             const double *start, pm_params *params, const char *prefix);

// Returns the outputs [1][nout], batched unless the network is a constant.
pm_node pm_network_build(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                         int nout, const pm_params *params, const char *prefix);

// Returns the outputs [1][nout] from the values of the features [1][sum of sizes]. The network must
// have features.
pm_node pm_network_build_from(pm_graph *g, const pm_network_spec *spec, pm_node features, int nout,
                              const pm_params *params, const char *prefix);

// Returns the parameter "<prefix>.<name>", which must have been declared, as a node of g.
pm_node pm_network_param(pm_graph *g, const pm_params *params, const char *prefix,
                         const char *name);

// --- constants that training fixes from the data before it changes weights ---

typedef enum pm_normaliser_kind {
    PM_NORMALISE_FEATURES, // "<prefix>.mean", "<prefix>.deviation": of each component
    PM_NORMALISE_SCALE,    // "<prefix>.scale": for each component the root mean square pooled over
                           // the components of its expression, all divided by their own root mean
                           // square
    PM_NORMALISE_ALONG, // "<prefix>.along": for each expression the root mean square of its length
    PM_NORMALISE_PATTERNS, // "<prefix>.patterns" [size][columns]: the leading patterns of one
                           // expression (proper orthogonal decomposition), entries of rms 1
    PM_NORMALISE_FRICTION, // like PM_NORMALISE_SCALE, for an irreversible operator
    PM_NORMALISE_RATE,     // like PM_NORMALISE_SCALE, of the rates instead of the expressions
    PM_NORMALISE_UNIT      // "<prefix>.unit" [1][1]: a typical energy of the part in J; the
                           // expressions are the entropies of a thermal energy, or none
} pm_normaliser_kind;

// One set of such constants. The trainer computes it from the statistics of expressions over
// `symbols`. All pointers are borrowed and valid during the call of the visitor.
typedef struct pm_normaliser {
    pm_normaliser_kind kind;
    const char *prefix;
    int count;
    const char *const *expression; // [count]
    const pm_symbols *symbols;
    int nheats;               // of an irreversible operator: the groups that take up heat
    const char *const *heats; // [nheats] (dissipation.h)
} pm_normaliser;

// A function that is called for every set of constants of a component, in the order of declaration.
// If it fails, the visit ends with its status.
typedef pm_status pm_normaliser_visit(void *context, const pm_normaliser *normaliser);

// The name of a weight [1][1] that all components of a system share: the logarithm of a factor of
// all learned temperatures. Conduction depends on their ratios, so that the data determine their
// common size only weakly.
#define PM_WARMTH "warmth"
pm_node pm_warmth(pm_graph *g, const pm_params *params);

#endif
