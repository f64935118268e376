// The course of a fit to measurements: from short windows whose gaps hardly count to long ones
// whose gaps are closed, with the noise of each column estimated from the residuals on the way.
#ifndef PM_TRAINER_LEARN_SHOOTING_SCHEDULE_H
#define PM_TRAINER_LEARN_SHOOTING_SCHEDULE_H

#include "learn/shooting.h"

typedef struct pm_shooting_course {
    const double *given; // [ny] noise that the user gives, in units of the columns; 0: estimate it
    const double *typical; // [nz] typical size of the changes of hidden components; 0: not known
    int first;             // samples of the first windows; 0: chosen
    bool loud;             // print a line for each window length
    const volatile sig_atomic_t *stop; // ends the fit when nonzero; or NULL
} pm_shooting_course;

// Returns the length of the first windows: twice as many samples as one needs to find a start.
int pm_shooting_first_length(const pm_shooting *s);
// Runs the whole course. PM_EINTERRUPTED, PM_ENUMERIC, PM_ENOMEM.
pm_status pm_shooting_run(pm_shooting *s, const pm_shooting_course *course);

#endif
