// A gate holds a run at a step, so that a user or a test can inspect the run, stop a process or
// interrupt the network there. A file contains the number of steps that may be granted. The
// coordinator reads the file at the start, and again every few milliseconds while the gate holds
// the run.
#ifndef PM_LOCKSTEP_GATE_H
#define PM_LOCKSTEP_GATE_H

#include <stdint.h>

#include "base/status.h"

// The caller owns this storage.
typedef struct pm_gate {
    const char *path; // NULL: there is no gate
    int64_t steps;    // steps that may be granted, as last read; INT64_MAX without a gate
    double read_at;   // s, monotonic, when the file may be read again
} pm_gate;

// Opens a gate and reads its file. `path` (NULL: no gate) must outlive the gate. A file that is
// absent or empty allows no step. PM_EFILE: the file cannot be read, or holds something other than
// a whole number.
pm_status pm_gate_init(pm_gate *gate, const char *path);

// Reads the file again if the last reading is old enough. `now` is the present time (s, monotonic).
// PM_EFILE.
pm_status pm_gate_refresh(pm_gate *gate, double now);

#endif
