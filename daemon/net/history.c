// Two checkpoints, and the file that holds both.
#include "net/history.h"

#include <string.h>

#include "net/codec.h"
#include "store/snapshot.h"

int64_t pm_history_interval(const pm_scene *scene) {
    const int64_t least = 2 * (int64_t)scene->window;
    return scene->checkpoint > least ? scene->checkpoint : least;
}

static double *newer(const pm_history *h) {
    return h->memory + h->size;
}

pm_status pm_history_init(pm_history *history, pm_arena *arena, const char *path,
                          const pm_system *system, const pm_crew *crew) {
    pm_history *h = history;
    h->path = path;
    if (path == NULL) {
        return PM_OK;
    }
    h->digest = system->digest;
    h->interval = pm_history_interval(system->scene);
    h->size = 1 + pm_crew_memory(crew);
    h->memory = pm_arena_array(arena, 2 * (size_t)h->size, sizeof *h->memory);
    if (h->memory == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", path);
    }
    h->memory[0] = -1;
    newer(h)[0] = 0;
    pm_crew_save(crew, newer(h) + 1);
    return PM_OK;
}

static pm_status save(const pm_history *h, int64_t session) {
    return pm_snapshot_save(h->path, h->digest, session, 2 * h->size, h->memory);
}

pm_status pm_history_knows(const pm_history *history, int64_t session, bool *known) {
    int64_t found_session = 0;
    bool found = false;
    if (history->path != NULL) {
        PM_TRY(pm_snapshot_session(history->path, history->digest, &found_session, &found));
    }
    *known = found && found_session == session;
    return PM_OK;
}

pm_status pm_history_begin(pm_history *history, int64_t session) {
    const pm_history *h = history;
    bool known;
    PM_TRY(pm_history_knows(h, session, &known));
    if (!known) {
        return save(h, session);
    }
    PM_TRY(pm_snapshot_load(h->path, h->digest, &session, 2 * h->size, h->memory, &known));
    for (int i = 0; i < 2; ++i) {
        const double step = h->memory[i * h->size];
        if (step < -1 || step > (double)PM_STEPS_MAX) {
            return pm_fail(PM_EFILE, "%s: a snapshot of step %g", h->path, step);
        }
    }
    return PM_OK;
}

pm_status pm_history_note(pm_history *history, int64_t session, int64_t step, const pm_crew *crew) {
    const pm_history *h = history;
    if (h->path == NULL || step % h->interval != 0 || step == 0) {
        return PM_OK;
    }
    memcpy(h->memory, newer(h), (size_t)h->size * sizeof *h->memory);
    newer(h)[0] = (double)step;
    pm_crew_save(crew, newer(h) + 1);
    return save(h, session);
}

int64_t pm_history_go_back(pm_history *history, int64_t step, pm_crew *crew) {
    const pm_history *h = history;
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
    pm_crew_restore(crew, newer(h) + 1);
    return (int64_t)newer(h)[0];
}
