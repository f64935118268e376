// Fits a system to measurements by multiple shooting (learn/shooting.h), instead of to states. This
// happens if the training file gives `noise`, or if the scene has hidden groups or `observations`.
#ifndef PM_TRAINER_LEARN_FIT_MEASURED_H
#define PM_TRAINER_LEARN_FIT_MEASURED_H

#include "learn/fit.h"
#include "learn/observation.h"
#include "learn/shooting_schedule.h"

#define PM_FIT_MEASURED_LEVEL 8 // numbers of a point in the course

struct pm_fit_measured {
    pm_arena arena;
    pm_dataset *data; // the measurements
    pm_observation observation;
    double *noise; // [observation.count] given noise in the unit of the column; 0: to be estimated
    double *declared; // [weights] as declared, before random numbers are added to them
    double *typical;  // [nz] typical size of hidden components; 0: not known
    // The point from which an interrupted fit goes on (pm_shooting_level, as numbers), with the
    // noise [observation.count], the gaps and the deviations of later starts [2][nz], and the
    // starts [nstart] of all windows; f->theta has its weights.
    double level[PM_FIT_MEASURED_LEVEL], *level_noise, *level_gap, *level_start;
    int nstart;
    long used, samples; // number of samples that the fit uses, and of all samples
};

// Loads the measurements, and makes f->dataset: states at the steps of the scene, interpolated from
// the measurements, with guesses for hidden groups. These states only serve to fix the scales of
// the models (learn/normalization.h). Adds what a checkpoint needs to f->extra. PM_EDATA,
// PM_ECONFIG, PM_EFILE, PM_ENOMEM.
pm_status pm_fit_measured_load(pm_fit *f, const char *path);
void pm_fit_measured_close(struct pm_fit_measured *m); // NULL is allowed
// Returns true if pm_fit_measured_run chooses the initial weights by short fits to windows
// (learn/shooting_start.h), false if they are chosen by fits to rates (learn/start.h) or drawn
// once.
bool pm_fit_measured_searches(const pm_fit *f);
// Runs multiple shooting on the training part, from the step of the checkpoint if the fit was
// resumed. f->theta holds the result. When it is interrupted, it writes a checkpoint and the
// weights with which the present step began.
pm_status pm_fit_measured_run(pm_fit *f);
// Estimates the starts of the validation part from the first quarter of each trajectory, and prints
// how well the rest is predicted. The training part is used if there is no validation part.
// PM_EUNFIT: predictions are not finite.
pm_status pm_fit_measured_report(pm_fit *f);

#endif
