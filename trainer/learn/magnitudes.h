// How large states, rates and energies of the training data are: the units in which learned
// operators and energies start, so that nothing depends on the units of the columns or of time.
#ifndef PM_TRAINER_LEARN_MAGNITUDES_H
#define PM_TRAINER_LEARN_MAGNITUDES_H

#include "learn/samples.h"
#include "scene/system.h"

typedef struct pm_magnitudes {
    const pm_scene *scene; // borrowed
    pm_arena arena;        // owns what follows
    double *deviation;     // [nz] standard deviation, pooled over each group
    double *rate;          // [nz] root mean square of the rate, likewise
    double *energy; // [nsubsystem] J: from given reversible pairs where the model has some, else
                    // the typical heat content, else 1
    double *temperature; // [nsubsystem] K, where thermal energies start; else 300
} pm_magnitudes;

// The magnitudes of one group.
typedef struct pm_group_magnitude {
    double deviation, rate, energy, temperature;
} pm_group_magnitude;

// Samples are windows of one step. PM_ENOMEM.
pm_status pm_magnitudes_find(pm_magnitudes *m, const pm_system *system, const pm_samples *samples);
void pm_magnitudes_free(pm_magnitudes *m);

// Of a group of a part, or of a port's end by its prefixed name ("a.q"); false: the world shows it.
bool pm_magnitudes_of_part(const pm_magnitudes *m, int part, const char *group,
                           pm_group_magnitude *result);
bool pm_magnitudes_of_port(const pm_magnitudes *m, int port, const char *group,
                           pm_group_magnitude *result);

#endif
