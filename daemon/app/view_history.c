// A list of frames that is thinned when it is full.
#include "app/view_history.h"

#include <string.h>

#define MOST_NUMBERS (4 << 20) // of all frames together: 32 MiB
#define LEAST_FRAMES 16

pm_status pm_view_history_init(pm_view_history *history, pm_arena *arena, int width) {
    const int room = MOST_NUMBERS / width / 2 * 2;
    history->width = width;
    history->capacity = room < LEAST_FRAMES         ? LEAST_FRAMES
                        : room > PM_VIEW_REMEMBERED ? PM_VIEW_REMEMBERED
                                                    : room;
    history->stride = 1;
    const size_t capacity = (size_t)history->capacity, size = sizeof *history->frame;
    history->number = pm_arena_array(arena, capacity, sizeof *history->number);
    history->frame = pm_arena_array(arena, capacity * (size_t)width, size);
    history->newest_frame = pm_arena_array(arena, (size_t)width, size);
    return history->number != NULL && history->frame != NULL && history->newest_frame != NULL
               ? PM_OK
               : pm_fail(PM_ENOMEM, "view: out of memory for frames");
}

void pm_view_history_clear(pm_view_history *history) {
    history->count = 0;
    history->stride = 1;
}

static double *row(const pm_view_history *h, int i) {
    return h->frame + (size_t)i * (size_t)h->width;
}

static void thin(pm_view_history *h) {
    const size_t size = (size_t)h->width * sizeof *h->frame;
    h->count /= 2;
    h->stride *= 2;
    for (int i = 1; i < h->count; ++i) {
        h->number[i] = h->number[2 * i];
        memcpy(row(h, i), row(h, 2 * i), size);
    }
}

void pm_view_history_add(pm_view_history *history, const double *frame) {
    pm_view_history *h = history;
    const size_t size = (size_t)h->width * sizeof *frame;
    h->newest += 1;
    memcpy(h->newest_frame, frame, size);
    if (h->count > 0 && h->newest < h->number[h->count - 1] + h->stride) {
        return;
    }
    if (h->count == h->capacity) {
        thin(h);
    }
    h->number[h->count] = h->newest;
    memcpy(row(h, h->count++), frame, size);
}

const double *pm_view_history_next(const pm_view_history *history, int64_t *number) {
    const pm_view_history *h = history;
    int low = 0, high = h->count;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (h->number[middle] <= *number) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    if (low < h->count) {
        *number = h->number[low];
        return row(h, low);
    }
    if (h->count == 0 || h->newest <= *number) {
        return NULL;
    }
    *number = h->newest;
    return h->newest_frame;
}
