// The residuals of one sample as a graph, whose squares sum to the loss of the sample without its
// robust function. Gauss-Newton methods differentiate them (Nocedal, Wright, Numerical
// Optimization, 2006, section 10.3).
#ifndef PM_TRAINER_LEARN_RESIDUALS_H
#define PM_TRAINER_LEARN_RESIDUALS_H

#include "graph/graph.h"
#include "learn/objective.h"

// Returns the number of residuals of one sample without the penalty of the soft form: the number of
// variables times the number of steps of a window, and one more for the energy balance.
int pm_residuals_count(const pm_objective *objective);

// Adds the residuals [1][n] of one window of samples to the graph: the scaled differences to the
// data and, in the soft form, every component of L dS and M dE, times the root of the weight of the
// penalty. *input receives the window (learn/loss_graph.h). PM_ENOMEM.
pm_status pm_residuals_build(pm_graph *g, const pm_loss_context *context, pm_node *input,
                             pm_node *residual);

// Adds every trained matrix of the system to the graph, in the order of pm_objective_weights, and
// returns the number of matrices, n. Writes the nodes to leaf [n] and the number of weights in each
// matrix to size [n]. If `leaf` is NULL, the function only counts.
int pm_residuals_weights(pm_graph *g, const pm_system *system, pm_node *leaf, int *size);

#endif
