// How good a system is on some trajectories of a dataset, part by part and group by group:
// rollouts, single steps, and against persistence, the state that stays as it is.
#ifndef PM_TRAINER_EVALUATE_MEASURE_H
#define PM_TRAINER_EVALUATE_MEASURE_H

#include "evaluate/thermo.h"

// A group of a part.
typedef struct pm_measure_cell {
    const char *part, *group;
    pm_box rollout;     // relative L2 errors of the rollouts, infinite where not finite
    pm_box persistence; // of the first state in place of each later one
    double one_step;    // of a step from true states, relative to how far they move; NAN: not taken
} pm_measure_cell;

typedef struct pm_measure {
    pm_arena arena;
    pm_evaluation *evaluation; // NULL: nothing was measured
    pm_thermo thermo;
    int ncell;
    pm_measure_cell *cell; // [ncell]
    int failures;          // rollouts that became non-finite
    // The geometric mean, over rollouts and cells, of the error over that of persistence; cells
    // that do not change are left out. Of a rollout that is not finite it is a large number.
    double score;
} pm_measure;

// Rolls out trajectories first .. end-1. `thorough`: single steps are taken, too, in scenes without
// loads, and what evaluate/thermo.h says. Results do not depend on the number of threads. As
// pm_evaluate. The caller frees.
pm_status pm_measure_make(pm_measure *measure, const pm_system *system, const pm_dataset *dataset,
                          int first, int end, bool thorough, const pm_evaluate_how *how);
void pm_measure_free(pm_measure *measure); // NULL is allowed, and what was never made

#endif
