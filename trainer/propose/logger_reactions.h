// Reactions of substances: small integers by which their amounts change together, among all changes
// that the data show. What the data keep constant, such as a number of atoms, they keep, too.
#ifndef PM_TRAINER_PROPOSE_LOGGER_REACTIONS_H
#define PM_TRAINER_PROPOSE_LOGGER_REACTIONS_H

#include "propose/logger_samples.h"

// Finds the reactions of each part, the simplest that explain all changes, and which amounts of two
// parts are those of one substance: both parts have as many, in one order. The kinds, ports and
// scales of the view must be known. PM_ENOMEM.
pm_status pm_logger_find_reactions(pm_logger_samples *w);

#endif
