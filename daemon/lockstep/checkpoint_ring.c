// Keeps two checkpoints in memory and in one file (store/snapshot.h).
#include "lockstep/checkpoint_ring.h"

#include <string.h>

#include "lockstep/codec.h"
#include "store/snapshot.h"

int64_t pm_checkpoint_ring_interval(const pm_scene *scene) {
    const int64_t least = 2 * (int64_t)scene->window;
    return scene->checkpoint > least ? scene->checkpoint : least;
}

// Lists the numbers of a checkpoint, the step first.
static void list(pm_record *record, long *step, pm_process_subsystems *subsystems) {
    pm_record_put_long(record, "step", step);
    pm_local_subsystems_record(subsystems->local, record);
}

// Saves the state of the subsystems after `step` steps to a checkpoint [size].
static void save_state(double *checkpoint, long step, pm_process_subsystems *subsystems) {
    pm_record record = pm_record_save("node", checkpoint);
    list(&record, &step, subsystems);
}

static double *newer(const pm_checkpoint_ring *ring) {
    return ring->state + ring->size;
}

pm_status pm_checkpoint_ring_init(pm_checkpoint_ring *ring, pm_arena *arena, const char *path,
                                  const pm_system *system, pm_process_subsystems *subsystems) {
    ring->path = path;
    if (path == NULL) {
        return PM_OK;
    }
    ring->digest = system->digest;
    ring->interval = pm_checkpoint_ring_interval(system->scene);
    long start = 0;
    pm_record record = pm_record_count("node");
    list(&record, &start, subsystems);
    ring->layout = record.layout;
    ring->size = record.count;
    ring->state = pm_arena_array(arena, 2 * (size_t)ring->size, sizeof *ring->state);
    if (ring->state == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", path);
    }
    ring->state[0] = -1;
    save_state(newer(ring), start, subsystems);
    return PM_OK;
}

int64_t pm_checkpoint_ring_newest(const pm_checkpoint_ring *ring) {
    return ring->path == NULL ? -1 : (int64_t)newer(ring)[0];
}

static pm_snapshot_key key_of(const pm_checkpoint_ring *ring) {
    return (pm_snapshot_key){
        .digest = ring->digest, .layout = ring->layout, .count = 2 * ring->size};
}

static pm_status save(const pm_checkpoint_ring *ring, int64_t session) {
    const pm_snapshot_key key = key_of(ring);
    return pm_snapshot_save(ring->path, &key, session, ring->state);
}

pm_status pm_checkpoint_ring_has_session(const pm_checkpoint_ring *ring, int64_t session,
                                         bool *known) {
    int64_t found_session = 0;
    bool found = false;
    if (ring->path != NULL) {
        PM_TRY(pm_snapshot_session(ring->path, ring->digest, &found_session, &found));
    }
    *known = found && found_session == session;
    return PM_OK;
}

pm_status pm_checkpoint_ring_load_or_create(pm_checkpoint_ring *ring, int64_t session) {
    bool known;
    PM_TRY(pm_checkpoint_ring_has_session(ring, session, &known));
    if (!known) {
        return save(ring, session);
    }
    const pm_snapshot_key key = key_of(ring);
    PM_TRY(pm_snapshot_load(ring->path, &key, &session, ring->state, &known));
    for (int i = 0; i < 2; ++i) {
        const double step = ring->state[i * ring->size];
        if (step < -1 || step > (double)PM_STEPS_MAX) {
            return pm_fail(PM_EFILE, "%s: a snapshot of step %g", ring->path, step);
        }
    }
    return PM_OK;
}

pm_status pm_checkpoint_ring_save_due(pm_checkpoint_ring *ring, int64_t session, int64_t step,
                                      pm_process_subsystems *subsystems) {
    if (ring->path == NULL || step % ring->interval != 0 || step == 0) {
        return PM_OK;
    }
    memcpy(ring->state, newer(ring), (size_t)ring->size * sizeof *ring->state);
    save_state(newer(ring), (long)step, subsystems);
    return save(ring, session);
}

int64_t pm_checkpoint_ring_roll_back(pm_checkpoint_ring *ring, int64_t step,
                                     pm_process_subsystems *subsystems) {
    if (ring->path == NULL) {
        return -1;
    }
    if ((double)step < newer(ring)[0]) {
        if (ring->state[0] < 0 || (double)step < ring->state[0]) {
            return -1;
        }
        memcpy(newer(ring), ring->state, (size_t)ring->size * sizeof *ring->state);
        ring->state[0] = -1;
    }
    long found = 0;
    pm_record record = pm_record_restore("node", newer(ring));
    list(&record, &found, subsystems);
    return found;
}
