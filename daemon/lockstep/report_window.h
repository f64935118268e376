// The report window holds the steps whose reports are collected at the same time. Each step has a
// sample, which is complete when every process has reported the step. A coordinator collects as
// many steps as it may grant ahead (lookahead.h), and one more. It takes the samples out in the
// order of their steps, and the window then advances by one step. A listener (listener.h) may miss
// reports: a later step takes the place of an earlier one, complete or not.
#ifndef PM_LOCKSTEP_REPORT_WINDOW_H
#define PM_LOCKSTEP_REPORT_WINDOW_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "scene/recording.h"
#include "sim/tally.h"

// One step of the window.
typedef struct pm_report_window_slot {
    int64_t step;
    int missing; // number of processes that have not reported the step
    bool *has;   // [nprocess] true for each process that has reported the step
    pm_sample *sample;
    pm_tally tally; // the sums of the reports so far
} pm_report_window_slot;

// The caller owns this storage and initialises it with zeros.
typedef struct pm_report_window {
    const pm_scene *scene;
    int depth;                   // steps
    pm_report_window_slot *slot; // [depth], by step modulo depth
} pm_report_window;

// Makes a window of `depth` steps, the first of which is `first`. PM_ENOMEM. The caller frees the
// window, on failure too.
pm_status pm_report_window_init(pm_report_window *window, pm_arena *arena, const pm_scene *scene,
                                int depth, int64_t first);
void pm_report_window_free(pm_report_window *window);

// Returns the sample into which a process's report of a step is to be written. NULL: the step is
// outside the window, or the process has reported it already.
pm_sample *pm_report_window_missing(const pm_report_window *window, int64_t step, int process_id);

// Marks the report of a step as written.
void pm_report_window_mark(pm_report_window *window, int64_t step, int process_id);

// Returns true if the step is in the window and the process has reported it.
bool pm_report_window_has(const pm_report_window *window, int64_t step, int process_id);

// Returns the last step, at most `most`, up to which the reports of all steps after `step` have
// arrived; `step` if the next one is incomplete.
int64_t pm_report_window_complete(const pm_report_window *window, int64_t step, int64_t most);

// Returns the sample of a step in the window, which owns it.
pm_sample *pm_report_window_sample(const pm_report_window *window, int64_t step);

// Returns the tally of a step in the window, which owns it.
pm_tally *pm_report_window_tally(const pm_report_window *window, int64_t step);

// Discards all samples; the window then begins at the step `first`.
void pm_report_window_restart(pm_report_window *window, int64_t first);

// Makes room for `step` by discarding the earlier step that has its place. Returns that earlier
// step, or -1 if the window holds `step` already, or holds a later step in its place.
int64_t pm_report_window_reach(pm_report_window *window, int64_t step);

// Returns true if the step is in the window and every process has reported it.
bool pm_report_window_is_complete(const pm_report_window *window, int64_t step);

// Discards the sample of `step` and gives its place to the step `step + depth`, where `depth` is
// the number of steps in the window.
void pm_report_window_advance(pm_report_window *window, int64_t step);

#endif
