// The energy balance of a closed system at rates of the data. Most rates say little about an energy
// where a large rate depends on a small difference: two capacitors with a resistor between them
// exchange currents that depend on the difference of their voltages, and only a slow leak shows the
// voltages themselves. A fit may then end with voltages that are many times too large and a leak
// that is too small. Energy is conserved whatever L, M and the ports are, so that the balance
// determines the energies without them.
//
// The power of a rate, sum over all variables of dE/dz zdot, is zero in the data. The power of a
// conservative model's own rates is zero, too, so that the balance is no new condition: it gives
// the errors of rates that would change the energy the weight of a power.
#ifndef PM_TRAINER_LEARN_ENERGY_BALANCE_H
#define PM_TRAINER_LEARN_ENERGY_BALANCE_H

#include "graph/graph.h"
#include "learn/samples.h"
#include "scene/system.h"

// Returns true if the system conserves energy by construction: there are no boundary inputs, and
// all subsystems and ports have the hard form.
bool pm_energy_balance_exists(const pm_system *system);

// Adds the relative error [1][1] of the balance to the graph,
//     sum e / sqrt(sum of e^2 + d^2),
//     e = dE/dz (z' - z),   d = dE/dz scale sqrt(1/weight^2 - 1 + LEAST^2),
// where the sums are over all variables. z' = z + dt zdot is the second state of the window
// `input`, and the samples with their scales and weights (learn/samples.h) must be those of rates.
// dE [nsubsystem] are the gradients of the energies at z. Where the weights say that a rate is
// uncertain, d is large, so that its error does not dominate the balance. PM_ENOMEM.
pm_status pm_energy_balance_build(pm_graph *g, const pm_system *system, const pm_samples *samples,
                                  pm_node input, const pm_node *dE, pm_node *balance);

#endif
