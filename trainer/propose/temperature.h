// Temperatures that a dataset shows, by conservation of energy. The power of motion x' p' of a
// conjugate pair x, p is known from the data, since x' = dE/dp. What motion loses, the rest of the
// state takes up: the potential energy, and the entropies, which take up T s'. Therefore
//     sum over pairs of x' p' + d/dt U(rest of the state) = 0
// holds along every trajectory of a closed system. A polynomial U is fitted to this equation, and
// its slopes dU/ds are the temperatures.
//
// Where x' depends on more than momenta, such as the lengths of a linkage, the kinetic energy K is
// taken for quadratic in the momenta. Its part x' dK/dx of the sum then has terms p p x' with
// factors that depend on positions. Angular momenta without a conjugate variable would need other
// terms. Where no coefficient of L is known, the scale of energy is free, and with it that of
// temperatures.
#ifndef PM_TRAINER_PROPOSE_TEMPERATURE_H
#define PM_TRAINER_PROPOSE_TEMPERATURE_H

#include "propose/view.h"

// Writes the mean temperature of each component in J/K, in K, to temperature [nz of the scene], and
// 0 elsewhere. A temperature counts if two halves of the data agree on it within a factor of two
// and if a fit to one half describes the other. An entropy that changes too little gets the mean of
// all. All are 0 if the data do not tell, for scenes with boundary inputs, which may do work, for
// scenes of many variables, and if memory runs out. `parts` is the result of pm_view_parts.
void pm_look_temperatures(const pm_look *look, const pm_part_view *parts, double *temperature);

#endif
