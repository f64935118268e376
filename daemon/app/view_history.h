// The frames of a run that a view remembers: some hundred that are spread over the whole run, and
// the newest one. Whenever the memory is full, every second frame is forgotten and from then on
// half as many are kept. A frame is a row of numbers (view_graph.h).
#ifndef PM_APP_VIEW_HISTORY_H
#define PM_APP_VIEW_HISTORY_H

#include <stdint.h>

#include "base/arena.h"
#include "base/status.h"

#define PM_VIEW_REMEMBERED 512 // frames at most; large frames are fewer

// The caller owns this storage and initialises it with zeros.
typedef struct pm_view_history {
    int width;            // numbers in a frame
    int capacity;         // frames, an even number
    int count;            // frames kept
    int64_t stride;       // one of so many frames is kept
    int64_t newest;       // number of the newest frame; the first one has the number 1; 0: none
    int64_t *number;      // [capacity] numbers of the frames, ascending
    double *frame;        // [capacity][width]
    double *newest_frame; // [width]
} pm_view_history;

// Makes an empty history of frames of `width` numbers, with memory from the arena. PM_ENOMEM.
pm_status pm_view_history_init(pm_view_history *history, pm_arena *arena, int width);

// Forgets all frames. Later frames go on with the numbers of those before.
void pm_view_history_clear(pm_view_history *history);

// Adds a copy of frame [width].
void pm_view_history_add(pm_view_history *history, const double *frame);

// Returns the first frame that is remembered with a number above `*number`, and sets `*number` to
// its number; NULL if there is none. The history owns the frame until the next call that adds one.
const double *pm_view_history_next(const pm_view_history *history, int64_t *number);

#endif
