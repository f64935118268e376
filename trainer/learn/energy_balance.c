// Builds the relative error of the energy balance as a graph.
#include "learn/energy_balance.h"

#include <assert.h>

#include "learn/magnitudes.h"

// A variable at rest counts as if it changed by this fraction of its typical change, so that the
// balance of a system at rest does not consist of rounding errors.
#define LEAST 1e-2
// Where the gradients of all energies vanish, the powers are compared with this fraction of the
// typical energy of the system.
#define LEAST_ENERGY 1e-6

bool pm_energy_balance_exists(const pm_system *system) {
    bool conserved = system->scene->nprescribed == 0;
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        conserved = conserved && system->part[i]->spec.form == PM_HARD;
    }
    for (int i = 0; i < system->scene->nport; ++i) {
        const pm_port_model *port = system->port[i];
        conserved = conserved && port->spec.form == PM_HARD && port->law->conservative;
    }
    return conserved;
}

static pm_status find_energy(const pm_system *system, const pm_samples *samples, double *energy) {
    pm_magnitudes m;
    PM_TRY(pm_magnitudes_find(&m, system, samples));
    *energy = 0;
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        *energy += m.energy[i];
    }
    pm_magnitudes_free(&m);
    return PM_OK;
}

// Returns 1/weight^2 - 1 + LEAST^2 of every variable [1][nz].
static pm_node doubt(pm_graph *g, const pm_samples *samples, pm_node input) {
    const pm_node one = pm_constant(g, 1, 1, samples->nz);
    if (!samples->weighted) {
        return pm_scale(g, one, LEAST * LEAST);
    }
    const pm_node weight = pm_slice(g, input, pm_samples_weights(samples), samples->nz);
    return pm_offset(g, pm_div(g, one, pm_square(g, weight)), LEAST * LEAST - 1);
}

pm_status pm_energy_balance_build(pm_graph *g, const pm_system *system, const pm_samples *samples,
                                  pm_node input, const pm_node *dE, pm_node *balance) {
    const int nz = samples->nz;
    double energy = 0;
    assert(samples->unroll == 1 && pm_energy_balance_exists(system));
    PM_TRY(find_energy(system, samples, &energy));
    const double least = LEAST_ENERGY * energy;
    const pm_node gradient = pm_concat(g, system->scene->nsubsystem, dE);
    const pm_node change = pm_sub(g, pm_slice(g, input, nz, nz), pm_slice(g, input, 0, nz));
    const pm_node part = pm_mul(g, gradient, change);
    const pm_node typical = pm_mul(g, gradient, pm_param(g, samples->scale, 1, nz));
    const pm_node square = pm_add(g, pm_dot(g, part, part),
                                  pm_dot(g, pm_square(g, typical), doubt(g, samples, input)));
    *balance =
        pm_div(g, pm_dot(g, gradient, change), pm_sqrt(g, pm_offset(g, square, least * least)));
    return PM_OK;
}
