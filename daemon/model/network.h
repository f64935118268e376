// Networks from features to numbers: normalised features, hidden layers, and a linear or quadratic
// skip. Parameters are named "<prefix>.mean", ".deviation", ".layer<i>.weight", ".layer<i>.bias",
// ".output.weight", ".output.bias", ".linear", ".quadratic"; without features ".constant".
#ifndef PM_MODEL_NETWORK_H
#define PM_MODEL_NETWORK_H

#include "model/feature.h"
#include "model/params.h"

// Checks the features and declares the parameters of a network with `nout` outputs; output biases
// (or the constant) start around `start` [nout], or 0 if it is NULL. PM_ECONFIG, PM_ENOMEM.
pm_status pm_network_declare(const pm_network_spec *spec, const pm_symbols *symbols, int nout,
                             const double *start, pm_params *params, const char *prefix);

// The outputs [1][nout], batched unless the network is a constant.
pm_node pm_network_build(pm_graph *g, const pm_network_spec *spec, const pm_symbols *symbols,
                         int nout, const pm_params *params, const char *prefix);

// The same from the features' values [1][sum of sizes]; the network must have features.
pm_node pm_network_build_from(pm_graph *g, const pm_network_spec *spec, pm_node features, int nout,
                              const pm_params *params, const char *prefix);

// The parameter "<prefix>.<name>" as a graph node; it must have been declared.
pm_node pm_network_param(pm_graph *g, const pm_params *params, const char *prefix,
                         const char *name);

// --- constants fixed from the data before training ---

typedef enum pm_normaliser_kind {
    PM_NORMALISE_FEATURES, // "<prefix>.mean", "<prefix>.deviation": of each component
    PM_NORMALISE_SCALE,    // "<prefix>.scale": per component the root mean square pooled over the
                           // expression's components, all divided by their own root mean square
    PM_NORMALISE_ALONG,    // "<prefix>.along": per expression the root mean square of the length
    PM_NORMALISE_PATTERNS, // "<prefix>.patterns" [size][columns]: of one expression the leading
                           // patterns (proper orthogonal decomposition), entries of rms 1
    PM_NORMALISE_FRICTION, // as PM_NORMALISE_SCALE, of an irreversible operator
    PM_NORMALISE_RATE,     // as PM_NORMALISE_SCALE, of rates themselves
    PM_NORMALISE_UNIT      // "<prefix>.unit" [1][1]: a typical energy of the part; the expressions
                           // are the entropies of a thermal energy, or none
} pm_normaliser_kind;

// One set of such constants: expressions over `symbols` whose statistics they are.
typedef struct pm_normaliser {
    pm_normaliser_kind kind;
    const char *prefix;
    int count;
    const char *const *expression;
    const pm_symbols *symbols;
    int nheats; // of an irreversible operator: these groups take up heat (dissipation.h)
    const char *const *heats;
} pm_normaliser;

// Called for every set of a component, in order of declaration.
typedef pm_status pm_normaliser_visit(void *context, const pm_normaliser *normaliser);

#endif
