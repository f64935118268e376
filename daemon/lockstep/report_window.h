// The steps whose reports the coordinator gathers: as many samples as may be granted ahead
// (lookahead.h), each complete when every process has reported it.
#ifndef PM_LOCKSTEP_REPORT_WINDOW_H
#define PM_LOCKSTEP_REPORT_WINDOW_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "scene/recording.h"

typedef struct pm_report_window_slot {
    int64_t step;
    int missing; // processes that have not reported it
    bool *has;   // [nprocess]
    pm_sample *sample;
} pm_report_window_slot;

// Storage the caller owns; zero-initialise.
typedef struct pm_report_window {
    const pm_scene *scene;
    int depth;                   // steps that are gathered at once
    pm_report_window_slot *slot; // [depth] by step modulo depth
} pm_report_window;

// Room for the steps from `first` on, one more than the scene's lead (lookahead.h). PM_ENOMEM.
// _free, on failure too.
pm_status pm_report_window_init(pm_report_window *window_reports, pm_arena *arena,
                                const pm_scene *scene, int64_t first);
void pm_report_window_free(pm_report_window *window_reports);

// Where a process's report of a step is to be written; NULL if the step is not being gathered, or
// the process has reported it.
pm_sample *pm_report_window_wants(const pm_report_window *window_reports, int64_t step,
                                  int process_id);
void pm_report_window_take(pm_report_window *window_reports, int64_t step,
                           int process_id); // it is written

bool pm_report_window_has(const pm_report_window *window_reports, int64_t step, int process_id);

// The last of the steps that follow `step`, up to `most`, whose reports are all there; `step` if
// there is none.
int64_t pm_report_window_complete(const pm_report_window *window_reports, int64_t step,
                                  int64_t most);

pm_sample *pm_report_window_sample(const pm_report_window *window_reports, int64_t step);

// Makes room for the step that is `depth` later.
void pm_report_window_move_on(pm_report_window *window_reports, int64_t step);

#endif
