// Multi-layer networks from features to numbers. With x = (features - mean) / deviation,
//     output = W_n act(... act(W_0 x + b_0) ...) + b + linear x + quadratic (x x^T)
// where the last two terms depend on the skip (spec.h). The parameters are "<prefix>.mean",
// ".deviation", ".layer<i>.weight", ".layer<i>.bias", ".output.weight", ".output.bias", ".linear",
// ".quadratic". A network without features is one learned constant, "<prefix>.constant".
//
// Thermal energies are in thermal.h; the functions here take specs with nthermal = 0.
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

// --- constants that training fixes from the data before it changes the weights ---

typedef enum pm_normaliser_kind {
    // "<prefix>.mean" and "<prefix>.deviation": mean and standard deviation of each component.
    PM_NORMALISE_FEATURES,
    // "<prefix>.scale": the scales of a reversible operator (operator.h), one number for each
    // component, equal within a group. The expressions are the operator's groups. The trainer
    // chooses scales with which matrix entries of size 1 give rates as large as those of the data.
    // If the trainer does not know the rates, it takes the root mean square of each group, relative
    // to that of all components.
    PM_NORMALISE_SCALE,
    // "<prefix>.along": for each expression the root mean square of its length.
    PM_NORMALISE_ALONG,
    // "<prefix>.scale" of an irreversible operator, chosen as for a reversible one.
    PM_NORMALISE_FRICTION,
    // "<prefix>.scale" of an unstructured rate: the sizes of the groups' rates in the data, or root
    // mean squares as above where the rates are not known.
    PM_NORMALISE_RATE,
    // "<prefix>.unit" [1][1]: a typical energy of the part in J. For an entropy it is this energy
    // divided by PM_DEFAULT_TEMPERATURE. The expressions are not used.
    PM_NORMALISE_UNIT
} pm_normaliser_kind;

// A set of constants of one kind. The trainer computes it from the statistics of expressions over
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

// Visits the statistics of the features of a network; one without features has none.
pm_status pm_network_visit(const pm_network_spec *spec, const pm_symbols *symbols,
                           const char *prefix, pm_normaliser_visit *visit, void *context);

// The warmth is a weight [1][1] that all components of a system share: the logarithm of a factor of
// all learned temperatures. Conduction depends on ratios of temperatures, so that the data
// determine this factor only weakly. PM_WARMTH is the name of the parameter; pm_warmth returns it
// as a node.
#define PM_WARMTH "warmth"
pm_node pm_warmth(pm_graph *g, const pm_params *params);

#endif
