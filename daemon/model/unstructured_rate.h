// The free form: a rate that is the output of a network, without energy, entropy or structure. The
// other forms are compared with it.
//     rate = scale * network(features)
// The scale [1][n] makes the units of the groups comparable. The site (site.h) lists the groups
// whose rate is built and the symbols that features may name.
#ifndef PM_MODEL_UNSTRUCTURED_RATE_H
#define PM_MODEL_UNSTRUCTURED_RATE_H

#include "model/operator.h"

// Checks the features and declares the parameters "<prefix>.scale" and those of the network.
// PM_ECONFIG, PM_ENOMEM.
pm_status pm_unstructured_rate_declare(const pm_network_spec *spec, const pm_site *site,
                                       pm_params *params, const char *prefix);

// Returns the rate [1][site->n], in the units of the groups per second.
pm_node pm_unstructured_rate_build(pm_graph *g, const pm_network_spec *spec, const pm_site *site,
                                   const pm_params *params, const char *prefix);

// Visits the constants that training fixes from the data: the scales, and those of the network.
// Passes on the status of `visit`.
pm_status pm_unstructured_rate_visit(const pm_network_spec *spec, const pm_site *site,
                                     const char *prefix, pm_normaliser_visit *visit, void *context);

#endif
