// What a structure that fits badly may lack, found by trying: short fits of the training file with
// one dependence more, of an operator, an energy, or what a port exposes. It is the search over
// hypotheses (propose/search.h) around a training file, whoever wrote it.
#ifndef PM_TRAINER_PROPOSE_ADVICE_H
#define PM_TRAINER_PROPOSE_ADVICE_H

#include "fit/fit.h"

// Checks that the advice may be written to `path`, and its scene beside it: each is missing, or
// earlier advice that the program does not read. To be called before the fit. PM_EUSAGE, PM_EFILE.
pm_status pm_advise_check(const char *path);

// Tries what the models of a fit to states may lack, for `budget` s of CPU time, and writes to
// `out` what helps and by how much, or that nothing does. If something helps, writes the changed
// training file as `path`, and the scene, if it is changed, as "<path without its
// ending>_scene.yaml"; otherwise removes what earlier advice is there. PM_EINTERRUPTED, PM_EFILE,
// PM_ENOMEM; fails as pm_look_make does.
pm_status pm_advise(const pm_fit *fit, double budget, const volatile sig_atomic_t *stop,
                    const char *path, FILE *out);

#endif
