// Finds what a run of a scene need not compute, and what it computes without effect.
#ifndef PM_APP_SKIPPED_H
#define PM_APP_SKIPPED_H

#include "app/setup.h"

// Prints these findings on standard output, one line each.
void pm_skipped_print(const pm_setup *setup);

#endif
