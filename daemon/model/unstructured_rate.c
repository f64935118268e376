// A scaled network over the groups of a site.
#include "model/unstructured_rate.h"

#include <stdio.h>

pm_status pm_unstructured_rate_declare(const pm_network_spec *spec, const pm_site *site,
                                       pm_params *params, const char *prefix) {
    char name[96];
    snprintf(name, sizeof name, "%s.scale", prefix);
    PM_TRY(pm_params_add(params, name, 1, site->n, false, 0, 1));
    return pm_network_declare(spec, &site->symbols, site->n, NULL, params, prefix);
}

pm_node pm_unstructured_rate_build(pm_graph *g, const pm_network_spec *spec, const pm_site *site,
                                   const pm_params *params, const char *prefix) {
    const pm_node rate = pm_network_build(g, spec, &site->symbols, site->n, params, prefix);
    return pm_mul(g, rate, pm_network_param(g, params, prefix, "scale"));
}

pm_status pm_unstructured_rate_visit(const pm_network_spec *spec, const pm_site *site,
                                     const char *prefix, pm_normaliser_visit *visit,
                                     void *context) {
    const char *group[2 * PM_MAX_GROUPS];
    for (int i = 0; i < site->ngroup; ++i) {
        group[i] = site->group[i].name;
    }
    const pm_normaliser scale = {.kind = PM_NORMALISE_RATE,
                                 .prefix = prefix,
                                 .count = site->ngroup,
                                 .expression = group,
                                 .symbols = &site->symbols};
    PM_TRY(visit(context, &scale));
    return pm_network_visit(spec, &site->symbols, prefix, visit, context);
}
