// The checkpoints of a process: the state of its subsystems at the last two multiples of `interval`
// steps, in memory and in one file. A process that is restarted after its death continues from the
// newer one. A process that is asked for the message of a step that it no longer holds rolls back
// to its newest checkpoint before that step. No process is ever ahead of another by more than an
// interval less one step, so all of them hold a common checkpoint.
#ifndef PM_LOCKSTEP_CHECKPOINT_RING_H
#define PM_LOCKSTEP_CHECKPOINT_RING_H

#include "lockstep/process_subsystems.h"

// The caller owns this storage and initialises it with zeros.
typedef struct pm_checkpoint_ring {
    const char *path; // NULL: no checkpoints are kept
    uint64_t digest;  // of scene, weights and initial state
    int64_t interval; // steps
    uint64_t layout;  // digest of names and counts of a checkpoint's numbers (base/record.h)
    int size;         // numbers of one checkpoint: its step, then those of the subsystems
    double *state;    // [2][size], the older one first; step -1: none
} pm_checkpoint_ring;

// Returns the number of steps between two checkpoints: the scene's `checkpoint`, but at least twice
// its window.
int64_t pm_checkpoint_ring_interval(const pm_scene *scene);

// Takes the present state of the subsystems as the checkpoint of step 0, with memory from the
// arena. `path` names the file into which the functions below write checkpoints, and must outlive
// the ring; this function writes nothing. If `path` is NULL, no checkpoints are kept, in memory or
// in a file. PM_ENOMEM.
pm_status pm_checkpoint_ring_init(pm_checkpoint_ring *ring, pm_arena *arena, const char *path,
                                  const pm_system *system, pm_process_subsystems *subsystems);

// Returns the step of the newest checkpoint in memory; -1 if none is kept.
int64_t pm_checkpoint_ring_newest(const pm_checkpoint_ring *ring);

// Sets `known` to true if the file holds checkpoints of the run with the number `session`.
// PM_EFILE.
pm_status pm_checkpoint_ring_has_session(const pm_checkpoint_ring *ring, int64_t session,
                                         bool *known);

// Loads the file if it belongs to this session. Otherwise writes it, so that this process finds the
// session again after a restart. PM_EFILE.
pm_status pm_checkpoint_ring_load_or_create(pm_checkpoint_ring *ring, int64_t session);

// Keeps the state after `step` steps, in memory and in the file, if `step` is a positive multiple
// of the interval. PM_EFILE.
pm_status pm_checkpoint_ring_save_due(pm_checkpoint_ring *ring, int64_t session, int64_t step,
                                      pm_process_subsystems *subsystems);

// Restores the subsystems from the newest checkpoint of at most `step` steps, and forgets later
// ones. Returns the checkpoint's step; -1: there is none, and the subsystems stay as they were.
int64_t pm_checkpoint_ring_roll_back(pm_checkpoint_ring *ring, int64_t step,
                                     pm_process_subsystems *subsystems);

#endif
