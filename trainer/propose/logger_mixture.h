// Laws of amounts of substances that react, and that diffuse between parts. The energy is that of
// an ideal solution, and rates follow from its potentials (mass action): forward and backward rates
// are equal in equilibrium, whatever the constants are (Marcelin and de Donder; Feinberg, Chem.
// Eng. Sci. 29, 1974).
#ifndef PM_TRAINER_PROPOSE_LOGGER_MIXTURE_H
#define PM_TRAINER_PROPOSE_LOGGER_MIXTURE_H

#include "propose/logger_laws.h"

// Writes the part of the co-energy, or of the energy, that amounts have, as items of a list. The
// first one depends on the temperature of the part; without a thermometer the second one has all,
// at that of the surroundings.
void pm_logger_write_mixture(pm_logger_writer *w, int part, bool energy);

// Writes reaction k of the view as a pair that heats the temperature of its part, or the
// surroundings: `of` and `to` stand before the names of amounts and of what takes up the heat.
void pm_logger_write_reaction(pm_logger_writer *w, int k, const char *of, const char *to);

// Writes the coefficient of the diffusion of one substance between two amounts of two parts.
void pm_logger_write_diffusion(pm_logger_writer *w, const pm_logger_column *a,
                               const pm_logger_column *b);

#endif
