// The checkpoint of a coordinator.
#include "lockstep/checkpoint_ring.h"
#include "lockstep/coordinator.h"
#include "store/snapshot.h"

static pm_status save(const pm_lockstep_coordinator *c) {
    const pm_snapshot_key key = {.digest = c->endpoint.system->digest, .count = c->nmemory};
    return pm_snapshot_save(c->checkpoint, &key, c->endpoint.session, c->memory);
}

pm_status pm_coordinator_remember(pm_lockstep_coordinator *c) {
    c->memory[0] = (double)c->completed;
    pm_ledger_save(&c->ledger, c->memory + 1);
    if (c->observer.nmemory > 0) {
        PM_TRY(c->observer.save(c->observer.context, c->memory + 1 + PM_LEDGER_MEMORY));
    }
    return save(c);
}

pm_status pm_coordinator_recall(pm_lockstep_coordinator *c, int64_t wanted) {
    int64_t session;
    bool found;
    c->interval = pm_checkpoint_ring_interval(c->endpoint.system->scene);
    if (c->checkpoint == NULL) {
        return PM_OK;
    }
    c->nmemory = 1 + PM_LEDGER_MEMORY + c->observer.nmemory;
    c->memory = pm_arena_array(&c->arena, (size_t)c->nmemory, sizeof *c->memory);
    if (c->memory == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    c->memory[0] = -1;
    PM_TRY(pm_snapshot_session(c->checkpoint, c->endpoint.system->digest, &session, &found));
    if (!found || (wanted > 0 && wanted != session)) {
        return save(c);
    }
    const pm_snapshot_key key = {.digest = c->endpoint.system->digest, .count = c->nmemory};
    PM_TRY(pm_snapshot_load(c->checkpoint, &key, &c->endpoint.session, c->memory, &found));
    if (c->memory[0] < -1 || c->memory[0] > (double)c->endpoint.steps) {
        return pm_fail(PM_EFILE, "%s: a snapshot of step %g, the run has %lld", c->checkpoint,
                       c->memory[0], (long long)c->endpoint.steps);
    }
    c->completed = (int64_t)c->memory[0];
    if (c->completed < 0) {
        return PM_OK;
    }
    pm_ledger_restore(&c->ledger, c->memory + 1);
    c->granted = pm_coordinator_limit(c, c->completed);
    c->tick_wanted = true;
    return c->observer.nmemory == 0 ? PM_OK
                                    : c->observer.restore(c->observer.context, (long)c->completed,
                                                          c->memory + 1 + PM_LEDGER_MEMORY);
}
