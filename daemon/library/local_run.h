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

// A caller needs one of these of a run.
typedef enum pm_local_need {
    PM_LOCAL_SUMS,    // of the samples no more than the first PM_SCENE_LISTED subsystems
    PM_LOCAL_SAMPLES, // whole samples
    PM_LOCAL_UNDO     // whole samples, and a step that fails is not taken
} pm_local_need;

// The caller owns this storage.
typedef struct pm_local_run {
    const pm_setup *setup; // borrowed
    pm_monolithic *monolithic;
    pm_ledger ledger;
    pm_local_need need;
    pm_sample sample;        // of the state reached; its arrays belong to `monolithic`
    pm_recording *recording; // borrowed, set by the caller: takes every step; NULL: nobody records
} pm_local_run;

// Opens all subsystems of a completed setup, which is borrowed, and starts at its initial state.
// The caller closes, on failure too. Fails as pm_monolithic_open and pm_ledger_add_sample do.
pm_status pm_local_run_open(pm_local_run *run, const pm_setup *setup, pm_local_need need);
void pm_local_run_close(pm_local_run *run);

// Starts again at step 0 from the state z [scene->nz] with an empty ledger. Fails as
// pm_ledger_add_sample.
pm_status pm_local_run_start(pm_local_run *run, const double *z);

// Takes one step, enters it in the ledger and records it. Fails as pm_monolithic_step does, with
// the sample and the ledger as they were, and as pm_ledger_add_sample and pm_recording_append do,
// after which they are those of the step unless the run undoes it.
pm_status pm_local_run_step(pm_local_run *run);

#endif
