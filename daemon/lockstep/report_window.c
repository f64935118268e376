// A ring of samples, by step modulo the depth of the window.
#include "lockstep/report_window.h"

#include <string.h>

static pm_report_window_slot *slot_of(const pm_report_window *window, int64_t step) {
    return &window->slot[step % window->depth];
}

static void begin(const pm_report_window *window, int64_t step) {
    const pm_scene *scene = window->scene;
    pm_report_window_slot *slot = slot_of(window, step);
    slot->step = step;
    slot->missing = scene->nprocess;
    slot->tally = (pm_tally){0};
    memset(slot->has, 0, (size_t)scene->nprocess * sizeof *slot->has);
    slot->sample->step = (long)step;
    slot->sample->time = pm_scene_time(scene, 0, step);
}

pm_status pm_report_window_init(pm_report_window *window, pm_arena *arena, const pm_scene *scene,
                                int depth, int64_t first) {
    const size_t n = (size_t)scene->nprocess;
    window->scene = scene;
    window->slot = pm_arena_array(arena, (size_t)depth, sizeof *window->slot);
    bool *has = pm_arena_array(arena, (size_t)depth * n, sizeof *has);
    if (window->slot == NULL || has == NULL) {
        return pm_fail(PM_ENOMEM, "reports: out of memory");
    }
    for (int i = 0; i < depth; ++i) {
        window->slot[i].has = has + (size_t)i * n;
        PM_TRY(pm_sample_new(&window->slot[i].sample, scene));
        window->depth = i + 1;
    }
    pm_report_window_restart(window, first);
    return PM_OK;
}

void pm_report_window_restart(pm_report_window *window, int64_t first) {
    for (int i = 0; i < window->depth; ++i) {
        begin(window, first + i);
    }
}

int64_t pm_report_window_reach(pm_report_window *window, int64_t step) {
    const int64_t before = slot_of(window, step)->step;
    if (before >= step) {
        return -1;
    }
    begin(window, step);
    return before;
}

void pm_report_window_free(pm_report_window *window) {
    for (int i = 0; i < window->depth; ++i) {
        pm_sample_free(window->slot[i].sample);
    }
}

pm_sample *pm_report_window_missing(const pm_report_window *window, int64_t step, int process_id) {
    const pm_report_window_slot *slot = slot_of(window, step);
    return slot->step == step && !slot->has[process_id] ? slot->sample : NULL;
}

void pm_report_window_mark(pm_report_window *window, int64_t step, int process_id) {
    pm_report_window_slot *slot = slot_of(window, step);
    slot->has[process_id] = true;
    slot->missing -= 1;
}

bool pm_report_window_has(const pm_report_window *window, int64_t step, int process_id) {
    const pm_report_window_slot *slot = slot_of(window, step);
    return slot->step == step && slot->has[process_id];
}

bool pm_report_window_is_complete(const pm_report_window *window, int64_t step) {
    const pm_report_window_slot *slot = slot_of(window, step);
    return slot->step == step && slot->missing == 0;
}

int64_t pm_report_window_complete(const pm_report_window *window, int64_t step, int64_t most) {
    while (step < most && pm_report_window_is_complete(window, step + 1)) {
        ++step;
    }
    return step;
}

pm_sample *pm_report_window_sample(const pm_report_window *window, int64_t step) {
    return slot_of(window, step)->sample;
}

pm_tally *pm_report_window_tally(const pm_report_window *window, int64_t step) {
    return &slot_of(window, step)->tally;
}

void pm_report_window_advance(pm_report_window *window, int64_t step) {
    begin(window, step + window->depth);
}
