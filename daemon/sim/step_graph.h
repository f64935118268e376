// The rates and one step of a whole system as a graph, for training and for gradients of rollouts.
// It evaluates the same model expressions and the same Runge-Kutta tableau as the engine, batched
// over samples, and can be differentiated.
#ifndef PM_SIM_STEP_GRAPH_H
#define PM_SIM_STEP_GRAPH_H

#include "graph/graph.h"
#include "scene/boundary_input.h"
#include "scene/integrator.h"
#include "scene/system.h"

// One subsystem at a stage of the integrator. Nodes that do not apply are PM_NO_NODE.
typedef struct pm_state_nodes {
    pm_node z;        // [1][nz] the state at which operators and ports are evaluated
    pm_node from, to; // [1][nz] the two states of a discrete gradient; else `from` is PM_NO_NODE
    pm_node dE, dS;   // [1][nz]
    pm_node response; // the linear response of dE to a rate
    pm_node zdot;     // [1][nz]
} pm_state_nodes;

// Computes dE and dS of state [nsubsystem] from `from` and `to`.
void pm_build_coenergies(pm_graph *g, const pm_system *system, pm_state_nodes *state);

// Returns the values [1][nprescribed] of all boundary inputs at a fraction (0 to 1) of a step.
// `boundary_input` [1][PM_BOUNDARY_INPUT_ORDER nprescribed] are their polynomials over the step
// (scene/boundary_input.h); fraction 0 needs the first nprescribed numbers alone. Returns
// PM_NO_NODE if `boundary_input` is PM_NO_NODE, that is, without boundary inputs.
pm_node pm_build_boundary_input(pm_graph *g, const pm_system *system, pm_node boundary_input,
                                double fraction);

// Collects what both ends of a port expose, from the states of the subsystems and the values of the
// boundary inputs.
void pm_build_port_nodes(pm_graph *g, const pm_system *system, int port,
                         const pm_state_nodes *state, pm_node prescribed, pm_port_nodes end[2]);

// Computes zdot of state [nsubsystem], the rates of the states themselves, from z, dE, dS and the
// values of the boundary inputs, and appends the degeneracy residuals to *degeneracy. `last`
// [nport] holds the irreversible rates of the previous iteration of the prediction (prediction.h),
// all PM_NO_NODE at first, and receives those of this one.
void pm_build_rates(pm_graph *g, const pm_system *system, pm_state_nodes *state, pm_node prescribed,
                    pm_node *last, pm_node *degeneracy);

// Builds the rates k [1][nz] of the whole scene at the state z [1][nz], with the values
// `prescribed` of the boundary inputs, as explicit methods take them. The arena is work space.
// PM_ENOMEM.
pm_status pm_build_scene_rates(pm_graph *g, const pm_system *system, pm_node z, pm_node prescribed,
                               pm_arena *scratch, pm_node *k);

// Work space of pm_build_step.
typedef struct pm_step_work {
    pm_state_nodes *state; // [nsubsystem]
    pm_node *k;            // [nsubsystem * rk->nstage]
    pm_node *last;         // [nport]
    int *responding;       // [largest nz of a subsystem] result of pm_system_responding
    pm_node stretch; // [1][1] batched: the factor by which each item's steps are longer than h;
                     // PM_NO_NODE stands for the factor 1
} pm_step_work;

// Returns work space without `stretch` in the arena, whose status the caller checks.
pm_step_work pm_step_work_new(const pm_system *system, pm_arena *arena);

// Replaces z [nsubsystem] by the states after `substeps` steps of h seconds each, and appends the
// degeneracy residuals of the states before these steps to *degeneracy. `boundary_input` holds
// polynomials as in pm_build_boundary_input.
void pm_build_step(pm_graph *g, const pm_system *system, const pm_integrator *rk, double h,
                   int substeps, pm_node *z, pm_node boundary_input, pm_node *degeneracy,
                   const pm_step_work *work);

#endif
