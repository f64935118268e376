// The stiff side of a port under an integrator that iterates the new state (integrator.h): the
// irreversible exchange is driven by co-energies that it changes itself within the step, often by
// far more than their difference (heat between two well connected bodies). Both ends therefore
// publish how their co-energies respond to a rate, predict by one Newton step the co-energies that
// the exchange will leave, and evaluate the unchanged law there: at the same numbers, so what the
// law keeps exactly is kept exactly.
#ifndef PM_MODEL_PREDICTION_H
#define PM_MODEL_PREDICTION_H

#include "model/port.h"

// Whether the port's irreversible rate acts on an exposed group, whose response is then wanted.
bool pm_port_responds(const pm_port_model *port, pm_end end, const char *group);

// Replaces end[].e by the prediction, where both ends have a response. `last`: the irreversible
// rate [1][ny_a + ny_b] that the iterate was made with, PM_NO_NODE for none. Returns the rate at
// the prediction, which is the next iterate's `last`; PM_NO_NODE if nothing is irreversible.
// The slope is exact for one exchanged quantity whose co-entropies do not change; otherwise the
// iteration converges to the same state, but more slowly.
pm_node pm_port_predict(pm_graph *g, const pm_port_model *port, pm_node last, pm_port_nodes end[2]);

#endif
