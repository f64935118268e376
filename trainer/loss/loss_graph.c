// Integrates from the first state of a window over its steps and subtracts the other states.
#include "loss/loss_graph.h"

#include <assert.h>
#include <math.h>

#include "data/magnitudes.h"
#include "graph/program.h"
#include "sim/step_graph.h"

// A variable at rest counts as if it changed by this fraction of its typical change, so that the
// balance of a system at rest does not consist of rounding errors.
#define LEAST 1e-2
// Where the gradients of all energies vanish, the powers are compared with this fraction of the
// typical energy of the system.
#define LEAST_ENERGY 1e-6

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

// --- the energy balance ---

// The energy balance of a closed system at rates of the data. Most rates say little about an energy
// where a large rate depends on a small difference: two capacitors with a resistor between them
// exchange currents that depend on the difference of their voltages, and only a slow leak shows the
// voltages themselves. A fit may then end with voltages that are many times too large and a leak
// that is too small. Energy is conserved whatever L, M and the ports are, so that the balance
// determines the energies without them.
//
// The power of a rate, sum over all variables of dE/dz zdot, is zero in the data. The power of a
// conservative model's own rates is zero, too, so that the balance is no new condition: it gives
// the errors of rates that would change the energy the weight of a power.

bool pm_loss_balances(const pm_loss *loss, const pm_system *system) {
    // A system conserves energy by construction if there are no boundary inputs, and all subsystems
    // and ports have the hard form.
    bool conserved = loss->balance > 0 && loss->residual == PM_RESIDUAL_DERIVATIVE &&
                     system->scene->physics.nprescribed == 0;
    for (int i = 0; i < system->scene->physics.nsubsystem; ++i) {
        conserved = conserved && system->part[i]->spec.form == PM_HARD;
    }
    for (int i = 0; i < system->scene->physics.nport; ++i) {
        const pm_port_model *port = system->port[i];
        conserved = conserved && port->spec.form == PM_HARD && port->law->conservative;
    }
    return conserved;
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

// Work space while building; all arrays are [nsubsystem] or [unroll].
typedef struct scratch {
    pm_node *z, *residual;
    pm_step_work work;
} scratch;

// Appends the relative error [1][1] of the energy balance to the residuals of rates,
//     sqrt(balance) sum e / sqrt(sum of e^2 + d^2),
//     e = dE/dz (z' - z),   d = dE/dz scale sqrt(1/weight^2 - 1 + LEAST^2),
// where the sums are over all variables, z' = z + dt zdot is the second state of the window, scale
// the typical change of a variable and weight that of its sample. The square root has a lower
// bound. For a co-energy dE/dz is the derivative by it, not by its energy variable. Where the
// weights say that a rate is uncertain, d is large, so that its error does not dominate the
// balance. The work space holds the gradients dE/dz at z, where the only stage of an Euler step was
// evaluated.
static pm_status append_balance(pm_graph *g, const pm_system *system, const pm_samples *samples,
                                const pm_loss *loss, const scratch *s, pm_loss_nodes *nodes) {
    const int nz = samples->nz, count = system->scene->physics.nsubsystem;
    const pm_node input = nodes->input;
    double energy = 0;
    pm_magnitudes m;
    PM_TRY(pm_magnitudes_find(&m, system, samples));
    for (int i = 0; i < count; ++i) {
        const pm_part *part = system->part[i];
        energy += m.energy[i];
        s->z[i] = s->work.state[i].dE;
        if (pm_part_has_coenergies(part)) {
            const pm_node z = s->work.state[i].z, E = pm_part_energy(g, part, z);
            pm_gradient(g, E, PM_NO_NODE, 1, &z, &s->z[i]);
        }
        if (s->z[i] == PM_NO_NODE) { // the energy is constant
            s->z[i] = pm_constant(g, 0, 1, part->layout.nz);
        }
    }
    pm_magnitudes_free(&m);
    const double least = LEAST_ENERGY * energy;
    const pm_node gradient = pm_concat(g, count, s->z);
    const pm_node change = pm_sub(g, pm_slice(g, input, nz, nz), pm_slice(g, input, 0, nz));
    const pm_node part = pm_mul(g, gradient, change);
    const pm_node typical = pm_mul(g, gradient, pm_param(g, samples->scale, 1, nz));
    const pm_node square = pm_add(g, pm_dot(g, part, part),
                                  pm_dot(g, pm_square(g, typical), doubt(g, samples, input)));
    const pm_node balance =
        pm_div(g, pm_dot(g, gradient, change), pm_sqrt(g, pm_offset(g, square, least * least)));
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
    for (int i = 0; i < scene->physics.nsubsystem; ++i) {
        s->z[i] = pm_slice(g, nodes->input, scene->physics.subsystem[i].first,
                           scene->physics.subsystem[i].layout.nz);
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
        pm_build_step(g, system, rk, scene->physics.dt / substeps, substeps, s->z, boundary_input,
                      &nodes->degeneracy, &s->work);
        const pm_node target = pm_slice(g, nodes->input, (step + 1) * nz, nz);
        const pm_node predicted = pm_concat(g, scene->physics.nsubsystem, s->z);
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
    assert(samples->nboundary_input == 0 || samples->input_order >= pm_loss_input_order(loss));
    pm_arena arena = {0};
    scratch s = {
        .z = pm_arena_array(&arena, (size_t)system->scene->physics.nsubsystem, sizeof *s.z),
        .residual = pm_arena_array(&arena, (size_t)samples->unroll, sizeof *s.residual),
        .work = pm_step_work_new(system, &arena),
    };
    pm_status status = pm_arena_status(&arena, "a loss");
    if (status == PM_OK) {
        status = build(g, system, samples, loss, &s, nodes);
    }
    pm_arena_free(&arena);
    return status;
}

pm_node pm_loss_graph_rows(pm_graph *g, const pm_loss *loss, const pm_loss_nodes *nodes) {
    const int count = pm_graph_shape(g, nodes->residual).cols;
    const pm_node rows = pm_scale(g, nodes->residual, 1 / sqrt(count));
    return nodes->degeneracy == PM_NO_NODE
               ? rows
               : pm_concat_or(g, rows, pm_scale(g, nodes->degeneracy, sqrt(loss->degeneracy)));
}

pm_status pm_loss_chunk(const pm_graph *g, int count, const pm_node *output, int *chunk) {
    pm_program *one = NULL, *two = NULL;
    PM_TRY(pm_program_open(&one, g, count, output, 1));
    const pm_status status = pm_program_open(&two, g, count, output, 2);
    if (status == PM_OK) {
        // The bytes that all samples share, such as weights and gradients, do not count.
        const size_t each = pm_program_bytes(two) - pm_program_bytes(one) + 1;
        const size_t fit = PM_LOSS_CHUNK_BYTES / each;
        const int most = fit > PM_LOSS_CHUNK ? PM_LOSS_CHUNK : fit < 1 ? 1 : (int)fit;
        *chunk = *chunk == 0 || most < *chunk ? most : *chunk;
    }
    pm_program_close(one);
    pm_program_close(two);
    return status;
}
