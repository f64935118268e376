// How a run is doing, from what its processes say of themselves (vitals.h): paces, who waits for
// whom, and which messages get lost. The coordinator publishes it once a second.
#ifndef PM_LOCKSTEP_HEALTH_H
#define PM_LOCKSTEP_HEALTH_H

#include <stdbool.h>

#include "base/arena.h"
#include "lockstep/codec.h"
#include "scene/scene.h"
#include "transport/channel.h"

#define PM_HEALTH_COORDINATOR (-1) // stands for the coordinator among positions of processes
#define PM_HEALTH_NOBODY (-2)

#define PM_HEALTH_LOSS 0.05   // part of a process's messages that are sent again: worth a warning
#define PM_HEALTH_BLOCKED 0.8 // part of the time that all others wait: likewise
#define PM_HEALTH_SILENT 3.0  // s after which a process counts as silent

// The coordinator keeps these numbers about each process.
typedef struct pm_health_process {
    portmet_vitals_t last;    // the sums that it told last
    int64_t *used, *answered; // [npeer] what was added to the sums by that
    double heard;             // s, when; 0: never
    bool told_loss;           // a warning was given
} pm_health_process;

// The caller owns this storage and initialises it with zeros.
typedef struct pm_health {
    const pm_scene *scene;
    portmet_health_t message;   // that is published
    portmet_vitals_t vitals;    // the message being decoded
    pm_health_process *process; // [nprocess]
    char channel[PM_CHANNEL_SIZE], vitals_channel[PM_CHANNEL_SIZE];
    unsigned char *data; // [capacity] the encoded message
    size_t capacity;
    double next, before;  // s, when the next message is due; when the last one was
    int64_t step_before;  // steps that were complete then
    int64_t told_blocker; // the process that a warning named
} pm_health;

// Prepares the health of a run of `steps` steps, with memory from the arena. PM_ECONFIG, PM_ENOMEM.
pm_status pm_health_init(pm_health *health, pm_arena *arena, const pm_scene *scene, int64_t digest,
                         int64_t session, int64_t steps);

// Takes in the vitals of a process at the time `now` (s, monotonic).
pm_drop pm_health_take(pm_health *health, const void *data, size_t size, double now);

// Returns true once a second, and then sums up how the run is doing after `step` steps.
bool pm_health_is_due(pm_health *health, int64_t step, double now);

// Writes a warning into `text` [size] and returns true, if there is one that was not given before:
// a process makes all others wait, or messages of a process get lost. To be called until it is
// false.
bool pm_health_warn(pm_health *health, char *text, size_t size);

// The name of a process, "coordinator", or "nobody".
const char *pm_health_name(const pm_scene *scene, int64_t process_id);

// Sets the arrays of a health message for `nprocess` processes, with memory from the arena.
// PM_ENOMEM.
pm_status pm_health_message_alloc(portmet_health_t *message, pm_arena *arena, int nprocess);

#endif
