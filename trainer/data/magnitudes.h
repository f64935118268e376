// The typical sizes of states, rates and energies in the training data. Learned operators and
// energies start in these units, so that training does not depend on the units of columns and time.
#ifndef PM_TRAINER_DATA_MAGNITUDES_H
#define PM_TRAINER_DATA_MAGNITUDES_H

#include "data/samples.h"
#include "scene/system.h"

typedef struct pm_magnitudes {
    const pm_scene *scene; // borrowed
    pm_arena arena;        // owns the arrays below
    double *deviation;     // [nz] standard deviation, pooled over the components of each group
    double *rate;   // [nz] root mean square of the rate, unit of the component per s, pooled over
                    // the components of each group
    double *energy; // [nsubsystem] J: the estimate from given reversible pairs if the model has
                    // any, else the typical heat content, else 1
    double *temperature; // [nsubsystem] K, the starting temperature of thermal energies, or the
                         // mean of temperatures that the state holds; 300 if there are none
    double *dS;          // [nsubsystem] J/K per unit of the first given entropy; 1 if it is in J/K
} pm_magnitudes;

// The magnitudes of one group, in the units of pm_magnitudes. Those of a co-energy are the
// magnitudes of its energy variable, as the present weights compute it.
typedef struct pm_group_magnitude {
    double deviation, rate, energy, temperature, dS;
} pm_group_magnitude;

// Computes the magnitudes from samples, which must be windows of one step. The caller frees.
// PM_ENOMEM.
pm_status pm_magnitudes_find(pm_magnitudes *m, const pm_system *system, const pm_samples *samples);
void pm_magnitudes_free(pm_magnitudes *m);

// These functions look up a group of a subsystem by its name, and a group of a port by its prefixed
// name ("a.q"). They return false if there is no such group or if it belongs to a boundary input.
bool pm_magnitudes_of_part(const pm_magnitudes *m, int part, const char *group,
                           pm_group_magnitude *result);
bool pm_magnitudes_of_port(const pm_magnitudes *m, int port, const char *group,
                           pm_group_magnitude *result);

#endif
