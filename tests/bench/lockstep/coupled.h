// Runs a scene by portmet's lock-step, either in this process or in one process for each process of
// the scene.
#ifndef TESTS_BENCH_COUPLED_H
#define TESTS_BENCH_COUPLED_H

#include "cost.h"
#include "scene/system.h"

#define COUPLED_STEPS_MAX 20000

// Measures `steps` steps after some warm-up steps. `url` is the URL of LCM. If it is NULL,
// everything runs in this process, for which the caller has joined the scene's processes into one.
// z [scene->nz] is the initial state; NULL: the scene's own. PM_ENET, or the failure of the run.
// All processes have ended when the function returns, after a failure too.
pm_status coupled_run(const pm_system *system, const char *url, const double *z, int steps,
                      cost *result);

#endif
