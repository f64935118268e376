// Checks the times of stored trajectories.
#ifndef PM_STORE_TIMES_H
#define PM_STORE_TIMES_H

#include "base/status.h"

// Checks that dt > 0 and that the times t [ntime], s, are t[0] + j dt, which all users of
// trajectories rely on. PM_EDATA; the error begins with `path`.
pm_status pm_times_check(const char *path, int ntime, const double *t, double dt);

#endif
