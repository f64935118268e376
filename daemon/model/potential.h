// Scalar potentials E and S: a known linear form plus a sum of networks.
#ifndef PM_MODEL_POTENTIAL_H
#define PM_MODEL_POTENTIAL_H

#include "model/network.h"

bool pm_potential_exists(const pm_potential_spec *spec);

// Checks groups and features and declares the parameters, "<prefix>.<term>.<...>". Given groups are
// symbols like those in features.
pm_status pm_potential_declare(const pm_potential_spec *spec, const pm_symbols *symbols,
                               pm_params *params, const char *prefix);

// The potential [1][1]; PM_NO_NODE if it does not exist.
pm_node pm_potential_build(pm_graph *g, const pm_potential_spec *spec, const pm_symbols *symbols,
                           const pm_params *params, const char *prefix);

pm_status pm_potential_visit(const pm_potential_spec *spec, const pm_symbols *symbols,
                             const char *prefix, pm_normaliser_visit *visit, void *context);

#endif
