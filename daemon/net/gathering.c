// A ring of samples.
#include "net/gathering.h"

#include <string.h>

#include "net/lead.h"

static pm_gathering_slot *slot_of(const pm_gathering *gathering, int64_t step) {
    return &gathering->slot[step % gathering->depth];
}

static void begin(const pm_gathering *gathering, int64_t step) {
    const pm_scene *scene = gathering->scene;
    pm_gathering_slot *slot = slot_of(gathering, step);
    slot->step = step;
    slot->missing = scene->nprocess;
    memset(slot->has, 0, (size_t)scene->nprocess * sizeof *slot->has);
    slot->sample->step = (long)step;
    slot->sample->time = (double)step * scene->dt;
}

pm_status pm_gathering_init(pm_gathering *gathering, pm_arena *arena, const pm_scene *scene,
                            int64_t first) {
    pm_gathering *g = gathering;
    const int depth = pm_lead(scene) + 1;
    const size_t n = (size_t)scene->nprocess;
    g->scene = scene;
    g->slot = pm_arena_array(arena, (size_t)depth, sizeof *g->slot);
    bool *has = pm_arena_array(arena, (size_t)depth * n, sizeof *has);
    if (g->slot == NULL || has == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    for (int i = 0; i < depth; ++i) {
        g->slot[i].has = has + (size_t)i * n;
        PM_TRY(pm_sample_new(&g->slot[i].sample, scene));
        g->depth = i + 1;
    }
    for (int i = 0; i < depth; ++i) {
        begin(g, first + i);
    }
    return PM_OK;
}

void pm_gathering_free(pm_gathering *gathering) {
    for (int i = 0; i < gathering->depth; ++i) {
        pm_sample_free(gathering->slot[i].sample);
    }
}

pm_sample *pm_gathering_wants(const pm_gathering *gathering, int64_t step, int process_id) {
    const pm_gathering_slot *slot = slot_of(gathering, step);
    return slot->step == step && !slot->has[process_id] ? slot->sample : NULL;
}

void pm_gathering_take(pm_gathering *gathering, int64_t step, int process_id) {
    pm_gathering_slot *slot = slot_of(gathering, step);
    slot->has[process_id] = true;
    slot->missing -= 1;
}

bool pm_gathering_has(const pm_gathering *gathering, int64_t step, int process_id) {
    const pm_gathering_slot *slot = slot_of(gathering, step);
    return slot->step == step && slot->has[process_id];
}

int64_t pm_gathering_complete(const pm_gathering *gathering, int64_t step, int64_t most) {
    while (step < most && slot_of(gathering, step + 1)->step == step + 1 &&
           slot_of(gathering, step + 1)->missing == 0) {
        ++step;
    }
    return step;
}

pm_sample *pm_gathering_sample(const pm_gathering *gathering, int64_t step) {
    return slot_of(gathering, step)->sample;
}

void pm_gathering_move_on(pm_gathering *gathering, int64_t step) {
    begin(gathering, step + gathering->depth);
}
