// Vitals are measurements that every process publishes once a second: the number of steps done, the
// time spent computing, and the time spent waiting for each peer. The coordinator computes the
// health of the run from them (below). A process waits for one peer at a time: the first
// neighbour whose flux is missing, or the coordinator if no flux is missing.
#ifndef PM_LOCKSTEP_HEALTH_H
#define PM_LOCKSTEP_HEALTH_H

#include "lockstep/endpoint.h"

// --- vitals ---

// The time between two messages is PM_VITALS_INTERVAL, or PM_VITALS_EACH for each process of the
// run if that is more, since many processes would send little else.
#define PM_VITALS_INTERVAL 1.0 // s
#define PM_VITALS_EACH 0.004   // s
#define PM_REST_EACH 0.25      // s
#define PM_REST_MOST 30.0      // s

// The caller owns this storage and initialises it with zeros. Times are in s, of the clock
// endpoint->now (endpoint.h).
typedef struct pm_vitals {
    portmet_vitals_t message; // the sums so far
    char channel[PM_CHANNEL_SIZE];
    unsigned char *data; // [capacity] the encoded message
    size_t capacity;
    double interval;    // s between two messages
    double begun, next; // when the process joined the run; when the next message is due
    double looked;      // when the present poll began
    double rested;      // when the last poll ended; 0: unknown
    int peer;           // the peer that the process has waited for since `rested`
    int64_t checkpoint; // step of the last checkpoint
    double saved;       // when that checkpoint was first published
} pm_vitals;

// Returns the time between two messages of a process, in s, in a run of `processes` processes.
static inline double pm_vitals_interval(int processes) {
    const double each = PM_VITALS_EACH * processes;
    return each > PM_VITALS_INTERVAL ? each : PM_VITALS_INTERVAL;
}

// Returns the time between two ticks that keep `processes` processes at rest, which answer with
// their vitals, in s: PM_VITALS_INTERVAL, or PM_REST_EACH for each process if that is more, since
// each message wakes all.
static inline double pm_rest_interval(int processes) {
    const double each = PM_REST_EACH * processes;
    return each < PM_VITALS_INTERVAL ? PM_VITALS_INTERVAL
           : each > PM_REST_MOST     ? PM_REST_MOST
                                     : each;
}

// Makes vitals of process `process_id` with `npeer` peers and the coordinator. The caller sets the
// first npeer of message.peer. Memory comes from the arena. PM_ECONFIG, PM_ENOMEM.
pm_status pm_vitals_init(pm_vitals *vitals, pm_arena *arena, const pm_scene *scene, int process_id,
                         int npeer);

// pm_vitals_look is called when a poll begins, and pm_vitals_rest when it ends. The time from an
// end to the next beginning counts as waiting for the peer `peer`, its position in the list of
// peers, in which the coordinator is the last one. Without calls of pm_vitals_rest no times are
// measured.
void pm_vitals_look(pm_vitals *vitals, double now);
void pm_vitals_rest(pm_vitals *vitals, double now, int peer);

// Publishes the vitals after `step` steps if they are due: once in each interval while the process
// takes part in a run. `checkpoint` is the step of the last checkpoint, or -1 if none is kept. The
// caller counts in message.asked, used and answered. PM_ENET.
pm_status pm_vitals_tell(pm_vitals *vitals, const pm_endpoint *endpoint, int64_t step,
                         int64_t checkpoint);

// --- health ---

// The health of a run: how fast each process steps, which process waits for which, and between
// which processes messages get lost. The coordinator computes it from the vitals of the processes
// and publishes it once a second.

#define PM_HEALTH_COORDINATOR (-1) // stands for the coordinator among positions of processes
#define PM_HEALTH_NOBODY (-2)

// A warning is due if more than PM_HEALTH_LOSS of the messages from one process to another had to
// be sent again, or if all others wait for one process for more than PM_HEALTH_BLOCKED of the time.
#define PM_HEALTH_LOSS 0.05
#define PM_HEALTH_BLOCKED 0.8
#define PM_HEALTH_SILENT 3.0 // s after which a process counts as silent, at least

// The coordinator keeps these numbers about each process.
typedef struct pm_health_process {
    portmet_vitals_t last;    // the vitals that arrived last; they hold sums since the start
    int64_t *used, *answered; // [npeer] increase of these two sums from the vitals before
    double heard;             // s, when `last` arrived; 0: no vitals have arrived
    bool told_loss;           // a warning about lost messages to this process was given
} pm_health_process;

// The caller owns this storage and initialises it with zeros.
typedef struct pm_health {
    const pm_scene *scene;
    portmet_health_t message;   // the message that is published
    portmet_vitals_t vitals;    // the message being decoded
    pm_health_process *process; // [nprocess]
    char channel[PM_CHANNEL_SIZE], vitals_channel[PM_CHANNEL_SIZE];
    unsigned char *data; // [capacity] the encoded message
    size_t capacity;
    double next, before;  // s, when the next message is due; when the last one was made
    int64_t step_before;  // number of complete steps when the last message was made
    int64_t told_blocker; // the process for which all others wait, in the last warning
} pm_health;

// Prepares the health of a run of `steps` steps, with memory from the arena. PM_ECONFIG, PM_ENOMEM.
pm_status pm_health_init(pm_health *health, pm_arena *arena, const pm_scene *scene, int64_t digest,
                         int64_t session, int64_t steps);

// Decodes the vitals of a process, `data` [size], at the time `now` (s, monotonic) and adds them to
// the health. Returns PM_KEEP, or the reason for which the message is dropped.
pm_drop pm_health_take(pm_health *health, const void *data, size_t size, double now);

// Returns the time, in s, after which a process counts as silent in a run of `processes` processes,
// which may rest.
double pm_health_silence(int processes, bool rests);

// Returns true if a second has passed since the last message, and then completes the message for a
// run in which `step` steps are complete. `now` is in s, monotonic.
bool pm_health_is_due(pm_health *health, int64_t step, double now);

// Returns true if there is a warning that was not given before, and writes it into `text` [size]. A
// warning says that one process makes all others wait, or that messages to a process get lost. The
// caller repeats the call until the function returns false.
bool pm_health_warn(pm_health *health, char *text, size_t size);

// Returns the name of a process; "coordinator" for PM_HEALTH_COORDINATOR; "nobody" for any other
// number. The scene owns the names of processes.
const char *pm_health_name(const pm_scene *scene, int64_t process_id);

#endif
