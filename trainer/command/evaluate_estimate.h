// The part of `portmet-train evaluate` that begins with measurements instead of states.
#ifndef PM_TRAINER_COMMAND_EVALUATE_ESTIMATE_H
#define PM_TRAINER_COMMAND_EVALUATE_ESTIMATE_H

#include <signal.h>

#include "scene/system.h"

typedef struct pm_evaluate_estimate {
    const char *data, *data_set; // file, and the dataset in it
    const char *trajectories;    // NULL: those not used in training
    const char *record;          // file for the predictions; NULL: not written
    const char *states;          // file for the predicted states; NULL: not written
    const char *truth;           // file with states without noise; NULL: there are none
    const char *plot;            // folder for pictures (command/evaluate_bands.h); NULL: none
    const char *weights;         // folder with the uncertainty of the weights; or NULL
    double seconds;              // the first seconds, from which starts are estimated
    bool json;                   // print one JSON object instead of tables
} pm_evaluate_estimate;

// Estimates the start of every trajectory from its first seconds and predicts the rest. Prints the
// relative L2 error of each measured column after these seconds, and the residuals of both laws.
//
// Writes to the file `record` the predictions /y [trajectory][time][column] in the columns of the
// data (NaN in columns that the scene does not measure), the states /z
// [trajectory][time][component], the times /t, and, if the fit left measured.h5 beside the weights,
// the standard deviations /deviation of /y and /state_deviation of /z. Writes to the file `states`
// the states at the steps of the scene, as a dataset that a scene may name as its reference. With
// `truth` it prints the errors of all states, too (command/evaluate_truth.h). PM_ELAW: a component
// that keeps a law by construction violates it. Fails otherwise as pm_estimate_make does.
pm_status pm_evaluate_from_estimate(pm_system *system, const pm_evaluate_estimate *how,
                                    const volatile sig_atomic_t *stop);

#endif
