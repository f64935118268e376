// Prints an evaluation on standard output, as tables or as JSON.
#ifndef PM_TRAINER_EVALUATE_EVALUATE_REPORT_H
#define PM_TRAINER_EVALUATE_EVALUATE_REPORT_H

#include "evaluate/evaluate.h"
#include "evaluate/thermo.h"

// Prints tables of errors, of thermodynamic quantities and of the residuals of both laws of
// thermodynamics. `trained` is an evaluation on trajectories that training used, whose errors are
// printed as well; or NULL.
void pm_evaluation_print(const pm_evaluation *evaluation, const pm_evaluation *trained,
                         const pm_thermo *thermo);

// Prints one JSON object in SI units, with errors as fractions. Numbers that are not finite become
// null. seen [ntrajectory of the dataset] says which trajectories training used (pm_seen_choose);
// NULL: not known.
void pm_evaluation_print_json(const pm_evaluation *evaluation, const pm_evaluation *trained,
                              const pm_thermo *thermo, const bool *seen);

#endif
