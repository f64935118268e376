// The irreversible exchange of a port under an implicit integrator, which iterates the new state.
//
// Within a step the exchange changes the co-energies that drive it, such as the temperatures of two
// bodies in thermal contact. If this change is larger than the difference of the co-energies, a
// fixed-point iteration diverges. Therefore both ends publish how their co-energies respond to a
// rate, and one step of Newton's method predicts the co-energies at the end of the exchange. Where
// several ports act on a component, they change it at the same time: the response that each of them
// sees is as many times larger, so that together they do not go too far. The law, evaluated at the
// prediction, gives the direction of the rate, and Newton's step gives its size. Both ends compute
// the same numbers. The properties of the law that hold for any size of the rate hold in every
// iteration: the energy fluxes cancel, and entropy is produced.
#ifndef PM_MODEL_PREDICTION_H
#define PM_MODEL_PREDICTION_H

#include "model/port.h"

// Returns true if the irreversible rate of the port acts on this exposed group. The integrator then
// needs the response of the group.
bool pm_port_responds(const pm_port_model *port, pm_end end, const char *group);

// Returns the rate [1][ny] of the components exposed by the end `own`, or PM_NO_NODE if nothing
// acts. Where an end shows a response, its predicted co-energies replace its `e` in the array
// `end`, and the law is evaluated with them. The co-energies of an end without a response are not
// predicted. If neither end shows a response, the result is the rate of the law.
//
// `last` is the irreversible rate [1][ny_a + ny_b] that made the current iterate, or PM_NO_NODE in
// the first iteration. *next receives the irreversible rate of this iteration, or PM_NO_NODE if
// nothing was predicted. `degeneracy` is that of pm_part_bulk. The slope in Newton's step is exact
// for one exchanged quantity whose co-entropies do not change; otherwise the iteration needs more
// steps to reach the same state.
pm_node pm_port_rate(pm_graph *g, const pm_port_model *port, pm_end own, pm_port_nodes end[2],
                     pm_node last, pm_node *next, pm_node *degeneracy);

#endif
