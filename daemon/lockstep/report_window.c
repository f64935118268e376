// A ring of samples, by step modulo the depth of the window.
#include "lockstep/report_window.h"

#include <string.h>

#include "lockstep/lookahead.h"

static pm_report_window_slot *slot_of(const pm_report_window *window, int64_t step) {
    return &window->slot[step % window->depth];
}

static void begin(const pm_report_window *window, int64_t step) {
    const pm_scene *scene = window->scene;
    pm_report_window_slot *slot = slot_of(window, step);
    slot->step = step;
    slot->missing = scene->nprocess;
    memset(slot->has, 0, (size_t)scene->nprocess * sizeof *slot->has);
    slot->sample->step = (long)step;
    slot->sample->time = pm_scene_time(scene, 0, step);
}

pm_status pm_report_window_init(pm_report_window *window, pm_arena *arena, const pm_scene *scene,
                                int64_t first) {
    const int depth = pm_lookahead(scene) + 1;
    const size_t n = (size_t)scene->nprocess;
    window->scene = scene;
    window->slot = pm_arena_array(arena, (size_t)depth, sizeof *window->slot);
    bool *has = pm_arena_array(arena, (size_t)depth * n, sizeof *has);
    if (window->slot == NULL || has == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    for (int i = 0; i < depth; ++i) {
        window->slot[i].has = has + (size_t)i * n;
        PM_TRY(pm_sample_new(&window->slot[i].sample, scene));
        window->depth = i + 1;
    }
    for (int i = 0; i < depth; ++i) {
        begin(window, first + i);
    }
    return PM_OK;
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

int64_t pm_report_window_complete(const pm_report_window *window, int64_t step, int64_t most) {
    while (step < most && slot_of(window, step + 1)->step == step + 1 &&
           slot_of(window, step + 1)->missing == 0) {
        ++step;
    }
    return step;
}

pm_sample *pm_report_window_sample(const pm_report_window *window, int64_t step) {
    return slot_of(window, step)->sample;
}

void pm_report_window_advance(pm_report_window *window, int64_t step) {
    begin(window, step + window->depth);
}
