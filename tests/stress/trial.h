// Runs under stress, and what they came to. A trial is one run: it goes all the way, or ends with
// an error that says why; either way every number it published is finite, no law was violated that
// the structure keeps, and the recording holds all that was done. Trials of a kind make a row.
#ifndef TESTS_STRESS_TRIAL_H
#define TESTS_STRESS_TRIAL_H

#include <stdio.h>

#include "scene/system.h"

#define TRIAL_TEXT 320

// What a row of trials came to. Zero-initialise with its name.
typedef struct trial_row {
    char name[80];
    int count, ended; // runs, and those that did not go all the way
    double drift;     // J, the largest of the total energy, of runs that went all the way
    double fall;      // J/K, the largest fall of the total entropy over a step, of all runs
    double momentum;  // kg m^2/s, largest drift of the angular momentum, likewise; NaN: no pendula
    char why[TRIAL_TEXT];   // the first end that was not the last step
    char fault[TRIAL_TEXT]; // the first thing that must not happen; "": none
} trial_row;

// Runs the system for `steps` steps from z [scene->nz] and adds the outcome. `recording`: path of a
// file to record to, which is read again. PM_EFILE, PM_ENOMEM; what a trial finds is no failure.
pm_status trial_run(trial_row *row, const pm_system *system, const double *z, long steps,
                    const char *recording);

void trial_print_header(FILE *csv);
void trial_print(const trial_row *row, FILE *csv);

#endif
