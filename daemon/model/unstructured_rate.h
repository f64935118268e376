// The free form: a rate that is directly the output of a network, without energy, entropy or
// structure; what the other two forms are compared with.
//     rate = scale * network(features)
// The scales make the units of the groups comparable. On a mesh the network is one of message.h.
#ifndef PM_MODEL_UNSTRUCTURED_RATE_H
#define PM_MODEL_UNSTRUCTURED_RATE_H

#include "model/operator.h"

// Checks the features and declares the parameters "<prefix>.scale" and those of the network.
// PM_ECONFIG, PM_ENOMEM.
pm_status pm_unstructured_rate_declare(const pm_network_spec *spec, const pm_site *site,
                                       pm_params *params, const char *prefix);

// The rate [1][site->n].
pm_node pm_unstructured_rate_build(pm_graph *g, const pm_network_spec *spec, const pm_site *site,
                                   const pm_params *params, const char *prefix);

pm_status pm_unstructured_rate_visit(const pm_network_spec *spec, const pm_site *site,
                                     const char *prefix, pm_normaliser_visit *visit, void *context);

#endif
