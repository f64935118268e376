// Trials of the stress test. A trial is one run, which must complete all steps or end with an error
// that names the reason. In both cases every published number must be finite, no law that the
// model's structure guarantees may be violated, and the recording must hold every completed step.
// Trials of one kind form a row of the table.
#ifndef TESTS_STRESS_TRIAL_H
#define TESTS_STRESS_TRIAL_H

#include <stdio.h>

#include "scene/system.h"

#define TRIAL_TEXT 320

// The results of a row of trials. The caller sets the name and zero-initialises the rest.
typedef struct trial_row {
    char name[80];
    int count, ended; // runs, and those that ended before the last step
    double drift;     // J, largest drift of the total energy in complete runs
    double fall;      // J/K, largest fall of the total entropy over a step in all runs
    double momentum;  // kg m^2/s, largest drift of the angular momentum, likewise; NaN: no pendula
    char why[TRIAL_TEXT];   // the first error with which a run ended early
    char fault[TRIAL_TEXT]; // the first violation of the conditions above; "": none
} trial_row;

// Runs the system for `steps` steps from z [scene->nz] and adds the outcome to the row. The run is
// recorded to the file `recording`, which is read again. PM_EFILE, PM_ENOMEM. Findings of the trial
// are not failures of this function.
pm_status trial_run(trial_row *row, const pm_system *system, const double *z, long steps,
                    const char *recording);

void trial_print_header(FILE *csv);
void trial_print(const trial_row *row, FILE *csv);

#endif
