// What a run of a scene does not compute, and what it computes in vain.
#ifndef PM_APP_SKIPPED_H
#define PM_APP_SKIPPED_H

#include "app/setup.h"

// Prints it to standard output, one line each.
void pm_skipped_print(const pm_setup *setup);

#endif
