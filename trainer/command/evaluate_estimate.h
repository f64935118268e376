// The part of `portmet-train evaluate` that begins with measurements instead of states.
#ifndef PM_TRAINER_COMMAND_EVALUATE_ESTIMATE_H
#define PM_TRAINER_COMMAND_EVALUATE_ESTIMATE_H

#include <signal.h>

#include "scene/system.h"

typedef struct pm_evaluate_estimate {
    const char *data, *data_set; // file, and the dataset in it
    const char *trajectories;    // NULL: those not used in training
    const char *record;          // NULL: write nothing
    const char *states;          // likewise
    const char *weights;         // folder with the uncertainty of the weights; or NULL
    double seconds;              // from which starts are estimated
    bool json;
} pm_evaluate_estimate;

// Estimates the start of every trajectory from its first seconds, predicts the rest, prints the
// relative L2 error of each measured column after these seconds and how well both laws were kept,
// and writes the predictions to `record`: /y [trajectory][time][column] in the columns of the data,
// NaN in columns that the scene does not measure; /deviation their standard deviations, if the fit
// left measured.h5 beside the weights; /z [trajectory][time][component] the states; /t. `states`
// receives the states in steps of the scene, as a dataset that a scene may name as its reference.
// PM_ELAW: a component that keeps a law by construction violates it; else like pm_estimate_make.
pm_status pm_evaluate_from_estimate(pm_system *system, const pm_evaluate_estimate *how,
                                    const volatile sig_atomic_t *stop);

#endif
