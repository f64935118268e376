// The flow of a system over short intervals, with its derivatives: programs that take states from
// one measured time to the next and compute what is measured there, for a batch of states at once.
// Derivatives with respect to the state at the start and to all weights are carried along from step
// to step (forward sensitivities; Bock, 1987), so that their cost grows linearly with the number of
// steps.
#ifndef PM_TRAINER_LEARN_FLOW_H
#define PM_TRAINER_LEARN_FLOW_H

#include "learn/observation.h"
#include "scene/boundary_input.h"
#include "scene/integrator.h"

// How a system is integrated between measured times.
typedef struct pm_flow_how {
    pm_system *system;                 // borrowed; its weights at the time of a call count
    const pm_observation *observation; // borrowed
    const pm_integrator *integrator;   // borrowed
    int substeps;                      // steps of the integrator in one dt of the scene
    bool stretched;                    // intervals are not all dt long
    bool fixed;                        // derivatives with respect to the weights are not computed
} pm_flow_how;

// The compiled programs with their memory. Each thread needs a pm_flow of its own.
typedef struct pm_flow pm_flow;

#define PM_FLOW_BATCH 32 // states at a time

// Opens the programs, with derivatives or without. The caller closes. PM_ENOMEM.
pm_status pm_flow_open(pm_flow **flow, const pm_flow_how *how, bool derivatives);
void pm_flow_close(pm_flow *flow); // NULL is allowed

int pm_flow_weights(const pm_flow *flow); // the number of all trained weights
// Returns the number of coefficients of the boundary inputs that a step reads for one interval.
int pm_flow_inputs(const pm_flow *flow);

// A state that the flow advances in time, with its derivatives. The caller owns the arrays.
typedef struct pm_flow_item {
    double *z;           // [nz] the state
    double *by_start;    // [nz][nz] its derivative with respect to the state at the start
    double *by_weights;  // [nz][pm_flow_weights] its derivative with respect to the weights
    const double *input; // [pm_flow_inputs] the boundary inputs over the coming interval, or NULL
    double duration;     // of the coming interval, in dt of the scene
} pm_flow_item;

// Makes the state of `item` a start: by_start becomes the identity and by_weights zero.
void pm_flow_start(const pm_flow *flow, pm_flow_item *item);
// Advances the states of all items [count], count <= PM_FLOW_BATCH, by one interval each, which is
// one step of the scene stretched to item->duration. Also advances the derivatives if the flow has
// them.
void pm_flow_step(pm_flow *flow, int count, pm_flow_item *const *item);
// Computes the measured columns y [count][ny] at the present states of the items. If the flow has
// derivatives, also writes the derivatives of y with respect to the start, by_start
// [count][ny][nz], and with respect to the weights, by_weights [count][ny][pm_flow_weights].
void pm_flow_look(pm_flow *flow, int count, pm_flow_item *const *item, double *y, double *by_start,
                  double *by_weights);

#endif
