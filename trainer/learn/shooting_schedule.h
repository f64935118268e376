// The course of a fit to measurements: from short windows whose gaps hardly count to long ones
// whose gaps are closed, with the noise of each column estimated from the residuals on the way.
#ifndef PM_TRAINER_LEARN_SHOOTING_SCHEDULE_H
#define PM_TRAINER_LEARN_SHOOTING_SCHEDULE_H

#include "learn/shooting.h"

#define PM_SHOOTING_SHORTEST 4 // samples of the first windows, at least
// Before the last level residuals count as noise of at least this fraction of a deviation. Clean
// data would otherwise demand of short windows what the weights cannot fulfil yet.
#define PM_SHOOTING_EARLY_NOISE 3e-3
// Gaps count like residuals of this many deviations of the noise at the end of the course.
#define PM_SHOOTING_LAST_GAP 0.03

// The parts of a course, in their order.
enum {
    PM_COURSE_NONE,   // it has not begun
    PM_COURSE_STARTS, // shortest windows, fixed weights
    PM_COURSE_SHORT,  // shortest windows
    PM_COURSE_GROW,   // longer and longer windows
    PM_COURSE_LAST,   // longest windows, noise as given
    PM_COURSE_DONE
};

// A point of the course, from which it goes on with the same bits, given the weights, windows,
// starts, noise and gaps of the shooting.
typedef struct pm_shooting_level {
    int part;   // PM_COURSE_...
    int length; // samples of a window
    int round;  // completed rounds of steps with the same noise
    double factor, damping;
    double after;                  // the objective after the last round
    pm_shooting_progress progress; // in the present round
} pm_shooting_level;

typedef struct pm_shooting_course {
    const double *given; // [ny] noise that the user gives, in units of the columns; 0: estimate it
    const double *typical; // [nz] typical size of the changes of hidden components; 0: not known
    int first;             // samples of the first windows; 0: chosen
    bool loud;             // print a line for each window length
    const volatile sig_atomic_t *stop; // ends the fit when nonzero; or NULL
    // Where the course begins. With a part other than PM_COURSE_NONE the shooting must have the
    // weights, windows, starts, noise and gaps that it had when `keep` got this level.
    pm_shooting_level first_level;
    // Called before each step and at the end of the course; or NULL.
    pm_status (*keep)(void *context, const pm_shooting_level *level);
    void *context;
} pm_shooting_course;

// Returns the length of the first windows: twice as many samples as one needs to find a start.
int pm_shooting_first_length(const pm_shooting *s);
// Runs the course from its first level to its end. Fails as `keep` does. PM_EINTERRUPTED,
// PM_ENUMERIC, PM_ENOMEM.
pm_status pm_shooting_run(pm_shooting *s, const pm_shooting_course *course);

#endif
