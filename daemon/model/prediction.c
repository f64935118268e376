// Newton's method along the direction in which the exchange still has to change.
#include "model/prediction.h"

#include <stdio.h>
#include <string.h>

// Keeps the slope finite where the exchange has nothing left to change.
#define SMALLEST_CHANGE 1e-100

bool pm_port_responds(const pm_port_model *port, pm_end end, const char *group) {
    const pm_operator_spec *M = &port->spec.irreversible;
    char name[PM_MAX_NAME];
    snprintf(name, sizeof name, "%s%s", end == PM_END_A ? "a." : "b.", group);
    for (int i = 0; i < M->nacts && port->law->irreversible != NULL; ++i) {
        if (strcmp(M->acts_on[i], name) == 0) {
            return true;
        }
    }
    return false;
}

// The rate solves r = f(e + R (r - last)), R the response: with the change d = f(e) - last and
// J = df/de, r - last = (1 - J R)^-1 d, taken along d. Measured by the power it moves, R d . d, the
// slope is -R d . J R d / R d . d, and positive for a law that dissipates.
static pm_node newton_change(pm_graph *g, pm_node rate, pm_node last, const pm_node e[2],
                             const pm_node response[2]) {
    const pm_node change = last == PM_NO_NODE ? rate : pm_sub(g, rate, last);
    const pm_node rise = pm_mul(g, change, pm_concat(g, 2, response)); // R d
    pm_node row[2];
    pm_gradient(g, rate, rise, 2, e, row); // R d . J
    pm_node slope = PM_NO_NODE;
    int first = 0;
    for (int i = 0; i < 2; ++i) {
        const int n = pm_graph_shape(g, e[i]).cols;
        if (row[i] != PM_NO_NODE) {
            slope = pm_add_or(g, slope, pm_dot(g, row[i], pm_slice(g, rise, first, n)));
        }
        first += n;
    }
    if (slope == PM_NO_NODE) {
        return rise;
    }
    const pm_node moved = pm_offset(g, pm_dot(g, change, rise), SMALLEST_CHANGE);
    return pm_mul(g, rise, pm_div(g, moved, pm_sub(g, moved, slope)));
}

pm_node pm_port_predict(pm_graph *g, const pm_port_model *port, pm_node last,
                        pm_port_nodes end[2]) {
    if (port->law->irreversible == NULL || end[0].response == PM_NO_NODE ||
        end[1].response == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    const pm_node rate = port->law->irreversible(g, port, end);
    if (rate == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    const pm_node e[2] = {end[0].e, end[1].e};
    const pm_node response[2] = {end[0].response, end[1].response};
    const pm_node rise = newton_change(g, rate, last, e, response);
    int first = 0;
    for (int i = 0; i < 2; ++i) {
        const int n = port->layout[i].nz;
        end[i].e = pm_add(g, end[i].e, pm_slice(g, rise, first, n));
        first += n;
    }
    return port->law->irreversible(g, port, end);
}
