// Integrates from the first state of a window over its steps and subtracts the other states.
#include "learn/loss_graph.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "learn/energy_balance.h"
#include "learn/step_graph.h"

int pm_loss_input_order(const pm_loss *loss) {
    if (loss->residual == PM_RESIDUAL_DERIVATIVE) {
        return 1;
    }
    bool later = loss->substeps > 1;
    for (int i = 0; i < loss->integrator->nstage; ++i) {
        later = later || pm_integrator_time(loss->integrator, i) > 0;
    }
    return later ? PM_BOUNDARY_INPUT_ORDER : 1;
}

bool pm_loss_balances(const pm_loss *loss, const pm_system *system) {
    return loss->balance > 0 && loss->residual == PM_RESIDUAL_DERIVATIVE &&
           pm_energy_balance_exists(system);
}

// Work space while building; all arrays are [nsubsystem] or [unroll].
typedef struct scratch {
    pm_node *z, *residual;
    pm_step_work work;
} scratch;

// Appends the energy balance to the residuals of rates. The work space holds the co-energies at the
// first state of the window, where the only stage of an Euler step was evaluated.
static pm_status append_balance(pm_graph *g, const pm_system *system, const pm_samples *samples,
                                const pm_loss *loss, const scratch *s, pm_loss_nodes *nodes) {
    for (int i = 0; i < system->scene->nsubsystem; ++i) {
        s->z[i] = s->work.state[i].dE;
    }
    pm_node balance;
    PM_TRY(pm_energy_balance_build(g, system, samples, nodes->input, s->z, &balance));
    nodes->residual = pm_concat_or(g, nodes->residual, pm_scale(g, balance, sqrt(loss->balance)));
    return PM_OK;
}

static pm_status build(pm_graph *g, const pm_system *system, const pm_samples *samples,
                       const pm_loss *loss, const scratch *s, pm_loss_nodes *nodes) {
    const pm_scene *scene = system->scene;
    const int nz = samples->nz, unroll = samples->unroll;
    const bool derivative = loss->residual == PM_RESIDUAL_DERIVATIVE;
    const pm_integrator *rk = derivative ? pm_integrator_find("euler") : loss->integrator;
    const int substeps = derivative ? 1 : loss->substeps;
    nodes->input = pm_input(g, true, 1, pm_samples_width(samples));
    nodes->degeneracy = PM_NO_NODE;
    for (int i = 0; i < scene->nsubsystem; ++i) {
        s->z[i] =
            pm_slice(g, nodes->input, scene->subsystem[i].first, scene->subsystem[i].layout.nz);
    }
    pm_node scale = pm_param(g, samples->scale, 1, nz);
    if (samples->weighted) {
        scale = pm_div(g, scale, pm_slice(g, nodes->input, pm_samples_weights(samples), nz));
    }
    for (int step = 0; step < unroll; ++step) {
        const pm_node boundary_input =
            samples->nboundary_input == 0
                ? PM_NO_NODE
                : pm_slice(g, nodes->input, pm_samples_input(samples, step),
                           samples->input_order * samples->nboundary_input);
        pm_build_step(g, system, rk, scene->dt / substeps, substeps, s->z, boundary_input,
                      &nodes->degeneracy, &s->work);
        const pm_node target = pm_slice(g, nodes->input, (step + 1) * nz, nz);
        const pm_node predicted = pm_concat(g, scene->nsubsystem, s->z);
        s->residual[step] = pm_div(g, pm_sub(g, predicted, target), scale);
    }
    nodes->residual = pm_concat(g, unroll, s->residual);
    if (nodes->degeneracy != PM_NO_NODE) {
        nodes->degeneracy = pm_scale(g, nodes->degeneracy, 1.0 / sqrt(unroll));
    }
    return pm_loss_balances(loss, system) ? append_balance(g, system, samples, loss, s, nodes)
                                          : PM_OK;
}

pm_status pm_loss_graph_build(pm_graph *g, const pm_system *system, const pm_samples *samples,
                              const pm_loss *loss, pm_loss_nodes *nodes) {
    const size_t count = (size_t)system->scene->nsubsystem;
    assert(samples->nboundary_input == 0 || samples->input_order >= pm_loss_input_order(loss));
    scratch s = {
        .z = calloc(count, sizeof *s.z),
        .residual = calloc((size_t)samples->unroll, sizeof *s.residual),
        .work = {calloc(count, sizeof *s.work.state),
                 calloc(count * PM_MAX_STAGES, sizeof *s.work.k),
                 calloc((size_t)system->scene->nport + 1, sizeof *s.work.last),
                 calloc((size_t)system->scene->nz, sizeof *s.work.responding), PM_NO_NODE},
    };
    pm_status status = PM_OK;
    if (s.z == NULL || s.residual == NULL || s.work.state == NULL || s.work.k == NULL ||
        s.work.last == NULL || s.work.responding == NULL) {
        status = pm_fail(PM_ENOMEM, "out of memory for a loss");
    } else {
        status = build(g, system, samples, loss, &s, nodes);
    }
    free(s.z);
    free(s.residual);
    free(s.work.state);
    free(s.work.k);
    free(s.work.last);
    free(s.work.responding);
    return status;
}
