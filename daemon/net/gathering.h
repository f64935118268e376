// The steps whose reports the coordinator gathers: as many samples as may be granted ahead
// (lead.h), each complete when every process has reported it.
#ifndef PM_NET_GATHERING_H
#define PM_NET_GATHERING_H

#include <stdbool.h>
#include <stdint.h>

#include "base/arena.h"
#include "store/recording.h"

typedef struct pm_gathering_slot {
    int64_t step;
    int missing; // processes that have not reported it
    bool *has;   // [nprocess]
    pm_sample *sample;
} pm_gathering_slot;

// Storage the caller owns; zero-initialise.
typedef struct pm_gathering {
    const pm_scene *scene;
    int depth;               // steps that are gathered at once
    pm_gathering_slot *slot; // [depth] by step modulo depth
} pm_gathering;

// Room for the steps from `first` on, one more than the scene's lead (lead.h). PM_ENOMEM.
// _free, on failure too.
pm_status pm_gathering_init(pm_gathering *gathering, pm_arena *arena, const pm_scene *scene,
                            int64_t first);
void pm_gathering_free(pm_gathering *gathering);

// Where a process's report of a step is to be written; NULL if the step is not being gathered, or
// the process has reported it.
pm_sample *pm_gathering_wants(const pm_gathering *gathering, int64_t step, int process_id);
void pm_gathering_take(pm_gathering *gathering, int64_t step, int process_id); // it is written

bool pm_gathering_has(const pm_gathering *gathering, int64_t step, int process_id);

// The last of the steps that follow `step`, up to `most`, whose reports are all there; `step` if
// there is none.
int64_t pm_gathering_complete(const pm_gathering *gathering, int64_t step, int64_t most);

pm_sample *pm_gathering_sample(const pm_gathering *gathering, int64_t step);

// Makes room for the step that is `depth` later.
void pm_gathering_move_on(pm_gathering *gathering, int64_t step);

#endif
