// A gate holds a run at a step, so that somebody can act there: look at it, stop a process, pull a
// cable. The coordinator grants no step beyond the number in a file. While the run stands at the
// gate the coordinator reads the file again every few milliseconds; otherwise it leaves it alone.
#ifndef PM_LOCKSTEP_GATE_H
#define PM_LOCKSTEP_GATE_H

#include <stdint.h>

#include "base/status.h"

// Storage the caller owns.
typedef struct pm_gate {
    const char *path; // NULL: there is no gate
    int64_t steps;    // that may be granted, as the file said last; INT64_MAX without a gate
    double read_at;   // s, when to read the file again
} pm_gate;

// Reads the file; `path` must outlive the gate. A file that is absent or empty allows no step.
// PM_EFILE: the file cannot be read, or holds something else than a whole number.
pm_status pm_gate_init(pm_gate *gate, const char *path);

// Reads the file again if it is time to. PM_EFILE.
pm_status pm_gate_look(pm_gate *gate, double now);

#endif
