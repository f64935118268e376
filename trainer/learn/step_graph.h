// One step of a whole system as a graph, for training: the same model expressions and the same
// Runge-Kutta tableau as sim/subsystem.h, batched over samples and open to differentiation.
#ifndef PM_TRAINER_LEARN_STEP_GRAPH_H
#define PM_TRAINER_LEARN_STEP_GRAPH_H

#include "graph/graph.h"
#include "scene/boundary_input.h"
#include "scene/integrator.h"
#include "scene/system.h"

// One subsystem at a stage: the state z at which operators and ports are taken, the states between
// which co-energies are (from: PM_NO_NODE unless discrete), dE, dS, the response of dE to a rate,
// and the time derivative. PM_NO_NODE where absent.
typedef struct pm_state_nodes {
    pm_node z, from, to, dE, dS, response, zdot;
} pm_state_nodes;

// Fills dE and dS of state [nsubsystem] from `from` and `to`.
void pm_build_coenergies(pm_graph *g, const pm_system *system, pm_state_nodes *state);

// What all loads prescribe [1][nprescribed] at a fraction of the interval whose polynomials are
// `load` [1][PM_BOUNDARY_INPUT_ORDER nprescribed] (scene/boundary_input.h), of which the fraction 0
// needs the first nprescribed alone. PM_NO_NODE: there are no loads.
pm_node pm_build_load(pm_graph *g, const pm_system *system, pm_node boundary_input,
                      double fraction);

// What a port shows at both ends, from the subsystems' states and what the loads prescribe.
void pm_build_port_nodes(pm_graph *g, const pm_system *system, int port,
                         const pm_state_nodes *state, pm_node prescribed, pm_port_nodes end[2]);

// Fills zdot from z, dE and dS, and what the loads prescribe; adds the squared degeneracy residuals
// to *degeneracy. `last` [nport]: the irreversible rates of the iteration before, replaced by those
// of this one (prediction.h); all PM_NO_NODE at first.
void pm_build_rates(pm_graph *g, const pm_system *system, pm_state_nodes *state, pm_node prescribed,
                    pm_node *last, pm_node *degeneracy);

// Replaces z [nsubsystem] by the states after `substeps` steps of length h, over which the loads
// are `load` (as in pm_build_load). `work` has room for nsubsystem states, nsubsystem * rk->nstage
// and nport nodes, and nz of one subsystem.
typedef struct pm_step_work {
    pm_state_nodes *state;
    pm_node *k, *last;
    bool *responding;
} pm_step_work;
void pm_build_step(pm_graph *g, const pm_system *system, const pm_integrator *rk, double h,
                   int substeps, pm_node *z, pm_node boundary_input, pm_node *degeneracy,
                   const pm_step_work *work);

#endif
