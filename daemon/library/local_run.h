// A run of a whole scene in one process, with the ledger of energy and entropy: what `portmetd run
// --in-process` and the shared library (portmet.h) do. The numbers are those of a run over several
// processes, bit by bit.
//
// Life cycle: open; step, and read the sample and the ledger after each step; close.
#ifndef PM_LIBRARY_LOCAL_RUN_H
#define PM_LIBRARY_LOCAL_RUN_H

#include "library/setup.h"
#include "sim/ledger.h"
#include "sim/monolithic.h"

// The caller owns this storage.
typedef struct pm_local_run {
    const pm_setup *setup; // borrowed
    pm_monolithic *monolithic;
    pm_ledger ledger;
    bool sums;        // `sample` may hold no more than the first subsystems (monolithic.h)
    pm_sample sample; // of the state reached; its arrays belong to `monolithic`
} pm_local_run;

// Opens all subsystems of a completed setup, which is borrowed, and starts at its initial state.
// `sums` tells whether the caller needs no more of the samples than the first PM_SCENE_LISTED
// subsystems. The caller closes, on failure too. Fails as pm_monolithic_open and
// pm_ledger_add_sample do.
pm_status pm_local_run_open(pm_local_run *run, const pm_setup *setup, bool sums);
void pm_local_run_close(pm_local_run *run);

// Starts again at step 0 from the state z [scene->nz] with an empty ledger. Fails as
// pm_ledger_add_sample.
pm_status pm_local_run_start(pm_local_run *run, const double *z);

// Takes one step and enters it in the ledger. Fails as pm_subsystem_end_step and
// pm_ledger_add_sample do.
pm_status pm_local_run_step(pm_local_run *run);

#endif
