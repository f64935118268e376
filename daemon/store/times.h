// The times of stored trajectories.
#ifndef PM_STORE_TIMES_H
#define PM_STORE_TIMES_H

#include "base/status.h"

// Whether dt > 0 and the times t [ntime], s, are t[0] + j dt, as all that reads trajectories takes
// for granted. PM_EDATA names the file.
pm_status pm_times_check(const char *path, int ntime, const double *t, double dt);

#endif
