// The live inputs of a run: numbers that programs send on channels of LCM while the run goes on.
// The coordinator listens to these channels and decides which values hold in a step. The tick that
// grants the step carries them, so that all processes use the same values. In place of the channels
// the values may come from a recording.
//
// Life cycle: zero-initialise; open; then, for every step in turn, ask whether its values are
// there, and take them. All memory belongs to the arena.
#ifndef PM_LOCKSTEP_LIVE_INPUTS_H
#define PM_LOCKSTEP_LIVE_INPUTS_H

#include <stdint.h>

#include "scene/scene.h"
#include "transport/transport.h"

#define PM_LIVE_AHEAD 16 // steps for which values may arrive before their step comes

struct pm_live_inputs;

// A channel keeps the values of the messages that have arrived on it, until their step is granted.
typedef struct pm_live_channel {
    struct pm_live_inputs *owner;
    const pm_scene_live_input *input;
    bool any;      // a message has arrived
    bool fresh;    // since the last check
    bool set;      // values were set in place of messages (pm_live_inputs_set)
    double heard;  // s, monotonic, when the last check found a message
    double *value; // [PM_LIVE_AHEAD][count]; [0] is the newest if the input does not wait
    double *given; // [count] those that were set
    int64_t *step; // [PM_LIVE_AHEAD] the step for which the values hold; -1: none
} pm_live_channel;

typedef struct pm_live_inputs {
    const pm_scene *scene;
    pm_live_channel *channel; // [scene->nlive_input]
    int64_t next;             // the step whose values are taken next
    double *taken[2];         // [scene->nlive] values of the last two steps, by step modulo 2
    const double *replay;     // [replayed][scene->nlive] borrowed; NULL: values come from channels
    int64_t replayed;
    pm_drops *drops; // borrowed, counts the messages that are dropped
    // The channel on which two messages had other values for the same step, of which the first ones
    // hold, and that step; NULL: none since the caller has set it so.
    const char *disputed;
    int64_t disputed_step;
} pm_live_inputs;

// Subscribes to the channels of the scene, unless `replay` [replayed][scene->nlive] gives the
// values of the steps. The transport, `replay` and `drops` are borrowed. `scene` must outlive the
// inputs. PM_ENET, PM_ENOMEM.
pm_status pm_live_inputs_open(pm_live_inputs *live, const pm_scene *scene, pm_arena *arena,
                              pm_transport *transport, const double *replay, int64_t replayed,
                              pm_drops *drops);

// Sets the newest values [scene->nlive]. They count as a message on every channel for the next
// step, and hold in later steps until other values arrive. With `kept` the values come from a run
// that was interrupted, and inputs with `wait: true` still wait for their messages. With values ==
// NULL another run begins at step 0 with the scene's first values.
void pm_live_inputs_set(pm_live_inputs *live, const double *values, bool kept);

// Looks at the clock: `now` is the present time (s, monotonic). PM_ETIMEOUT: a program that has
// sent values before has been silent for longer than the input's `age`. PM_EDATA: the recording
// that is replayed is over.
pm_status pm_live_inputs_check(pm_live_inputs *live, double now);

// Returns the channel on which the values of the next step have yet to arrive; NULL if all are
// there.
const char *pm_live_inputs_awaited(const pm_live_inputs *live);

// Takes the values of the next step. All must be there.
void pm_live_inputs_take(pm_live_inputs *live);

// Returns the values [scene->nlive] that hold in a step, one of the last two taken. For the step
// -1, the first values of the scene. Valid until two more steps are taken.
const double *pm_live_inputs_values(const pm_live_inputs *live, int64_t step);

#endif
