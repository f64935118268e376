// The residuals of a system on a window of states, as a graph.
#ifndef PM_TRAINER_LEARN_LOSS_GRAPH_H
#define PM_TRAINER_LEARN_LOSS_GRAPH_H

#include "graph/graph.h"
#include "learn/samples.h"
#include "scene/integrator.h"
#include "scene/system.h"

typedef struct pm_loss {
    pm_residual residual;
    const pm_integrator *integrator;
    int substeps;        // per dt
    double degeneracy;   // weight
    const double *scale; // [nz] of residuals, where > 0 in place of the samples'; or NULL
    double robust;       // d in units of the median sample's root mean square residual; 0: plain
} pm_loss;

typedef struct pm_loss_nodes {
    pm_node input;      // [1][pm_samples_width] batched: a window of learn/samples.h
    pm_node residual;   // [1][unroll nz]: (z - z_data) / scale after each step
    pm_node degeneracy; // [1][1]: mean squared degeneracy residual; PM_NO_NODE in the hard form
} pm_loss_nodes;

// How much a loss reads of what loads prescribe over a step: 1, its beginning, or
// PM_BOUNDARY_INPUT_ORDER.
int pm_loss_load_order(const pm_loss *loss);

// The samples have as much of the loads as the loss reads. PM_ENOMEM.
pm_status pm_loss_graph_build(pm_graph *g, const pm_system *system, const pm_samples *samples,
                              const pm_loss *loss, pm_loss_nodes *nodes);

#endif
