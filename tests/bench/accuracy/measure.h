// Scores a training: the errors of its rollouts, and how well they conserve energy and angular
// momentum and let entropy grow. Energy, angular momentum and entropy are computed by the
// simulator's formulas at the predicted states, so that models without an energy can be compared
// with the others. The drift of the energy that the model itself has learned is measured, too: it
// shows the conservation by the model's structure, independent of the model's error.
#ifndef TESTS_BENCH_MEASURE_H
#define TESTS_BENCH_MEASURE_H

#include "base/arena.h"
#include "store/dataset.h"
#include "truth/truth.h"

#define STUDY_GROUPS 3 // q, p, s
#define STUDY_TIMES 4  // at which the growth of errors is read off

// The true trajectories and their simulator.
typedef struct study_truth {
    pm_truth *physics;
    pm_dataset *dataset;
} study_truth;

// Conservation and entropy growth in predicted trajectories.
typedef struct study_laws {
    double energy_median, energy_worst;     // J, largest |E(t) - E(0)| of a trajectory
    double own_median, own_worst;           // J, the same for the model's energy; NaN: it has none
    double momentum_median, momentum_worst; // kg m^2/s, likewise
    double falls;                           // fraction of the steps in which the entropy falls
    double fall;                            // J/K, the largest fall
} study_laws;

typedef struct study_score {
    int weights;
    int failures;                                    // rollouts that became non-finite
    double step_median, step_mean;                   // squared scaled residual of one step
    double median[STUDY_GROUPS], mean[STUDY_GROUPS]; // relative L2 errors of the trajectories
    double time[STUDY_TIMES];                        // s; fractions of the length of a trajectory
    double growth[STUDY_TIMES][STUDY_GROUPS];        // median errors up to that time
    study_laws laws;
} study_score;

// Scores the weights in `folder`, which were trained with the training file `config`. If `pictures`
// is not NULL, writes the pictures of `evaluate --plot` to the folder of that name. PM_ECONFIG,
// PM_EWEIGHTS, PM_EFILE, PM_EDATA, PM_ENOMEM.
pm_status study_measure(const char *config, const char *folder, const study_truth *truth,
                        const char *pictures, study_score *score);

#endif
