// Reads the frames of a recording (scene/recording.h) that a view shows.
#ifndef PM_APP_VIEW_RECORDING_H
#define PM_APP_VIEW_RECORDING_H

#include "app/view_graph.h"
#include "app/view_history.h"

// Reads frames of the recording at `path` into an empty history: all samples, or as many as the
// history remembers, evenly spread. A number that the recording does not have is not a number
// (NaN). PM_EFILE: the file cannot be read, or is no recording of this scene. PM_ENOMEM.
pm_status pm_view_recording_read(const char *path, const pm_view_graph *graph,
                                 pm_view_history *history);

#endif
