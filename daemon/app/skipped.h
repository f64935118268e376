// Finds terms of a scene that a run need not compute, and operators that have no effect.
#ifndef PM_APP_SKIPPED_H
#define PM_APP_SKIPPED_H

#include "library/setup.h"

// Prints these findings on standard output, one line each.
void pm_skipped_print(const pm_setup *setup);

#endif
