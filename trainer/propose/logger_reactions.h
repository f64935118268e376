// Amounts of substances that react, and that diffuse between parts. The energy is that of an ideal
// mixture, and rates follow from its potentials (mass action): forward and backward rates are equal
// in equilibrium, whatever the constants are (Feinberg, Chem. Eng. Sci. 29, 1974; Marcelin and de
// Donder for rates by affinities).
#ifndef PM_TRAINER_PROPOSE_LOGGER_REACTIONS_H
#define PM_TRAINER_PROPOSE_LOGGER_REACTIONS_H

#include "propose/logger_laws.h"
#include "propose/logger_samples.h"

// Finds the stoichiometric numbers of reactions: small integers by which the amounts of a part
// change together, among all changes that the data show. Finds which amounts of two parts are those
// of one substance: both parts have as many, in one order. The kinds, ports and scales of the view
// must be known. PM_ENOMEM.
pm_status pm_logger_find_reactions(pm_logger_samples *w);

// Return how many amounts and reactions a part has.
int pm_logger_amounts(const pm_logger_view *view, int part);
int pm_logger_reactions(const pm_logger_view *view, int part);

// Write the part of the co-energy and of the energy that amounts have. The first one depends on the
// temperature of the part; without a thermometer the second one has all, at that of the
// surroundings.
void pm_logger_write_mixture(pm_logger_writer *w, int part);
void pm_logger_write_formation(pm_logger_writer *w, int part);

// Writes reaction k of the view as a pair that heats the temperature of its part, or the
// surroundings: `of` and `to` stand before the names of amounts and of what takes up the heat.
void pm_logger_write_reaction(pm_logger_writer *w, int k, const char *of, const char *to);

// Writes the coefficient of the diffusion of one substance between two amounts of two parts.
void pm_logger_write_diffusion(pm_logger_writer *w, const pm_logger_column *a,
                               const pm_logger_column *b);

#endif
