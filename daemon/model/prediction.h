// The stiff side of a port under an integrator that iterates the new state (integrator.h): the
// irreversible exchange is driven by co-energies that it changes itself within the step, often by
// far more than their difference (heat between two well connected bodies). Both ends therefore
// publish how their co-energies respond to a rate, and predict by one step of Newton's method the
// co-energies that the exchange will leave. The law, evaluated there, gives the direction, and
// Newton's step the size: both ends compute the same numbers, and what the law keeps for any size
// (the energy fluxes cancel, entropy is produced) is kept by every iteration.
#ifndef PM_MODEL_PREDICTION_H
#define PM_MODEL_PREDICTION_H

#include "model/port.h"

// Whether the port's irreversible rate acts on an exposed group, whose response is then wanted.
bool pm_port_responds(const pm_port_model *port, pm_end end, const char *group);

// The rate [1][ny] of the components exposed by `own`; PM_NO_NODE: none. Where an end shows a
// response, end[].e is replaced by the prediction, at which the law is taken; elsewhere this is the
// law's rate. An end without a response is one whose co-energies the exchange leaves as they are.
// `last`: the irreversible rate [1][ny_a + ny_b] that the iterate was made with, PM_NO_NODE for
// none; *next receives the one found, PM_NO_NODE if nothing was predicted. `degeneracy` as in
// pm_part_bulk. Newton's slope is exact for one exchanged quantity whose co-entropies do not
// change; otherwise the iteration leads to the same state in more steps.
pm_node pm_port_rate(pm_graph *g, const pm_port_model *port, pm_end own, pm_port_nodes end[2],
                     pm_node last, pm_node *next, pm_node *degeneracy);

#endif
