// An evaluation as tables for a person and as JSON for a program, on standard output.
#ifndef PM_TRAINER_EVALUATE_EVALUATE_REPORT_H
#define PM_TRAINER_EVALUATE_EVALUATE_REPORT_H

#include "evaluate/evaluate.h"
#include "evaluate/thermo.h"

// `trained`: on trajectories that training saw, whose errors are shown beside; NULL: none.
void pm_evaluation_print(const pm_evaluation *evaluation, const pm_evaluation *trained,
                         const pm_thermo *thermo);

// One object; numbers that are not finite become null. SI units; errors as fractions. seen: which
// trajectories of the dataset training saw (evaluate/seen.h); NULL: not known.
void pm_evaluation_print_json(const pm_evaluation *evaluation, const pm_evaluation *trained,
                              const pm_thermo *thermo, const bool *seen);

#endif
