// Vitals are measurements that every process publishes once a second: the number of steps done, the
// time spent computing, and the time spent waiting for each peer. The coordinator computes the
// health of the run from them (health.h). A process waits for one peer at a time: the first
// neighbour whose flux is missing, or the coordinator if no flux is missing.
#ifndef PM_LOCKSTEP_VITALS_H
#define PM_LOCKSTEP_VITALS_H

#include <stdbool.h>

#include "base/arena.h"
#include "lockstep/codec.h"
#include "scene/scene.h"
#include "transport/transport.h"

// The time between two messages is PM_VITALS_INTERVAL, or PM_VITALS_EACH for each process of the
// run if that is more, since many processes would send little else.
#define PM_VITALS_INTERVAL 1.0 // s
#define PM_VITALS_EACH 0.004   // s

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
double pm_vitals_interval(int processes);

// Writes the processes that exchange fluxes with process `process_id` into `list` [nprocess] (may
// be NULL), in no particular order, and returns their number.
int pm_vitals_neighbours(const pm_scene *scene, int process_id, int *list);

// Makes vitals of process `process_id` with the peers `peer` [npeer], positions in the scene, and
// the coordinator. Memory comes from the arena. PM_ECONFIG, PM_ENOMEM.
pm_status pm_vitals_init(pm_vitals *vitals, pm_arena *arena, const pm_scene *scene, int process_id,
                         int npeer, const int *peer);

// pm_vitals_look is called when a poll begins, and pm_vitals_rest when it ends. The time from an
// end to the next beginning counts as waiting for the peer `peer`, its position in the list of
// peers, in which the coordinator is the last one. Without calls of pm_vitals_rest no times are
// measured.
void pm_vitals_look(pm_vitals *vitals, double now);
void pm_vitals_rest(pm_vitals *vitals, double now, int peer);

// These functions count one event each: this process requested a message from the peer, used a
// message of the peer, or answered a request of the peer.
void pm_vitals_ask(pm_vitals *vitals, int peer);
void pm_vitals_use(pm_vitals *vitals, int peer);
void pm_vitals_answer(pm_vitals *vitals, int peer);

// Returns true if vitals are due at `now`: once in each interval while the process takes
// part in the run `session`; 0: it takes part in none.
bool pm_vitals_are_due(pm_vitals *vitals, int64_t session, double now);

// Publishes the vitals after `step` steps. `checkpoint` is the step of the last checkpoint, or -1
// if none is kept; `drops` are the counts of the owner's endpoint. PM_ENET.
pm_status pm_vitals_publish(pm_vitals *vitals, pm_transport *transport, int64_t step,
                            int64_t checkpoint, const pm_drops *drops);

#endif
