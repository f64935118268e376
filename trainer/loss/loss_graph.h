// Builds the residuals of a system on a window of states as a graph: the integrated states, or the
// rates, minus the data, divided by a scale.
#ifndef PM_TRAINER_LOSS_LOSS_GRAPH_H
#define PM_TRAINER_LOSS_LOSS_GRAPH_H

#include "data/samples.h"
#include "graph/graph.h"
#include "loss/team.h"
#include "scene/integrator.h"
#include "scene/system.h"

// The settings of a loss, from the key `loss` of a training file.
typedef struct pm_loss {
    pm_residual residual;            // of integrated states or of rates (data/samples.h)
    const pm_integrator *integrator; // borrowed
    int substeps;                    // steps of the integrator in one dt
    double degeneracy;               // weight of the degeneracy penalty in the soft form
    double balance;      // weight of the energy balance beside rates (loss_graph.c); 0: none
    const double *scale; // [nz] replaces the scale of the samples where it is > 0; or NULL
    double robust;       // d, in units of the root of the median squared residual; 0: not robust
    const pm_team *team; // the processes that evaluate it together, borrowed; NULL: this one alone
} pm_loss;

// Returns true if the residuals contain the error of the energy balance.
bool pm_loss_balances(const pm_loss *loss, const pm_system *system);

// The nodes that pm_loss_graph_build makes.
typedef struct pm_loss_nodes {
    pm_node input; // [1][pm_samples_width] batched: a window (data/samples.h)
    // [1][unroll nz]: (z - z_data) weight / scale after each step. If rates are compared and
    // pm_loss_balances is true, a last number follows: the error of the energy balance times the
    // root of its weight.
    pm_node residual;
    // [1][...]: the components of L dS and M dE of every subsystem and port at the first state of
    // each step, in scaled coordinates, divided by the root of `unroll`. The sum of their squares
    // is the mean of the penalty over the steps. PM_NO_NODE in the hard form.
    pm_node degeneracy;
} pm_loss_nodes;

// Returns the number of polynomial coefficients of the boundary inputs that the loss reads for each
// step: 1 (their values at the beginning of the step) or PM_BOUNDARY_INPUT_ORDER.
int pm_loss_input_order(const pm_loss *loss);

// Adds the residuals of one window to the graph. The windows of `samples` must hold at least
// pm_loss_input_order coefficients of the boundary inputs. PM_ENOMEM.
pm_status pm_loss_graph_build(pm_graph *g, const pm_system *system, const pm_samples *samples,
                              const pm_loss *loss, pm_loss_nodes *nodes);

// Returns the rows [1][...] whose squares sum to the loss of a window without its robust function:
// the scaled residuals and, in the soft form, every component of L dS and M dE, times the root of
// the weight of the penalty.
pm_node pm_loss_graph_rows(pm_graph *g, const pm_loss *loss, const pm_loss_nodes *nodes);

// The most windows per run of a program, and the most bytes that its values may take, so that they
// stay in the cache.
#define PM_LOSS_CHUNK 128
#define PM_LOSS_CHUNK_BYTES 33554432

// Lowers *chunk, or sets it if it is 0, to the number of windows that a program of these outputs
// may run at once. PM_ENOMEM.
pm_status pm_loss_chunk(const pm_graph *g, int count, const pm_node *output, int *chunk);

#endif
