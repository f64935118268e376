// What a training came to: its rollouts against the truth, and against the laws. Energy, angular
// momentum and entropy are those of the simulator's formulas at the predicted states, so that a
// form which has no energy is measured like those which have; besides, the drift of the energy that
// the model itself has learned, which tells what its structure is worth apart from its error.
#ifndef TESTS_BENCH_MEASURE_H
#define TESTS_BENCH_MEASURE_H

#include "base/arena.h"
#include "store/dataset.h"
#include "truth/truth.h"

#define STUDY_GROUPS 3 // q, p, s
#define STUDY_TIMES 4  // at which the growth of errors is read off

// Truth to be compared with.
typedef struct study_truth {
    pm_truth *physics;
    pm_dataset *dataset;
} study_truth;

// How predicted trajectories keep the laws.
typedef struct study_laws {
    double energy_median, energy_worst;     // J, largest |E(t) - E(0)| of a trajectory
    double own_median, own_worst;           // J, likewise of the model's energy; NaN: it has none
    double momentum_median, momentum_worst; // kg m^2/s, likewise
    double falls;                           // of the steps, on which the entropy falls
    double fall;                            // J/K, the largest
} study_laws;

typedef struct study_score {
    int weights;
    int failures;                                    // rollouts that became non-finite
    double step_median, step_mean;                   // squared scaled residual of one step
    double median[STUDY_GROUPS], mean[STUDY_GROUPS]; // relative L2 errors of the trajectories
    double time[STUDY_TIMES];                        // s; a tenth, ... of the length
    double growth[STUDY_TIMES][STUDY_GROUPS];        // their median, cut at that time
    study_laws laws;
} study_score;

// Scores the weights in `folder`, which were trained by the file `config`. With `pictures`, that
// folder receives those of evaluate --plot. PM_ECONFIG, PM_EWEIGHTS, PM_EFILE, PM_EDATA, PM_ENOMEM.
pm_status study_measure(const char *config, const char *folder, const study_truth *truth,
                        const char *pictures, study_score *score);

#endif
