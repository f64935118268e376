// Chooses the initial weights of a fit to measurements, by successive halving (Jamieson, Talwalkar,
// AISTATS 2016). Noise and gaps spoil rates, and those of hidden variables are not known, so that
// draws cannot be fitted to rates (fit/start.h). Each draw is fitted to some short windows by
// multiple shooting instead, the worse half is dropped, and this is repeated until one is left.
#ifndef PM_TRAINER_SHOOTING_WINDOW_DRAWS_H
#define PM_TRAINER_SHOOTING_WINDOW_DRAWS_H

#include "shooting/shooting.h"

typedef struct pm_shooting_search {
    int tries;      // draws
    int iterations; // with weights, in the first round; each round has half as many more
    int length;     // samples of a window
    // Writes draw number `id` to theta [nweight] and to the system.
    void (*draw)(void *context, int id, double *theta);
    void *context;
    const volatile sig_atomic_t *stop; // ends the search when nonzero; or NULL
} pm_shooting_search;

// Gives the system the best of the draws; `s` must have no windows and has none afterwards. Its
// noise and its substeps are changed. PM_EINTERRUPTED, PM_ENUMERIC: no draw can be integrated;
// PM_ENOMEM.
pm_status pm_shooting_search_start(pm_shooting *s, const pm_shooting_search *search);

#endif
