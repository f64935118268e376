// Modules that a program loads when it needs them, so that a library behind them need not be
// installed for everything else. A module has copies of what it calls, except pm_fail, which
// programs export, so that both share descriptions of failures.
#ifndef PM_BASE_PLUGIN_H
#define PM_BASE_PLUGIN_H

#include "base/status.h"

// Loads the module `file`, which is looked for where the build or the installation has put it, as
// seen from the running program, and sets *table to the address of its variable `name`. The module
// stays loaded. PM_ECONFIG: it is not there, or a library that it needs is not installed.
pm_status pm_plugin_find(const char *file, const char *name, const void **table);

#endif
