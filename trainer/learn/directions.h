// Names combinations of constants that measurements do not tell apart, such as a stiffness and a
// mass of which only the ratio matters.
#ifndef PM_TRAINER_LEARN_DIRECTIONS_H
#define PM_TRAINER_LEARN_DIRECTIONS_H

#include "learn/uncertainty.h"

// Prints a line for each direction in the space of all weights along which the standard deviation
// is large: a factor of 1.28 for positive constants, a quarter of their size for others. The
// directions are the eigenvectors of the covariance in these units. A line says by how much each
// constant changes over one standard deviation. Directions of single constants, which
// pm_uncertainty_print names, and of network weights are left out. PM_ENOMEM.
pm_status pm_directions_print(const pm_uncertainty *u, const pm_shooting *s);
// Prints notes before the weights are fitted, each with the place of a model in the training file:
// constants that are hard to tell apart from each other and from the starts of hidden components.
// The measure is the collinearity index of Brun, Reichert, Kuensch (Water Resour. Res. 37, 2001):
// by how much less the data change along a direction than along its constants one by one. The
// derivatives are those at the present weights and starts; columns have the noise `noise` [ny], and
// from window to window a state may drift by `gap` [nz]. Changes nothing that the fit depends on.
// PM_ENOMEM.
pm_status pm_directions_foresee(pm_shooting *s, const double *noise, const double *gap);

#endif
