// An evaluation as tables for a person and as JSON for a program, on standard output.
#ifndef PM_TRAINER_EVALUATE_EVALUATE_REPORT_H
#define PM_TRAINER_EVALUATE_EVALUATE_REPORT_H

#include "evaluate/evaluate.h"

// `trained`: on trajectories that training saw, whose errors are shown beside; NULL: none.
void pm_evaluation_print(const pm_evaluation *evaluation, const pm_evaluation *trained);

// One object; numbers that are not finite become null. SI units; errors as fractions.
void pm_evaluation_print_json(const pm_evaluation *evaluation, const pm_evaluation *trained);

#endif
