// The checkpoints of a process: what its group must remember, at the last two of every `interval`
// steps from the start of the run on, in memory and in a file. A process that returns from its
// death goes on from the newest; one that is asked for what it no longer holds goes back to the
// newest before that. As no process is ever ahead of another by more than an interval less one
// step, all of them hold a common one.
#ifndef PM_LOCKSTEP_CHECKPOINT_RING_H
#define PM_LOCKSTEP_CHECKPOINT_RING_H

#include "lockstep/process_subsystems.h"

// Storage the caller owns; zero-initialise.
typedef struct pm_checkpoint_ring {
    const char *path; // NULL: nothing is kept
    uint64_t digest;
    int64_t interval; // steps
    uint64_t layout;  // of the numbers of a checkpoint (base/record.h)
    int size;         // number of these: the step, then the group's
    double *memory;   // [2][size], the older first; step -1: none
} pm_checkpoint_ring;

// Steps between two checkpoints: as the scene says, or twice its window if that is more.
int64_t pm_checkpoint_ring_interval(const pm_scene *scene);

// Begins with the group's present state, as of step 0; memory from the arena. PM_ENOMEM.
pm_status pm_checkpoint_ring_init(pm_checkpoint_ring *history, pm_arena *arena, const char *path,
                                  const pm_system *system, pm_process_subsystems *group);

// Whether the file is one of this session. PM_EFILE.
pm_status pm_checkpoint_ring_knows(const pm_checkpoint_ring *history, int64_t session, bool *known);

// Takes over the file, if it is of this session; else writes it, so that this process will be known
// to be of the session. PM_EFILE.
pm_status pm_checkpoint_ring_begin(pm_checkpoint_ring *history, int64_t session);

// `step` steps are complete: keeps the group's state if it is time to. PM_EFILE.
pm_status pm_checkpoint_ring_note(pm_checkpoint_ring *history, int64_t session, int64_t step,
                                  pm_process_subsystems *group);

// Brings the group back to the newest checkpoint of at most `step` steps, and forgets later ones.
// Returns its step; -1: there is none, and the group is as it was.
int64_t pm_checkpoint_ring_go_back(pm_checkpoint_ring *history, int64_t step,
                                   pm_process_subsystems *group);

#endif
