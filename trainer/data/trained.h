// All trained weights of a system as one vector theta, component by component in the order of the
// system (subsystems first, then ports), and matrix by matrix.
#ifndef PM_TRAINER_DATA_TRAINED_H
#define PM_TRAINER_DATA_TRAINED_H

#include "scene/system.h"

// A trained matrix of a component, and the position of its first weight in theta.
typedef struct pm_trained {
    const pm_param_entry *entry; // borrowed from the system
    int component;
    int first, size;
} pm_trained;

// Returns the number of weights.
int pm_trained_count(const pm_system *system);
// These functions copy all weights from the system to theta [pm_trained_count], and back.
void pm_trained_gather(const pm_system *system, double *theta);
void pm_trained_scatter(const pm_system *system, const double *theta);
// Lists the matrices and returns how many there are. If `list` is NULL, it only counts them.
int pm_trained_list(const pm_system *system, pm_trained *list);
// Return the name of a component in the scene, and the place of its model in the file that gives
// it.
const char *pm_trained_name(const pm_system *system, int component);
const char *pm_trained_place(const pm_system *system, int component);

// Returns the value of a learned constant of a component, in its own unit: positive constants are
// stored as logarithms. Returns NAN if the matrix `entry` is no learned constant.
double pm_trained_constant(const pm_system *system, int component, const pm_param_entry *entry);

// Lets all components of a system that name a shared weight use that of the first one; the weights
// of the others are then no longer trained. A system whose files come from one fit keeps its
// values.
void pm_trained_share(pm_system *system);

#endif
