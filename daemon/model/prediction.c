// One step of Newton's method, along the direction in which the exchange still has to change.
#include "model/prediction.h"

#include <stdio.h>
#include <string.h>

#include "model/site.h"

// Keeps slopes finite where the exchange has converged, and makes them 1 where nothing responds.
#define SMALLEST_CHANGE 1e-100

bool pm_port_responds(const pm_port_model *port, pm_end end, const char *group) {
    if (port->law->irreversible == NULL || port->law->has_no_operators) {
        return port->law->irreversible != NULL; // what such a law acts on, it alone knows
    }
    const pm_operator_spec *M = &port->spec.irreversible;
    char name[PM_MAX_NAME];
    snprintf(name, sizeof name, "%s%s", end == PM_END_A ? "a." : "b.", group);
    bool acts = false;
    for (int i = 0; i < M->nacts; ++i) {
        acts = acts || strcmp(M->acts_on[i], name) == 0;
    }
    for (int i = 0; i < M->nheats; ++i) {
        acts = acts || strcmp(M->heats[i], name) == 0;
    }
    return acts || pm_given_names(M, name);
}

// The co-energies e of both ends, and their responses side by side [1][ny_a + ny_b].
typedef struct exchange {
    pm_node e[2], response; // e: PM_NO_NODE where it does not respond
    int n[2];
} exchange;

// Returns the change of the rate by Newton's method for the equation r = f(e + R (r - last)), where
// R is the response. With the defect d = f(e) - last and J = df/de the change is (1 - J R)^-1 d,
// which is taken along d. Measured by the power d . R d, the slope is -R d . J R d / d . R d. It is
// positive for a law that dissipates.
static pm_node newton_change(pm_graph *g, const exchange *x, pm_node rate, pm_node last) {
    const pm_node defect = last == PM_NO_NODE ? rate : pm_sub(g, rate, last);
    const pm_node rise = pm_mul(g, defect, x->response);
    pm_node row[2];
    pm_gradient(g, rate, rise, 2, x->e, row); // R d . J
    pm_node moved = pm_offset(g, pm_dot(g, defect, rise), SMALLEST_CHANGE), all = moved;
    for (int i = 0; i < 2; ++i) {
        if (row[i] != PM_NO_NODE) {
            const pm_node own_rise = pm_slice(g, rise, i == 0 ? 0 : x->n[0], x->n[i]);
            all = pm_sub(g, all, pm_dot(g, row[i], own_rise));
        }
    }
    return pm_mul(g, defect, pm_div(g, moved, all));
}

pm_node pm_port_rate(pm_graph *g, const pm_port_model *port, pm_end own, pm_port_nodes end[2],
                     pm_node last, pm_node *next, pm_node *degeneracy) {
    *next = PM_NO_NODE;
    const bool stiff = port->law->irreversible != NULL &&
                       (end[0].response != PM_NO_NODE || end[1].response != PM_NO_NODE);
    const pm_node rate = stiff ? port->law->irreversible(g, port, end) : PM_NO_NODE;
    if (rate == PM_NO_NODE) {
        return port->law->rate(g, port, own, end, degeneracy);
    }
    exchange x;
    pm_node response[2];
    for (int i = 0; i < 2; ++i) {
        const bool responds = end[i].response != PM_NO_NODE;
        x.n[i] = port->layout[i].nz;
        x.e[i] = responds ? end[i].e : PM_NO_NODE;
        response[i] = responds ? end[i].response : pm_constant(g, 0, 1, x.n[i]);
    }
    x.response = pm_concat(g, 2, response);
    const pm_node change = newton_change(g, &x, rate, last);
    const pm_node rise = pm_mul(g, change, x.response);
    for (int i = 0; i < 2; ++i) {
        if (x.e[i] != PM_NO_NODE) {
            end[i].e = pm_add(g, end[i].e, pm_slice(g, rise, i == 0 ? 0 : x.n[0], x.n[i]));
        }
    }
    const pm_node predicted = port->law->irreversible(g, port, end);
    // The component of the rate so far along the prediction, in the metric of the response.
    const pm_node wanted = pm_add_or(g, last, change);
    const pm_node own_rise = pm_mul(g, predicted, x.response);
    const pm_node square = pm_offset(g, pm_dot(g, predicted, own_rise), SMALLEST_CHANGE);
    const pm_node along = pm_offset(g, pm_dot(g, wanted, own_rise), SMALLEST_CHANGE);
    *next = pm_mul(g, predicted, pm_div(g, along, square));
    const pm_node correction = pm_sub(g, *next, predicted);
    return pm_add(g, port->law->rate(g, port, own, end, degeneracy),
                  pm_slice(g, correction, own == PM_END_A ? 0 : x.n[0], x.n[own]));
}
