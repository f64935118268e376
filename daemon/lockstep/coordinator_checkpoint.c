// The checkpoint of a coordinator: the number of steps completed and the numbers of the ledger and
// of the observer, in one file (store/snapshot.h).
#include "lockstep/checkpoint_ring.h"
#include "lockstep/coordinator.h"
#include "store/snapshot.h"

// Lists the numbers of the checkpoint, the steps completed first.
static void list(pm_lockstep_coordinator *c, pm_record *record, long *completed) {
    pm_record_put_long(record, "completed", completed);
    pm_ledger_record(&c->ledger, record);
    if (c->observer.record != NULL) {
        c->observer.record(c->observer.context, record);
    }
}

static pm_status save(const pm_lockstep_coordinator *c) {
    return pm_snapshot_save(c->checkpoint, &c->checkpoint_key, c->endpoint.session,
                            c->checkpoint_state);
}

// Allocates the numbers of the checkpoint, whose number of complete steps is -1: none.
static pm_status allocate(pm_lockstep_coordinator *c) {
    long completed = -1;
    pm_record record = pm_record_count("coordinator");
    list(c, &record, &completed);
    c->checkpoint_key = (pm_snapshot_key){c->endpoint.system->digest, record.layout, record.count};
    c->checkpoint_state =
        pm_arena_array(&c->arena, (size_t)record.count, sizeof *c->checkpoint_state);
    if (c->checkpoint_state == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory");
    }
    c->checkpoint_state[0] = (double)completed;
    return PM_OK;
}

pm_status pm_coordinator_save_checkpoint(pm_lockstep_coordinator *c) {
    long completed = (long)c->completed;
    pm_record record = pm_record_save("coordinator", c->checkpoint_state);
    list(c, &record, &completed);
    if (c->observer.flush != NULL) {
        PM_TRY(c->observer.flush(c->observer.context));
    }
    return save(c);
}

pm_status pm_coordinator_load_checkpoint(pm_lockstep_coordinator *c, int64_t wanted) {
    int64_t session;
    bool found;
    c->interval = pm_checkpoint_ring_interval(c->endpoint.system->scene);
    if (c->checkpoint == NULL) {
        return PM_OK;
    }
    PM_TRY(allocate(c));
    PM_TRY(pm_snapshot_session(c->checkpoint, c->endpoint.system->digest, &session, &found));
    if (!found || (wanted > 0 && wanted != session)) {
        return save(c);
    }
    PM_TRY(pm_snapshot_load(c->checkpoint, &c->checkpoint_key, &c->endpoint.session,
                            c->checkpoint_state, &found));
    if (c->checkpoint_state[0] < -1 || c->checkpoint_state[0] > (double)c->endpoint.steps) {
        return pm_fail(PM_EFILE, "%s: a snapshot of step %g, the run has %lld", c->checkpoint,
                       c->checkpoint_state[0], (long long)c->endpoint.steps);
    }
    c->completed = (int64_t)c->checkpoint_state[0];
    if (c->completed < 0) {
        return PM_OK;
    }
    long completed = 0;
    pm_record record = pm_record_restore("coordinator", c->checkpoint_state);
    list(c, &record, &completed);
    c->granted = pm_coordinator_grant_limit(c, c->completed);
    c->tick_wanted = true;
    return c->observer.resume == NULL ? PM_OK : c->observer.resume(c->observer.context, completed);
}
