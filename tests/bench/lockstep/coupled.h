// Runs of a scene by portmet's own lock-step: in this process, or in a process for each of the
// scene's.
#ifndef TESTS_BENCH_COUPLED_H
#define TESTS_BENCH_COUPLED_H

#include "cost.h"
#include "scene/system.h"

#define COUPLED_STEPS_MAX 20000

// Measures `steps` steps after some to warm up. url: of LCM; NULL: all in this process, for which
// the scene has been joined into one. z [scene->nz]: the state to start from; NULL: the scene's.
// PM_ENET and what the run ends with; no process is left then either.
pm_status coupled_run(const pm_system *system, const char *url, const double *z, int steps,
                      cost *result);

#endif
