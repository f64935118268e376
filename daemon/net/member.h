// What the coordinator holds of one node: its last reports and states, until every other node has
// reported the same step.
#ifndef PM_NET_MEMBER_H
#define PM_NET_MEMBER_H

#include <stdbool.h>

#include "net/codec.h"
#include "net/transport.h"
#include "store/recording.h"

// Storage the caller owns.
typedef struct pm_member {
    struct pm_lockstep_coordinator *coordinator; // whose it is
    int subsystem_id;
    const pm_scene_subsystem *subsystem;
    char report_channel[PM_CHANNEL_SIZE], state_channel[PM_CHANNEL_SIZE];
    int nport;
    int *port; // [nport] 2 * position in the scene + end; those of the world come last
    portmet_report_t report_scratch; // being decoded
    portmet_state_t state_scratch;
    int depth;                // steps kept
    portmet_report_t *report; // [depth], by step modulo depth; step -1: empty
    portmet_state_t *state;   // [depth]
    bool alive;               // heard of since the last poll
    bool left;                // said BYE
    double heard;             // s, when heard of
} pm_member;

// Names, shapes and memory (from the arena). PM_ECONFIG, PM_ENOMEM.
pm_status pm_member_init(pm_member *member, pm_arena *arena, const pm_scene *scene,
                         int subsystem_id, int depth);

bool pm_member_has_report(const pm_member *member, int64_t step);
bool pm_member_has_state(const pm_member *member, int64_t step);

// Keep what is in the scratch message; PM_DROP_REPEATED if it is there already. Its step is >= 0.
pm_drop pm_member_keep_report(pm_member *member);
pm_drop pm_member_keep_state(pm_member *member);

// Writes this node's part of a step's sample; z if the state is there.
void pm_member_fill_sample(const pm_member *member, int64_t step, pm_sample *sample);

#endif
