// The part of `portmet-train evaluate` that begins with measurements instead of states.
#ifndef PM_TRAINER_COMMAND_EVALUATE_ESTIMATE_H
#define PM_TRAINER_COMMAND_EVALUATE_ESTIMATE_H

#include <signal.h>
#include <stdbool.h>

#include "scene/system.h"

// The arguments of the command; NULL: not given.
typedef struct pm_evaluate_arguments {
    const char *scene;
    const char *data, *data_set; // file, and the dataset in it
    const char *weights;         // folder with the weights and their uncertainty
    const char *trajectories;    // default: those not used in training
    const char *trained;         // trajectories used in training
    const char *record;          // file for the predictions
    const char *plot;            // folder for pictures
    double until;                // s; 0: not given
    const char *states;          // with estimate: file for the predicted states
    const char *truth;           // with estimate: file with states without noise
    bool json;                   // print one JSON object instead of tables
} pm_evaluate_arguments;

// Estimates the start of every trajectory from its first `seconds` and predicts the rest. Prints
// the relative L2 error of each measured column after these seconds, and the residuals of both
// laws.
//
// Writes to the file `record` the predictions /y [trajectory][time][column] in the columns of the
// data (NaN in columns that the scene does not measure), the states /z
// [trajectory][time][component], the times /t, and, if the fit left measured.h5 beside the weights,
// the standard deviations /deviation of /y and /state_deviation of /z. Writes to the file `states`
// the states at the steps of the scene, as a dataset that a scene may name as its reference. With
// `truth` it prints the errors of all states, hidden ones included, too. Draws into the folder
// `plot` prediction_N.png for the first four trajectories and, if there are deviations,
// coverage.png; the scripts and the numbers stay beside the pictures. PM_ELAW: a component that
// keeps a law by construction violates it. Fails otherwise as pm_estimate_make does.
pm_status pm_evaluate_from_estimate(pm_system *system, const pm_evaluate_arguments *how,
                                    double seconds, const volatile sig_atomic_t *stop);

#endif
