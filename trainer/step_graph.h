// One step of a whole system as a graph, for training: the same model expressions and the same
// Runge-Kutta tableau as sim/subsystem.h, batched over samples and open to differentiation.
#ifndef PM_TRAINER_STEP_GRAPH_H
#define PM_TRAINER_STEP_GRAPH_H

#include "graph/graph.h"
#include "sim/integrator.h"
#include "store/load.h"
#include "store/system.h"

// z, dE, dS of every subsystem at one state, and the time derivative; PM_NO_NODE where absent.
typedef struct pm_state_nodes {
    pm_node z, dE, dS, zdot;
} pm_state_nodes;

// Fills dE and dS of state [nsubsystem] from its z.
void pm_build_coenergies(pm_graph *g, const pm_system *system, pm_state_nodes *state);

// What all loads prescribe [1][nprescribed] at a fraction of the interval whose polynomials are
// `load` [1][PM_LOAD_ORDER nprescribed] (store/load.h). PM_NO_NODE: there are no loads.
pm_node pm_build_load(pm_graph *g, const pm_system *system, pm_node load, double fraction);

// What a port shows at both ends, from the subsystems' states and what the loads prescribe.
void pm_build_port_nodes(pm_graph *g, const pm_system *system, int port,
                         const pm_state_nodes *state, pm_node prescribed, pm_port_nodes end[2]);

// Fills dE, dS and zdot; adds the squared degeneracy residuals to *degeneracy.
void pm_build_rates(pm_graph *g, const pm_system *system, pm_state_nodes *state, pm_node prescribed,
                    pm_node *degeneracy);

// Replaces z [nsubsystem] by the states after `substeps` steps of length h, over which the loads
// are `load` (as in pm_build_load). `work` has room for nsubsystem states and nsubsystem *
// rk->nstage nodes.
typedef struct pm_step_work {
    pm_state_nodes *state;
    pm_node *k;
} pm_step_work;
void pm_build_step(pm_graph *g, const pm_system *system, const pm_integrator *rk, double h,
                   int substeps, pm_node *z, pm_node load, pm_node *degeneracy,
                   const pm_step_work *work);

#endif
