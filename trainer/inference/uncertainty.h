// The uncertainty of a fit to measurements: the covariance of the weights from the normal
// equations after elimination of all starts, the noise of the columns, and which starts of hidden
// components the data fix. It is kept in the file "measured.h5" beside the weights.
#ifndef PM_TRAINER_INFERENCE_UNCERTAINTY_H
#define PM_TRAINER_INFERENCE_UNCERTAINTY_H

#include "shooting/shooting.h"

typedef struct pm_uncertainty {
    pm_arena arena; // owns all
    int nweight, ny, nz;
    double *covariance; // [nweight][nweight] of all trained weights
    double *weights;    // [nweight] the weights at which the covariance was computed
    double *noise;      // [ny] standard deviation of the residuals, in the unit of each column
    // [ny] the part of `noise` that differs from sample to sample; the rest is error of the model
    double *independent;
    // The number of samples that carry as much information as one sample with independent noise: 1
    // plus twice the sum of the autocorrelation of the residuals. It exceeds 1 where the model is
    // wrong, since residuals of neighbouring samples then agree.
    double samples_per_residual;
    // The factor by which the covariance is larger than with independent noise: the ratio by which
    // trajectories disagree about the weights more than independent noise explains. Where there are
    // too few trajectories to compare, it is at least samples_per_residual. `covariance` includes
    // this factor.
    double inflation;
    // The factor by which the variance of a prediction is larger than that which `covariance`
    // causes (inference/calibration.h); 1: not known.
    double scale;
    double *start;   // [nz] mean start of all trajectories
    double *spread;  // [nz] standard deviation of the starts among trajectories
    double *unknown; // [nz] standard deviation of the start after the fit, divided by that of its
                     // prior; 0: the component has no prior
} pm_uncertainty;

// Returns the standard deviation of the part of a column's residuals, as of the last evaluation,
// that differs from sample to sample: from the median difference of neighbouring residuals. NAN:
// there are none. `size` is work space for all samples; *error receives the standard error of the
// logarithm.
double pm_uncertainty_independent(const pm_shooting *s, int column, double *size, double *error);

// Computes the uncertainty at the present weights and starts, with a scale of 1. The caller frees.
// PM_ENUMERIC: the data and the priors do not fix the weights; PM_ENOMEM.
pm_status pm_uncertainty_make(pm_uncertainty *u, pm_shooting *s);
void pm_uncertainty_free(pm_uncertainty *u); // zeroed storage is allowed

// A weight, or the number whose logarithm it is, is needed, or it may be zero.
typedef enum pm_optional_weight {
    PM_WEIGHT_NEEDED,
    PM_WEIGHT_OPTIONAL,
    PM_LOGARITHM_OPTIONAL,
    PM_LOGARITHM_NEEDED
} pm_optional_weight;

// Finds the optional weights that may as well be zero. optional [nweight][nweight] has the
// pm_optional_weight of each on its diagonal, and beside it PM_WEIGHT_OPTIONAL for the weights that
// mean nothing where it is zero, such as the width of a bell. They are left out one after the
// other: each time the one by which the objective gains most, when it rises less, as all others
// follow, than the information that the measurements have about so many numbers (Schwarz, Ann.
// Stat. 6, 1978). The rise is that above the minimum of the quadratic model at the present weights
// and starts (Hassibi, Stork, NIPS 1992). No weight is left out that would take a needed number
// near zero, too, as all terms of a motion whose scale is free do. spare [nweight] becomes the
// count of all weights that are left out with it and before it, and 0 where none is. Nothing is
// spare where the measurements and the priors do not fix all weights, or where windows are not
// whole trajectories. PM_ENOMEM.
pm_status pm_uncertainty_spare(pm_shooting *s, const unsigned char *optional, int *spare);

// Writes "measured.h5" into the folder. PM_EFILE.
pm_status pm_uncertainty_save(const pm_uncertainty *u, const char *folder);
// Reads "measured.h5" from the folder, and sets *found to false if there is no such file. The
// weights of the system must be those of the folder; components then share weights as in the fit
// (pm_trained_share). The caller frees. PM_EWEIGHTS: the file has another number of weights,
// columns or state components than the system and the observation; PM_EFILE, PM_ENOMEM.
pm_status pm_uncertainty_load(pm_uncertainty *u, const char *folder, pm_system *system,
                              const pm_observation *o, bool *found);

// Prints the learned constants with their standard deviations, and what the data do not fix, by the
// names of the scene: constants, directions of network weights, and starts of hidden components.
void pm_uncertainty_print(const pm_uncertainty *u, const pm_shooting *s);

// Finds how well energies are known: share [nsubsystem] becomes the standard deviation of the
// difference between the lowest and the highest energy of the fitted states, over this difference;
// NAN: the subsystem has no energy, or it does not change. PM_ENOMEM.
pm_status pm_uncertainty_energies(const pm_uncertainty *u, const pm_shooting *s, double *share);

// Prints a line for each direction in the space of all weights along which the standard deviation
// is large: a factor of 1.28 for positive constants, a quarter of their size for others. The
// directions are the eigenvectors of the covariance in these units. A line says by how much each
// constant changes over one standard deviation. Directions of single constants, which
// pm_uncertainty_print names, and of network weights are left out. PM_ENOMEM.
pm_status pm_identifiability_print(const pm_uncertainty *u, const pm_shooting *s);
// Prints notes before the weights are fitted, each with the place of a model in the training file:
// constants that are hard to tell apart from each other and from the starts of hidden components.
// The measure is the collinearity index of Brun, Reichert, Kuensch (Water Resour. Res. 37, 2001):
// by how much less the data change along a direction than along its constants one by one. The
// derivatives are those at the present weights and starts; columns have the noise `noise` [ny], and
// from window to window a state may drift by `gap` [nz]. Changes nothing that the fit depends on.
// PM_ENOMEM.
pm_status pm_identifiability_warn(pm_shooting *s, const double *noise, const double *gap);

#endif
