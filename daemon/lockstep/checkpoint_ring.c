// Two checkpoints, and the file that holds both.
#include "lockstep/checkpoint_ring.h"

#include <string.h>

#include "lockstep/codec.h"
#include "store/snapshot.h"

int64_t pm_checkpoint_ring_interval(const pm_scene *scene) {
    const int64_t least = 2 * (int64_t)scene->window;
    return scene->checkpoint > least ? scene->checkpoint : least;
}

// Lists the numbers of a checkpoint, the step first.
static void list(pm_record *record, long *step, pm_process_subsystems *group) {
    pm_record_put_long(record, "step", step);
    pm_process_subsystems_record(group, record);
}

// Saves the group's state after `step` steps to a checkpoint [size].
static void save_state(double *checkpoint, long step, pm_process_subsystems *group) {
    pm_record record = pm_record_save("node", checkpoint);
    list(&record, &step, group);
}

static double *newer(const pm_checkpoint_ring *h) {
    return h->memory + h->size;
}

pm_status pm_checkpoint_ring_init(pm_checkpoint_ring *history, pm_arena *arena, const char *path,
                                  const pm_system *system, pm_process_subsystems *group) {
    pm_checkpoint_ring *h = history;
    h->path = path;
    if (path == NULL) {
        return PM_OK;
    }
    h->digest = system->digest;
    h->interval = pm_checkpoint_ring_interval(system->scene);
    long start = 0;
    pm_record record = pm_record_count("node");
    list(&record, &start, group);
    h->layout = record.layout;
    h->size = record.count;
    h->memory = pm_arena_array(arena, 2 * (size_t)h->size, sizeof *h->memory);
    if (h->memory == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", path);
    }
    h->memory[0] = -1;
    save_state(newer(h), start, group);
    return PM_OK;
}

static pm_snapshot_key key_of(const pm_checkpoint_ring *h) {
    return (pm_snapshot_key){.digest = h->digest, .layout = h->layout, .count = 2 * h->size};
}

static pm_status save(const pm_checkpoint_ring *h, int64_t session) {
    const pm_snapshot_key key = key_of(h);
    return pm_snapshot_save(h->path, &key, session, h->memory);
}

pm_status pm_checkpoint_ring_knows(const pm_checkpoint_ring *history, int64_t session,
                                   bool *known) {
    int64_t found_session = 0;
    bool found = false;
    if (history->path != NULL) {
        PM_TRY(pm_snapshot_session(history->path, history->digest, &found_session, &found));
    }
    *known = found && found_session == session;
    return PM_OK;
}

pm_status pm_checkpoint_ring_begin(pm_checkpoint_ring *history, int64_t session) {
    const pm_checkpoint_ring *h = history;
    bool known;
    PM_TRY(pm_checkpoint_ring_knows(h, session, &known));
    if (!known) {
        return save(h, session);
    }
    const pm_snapshot_key key = key_of(h);
    PM_TRY(pm_snapshot_load(h->path, &key, &session, h->memory, &known));
    for (int i = 0; i < 2; ++i) {
        const double step = h->memory[i * h->size];
        if (step < -1 || step > (double)PM_STEPS_MAX) {
            return pm_fail(PM_EFILE, "%s: a snapshot of step %g", h->path, step);
        }
    }
    return PM_OK;
}

pm_status pm_checkpoint_ring_note(pm_checkpoint_ring *history, int64_t session, int64_t step,
                                  pm_process_subsystems *group) {
    const pm_checkpoint_ring *h = history;
    if (h->path == NULL || step % h->interval != 0 || step == 0) {
        return PM_OK;
    }
    memcpy(h->memory, newer(h), (size_t)h->size * sizeof *h->memory);
    save_state(newer(h), (long)step, group);
    return save(h, session);
}

int64_t pm_checkpoint_ring_go_back(pm_checkpoint_ring *history, int64_t step,
                                   pm_process_subsystems *group) {
    const pm_checkpoint_ring *h = history;
    if (h->path == NULL) {
        return -1;
    }
    if ((double)step < newer(h)[0]) {
        if (h->memory[0] < 0 || (double)step < h->memory[0]) {
            return -1;
        }
        memcpy(newer(h), h->memory, (size_t)h->size * sizeof *h->memory);
        h->memory[0] = -1;
    }
    long found = 0;
    pm_record record = pm_record_restore("node", newer(h));
    list(&record, &found, group);
    return found;
}
