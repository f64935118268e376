// Every process reports once a second how it is doing: its pace, how long it computes, and how long
// it waits for each peer. The coordinator sums the reports up (health.h). A process waits for one
// peer at a time: the neighbour whose flux is missing first, else the coordinator.
#ifndef PM_LOCKSTEP_VITALS_H
#define PM_LOCKSTEP_VITALS_H

#include <stdbool.h>

#include "base/arena.h"
#include "lockstep/codec.h"
#include "scene/scene.h"
#include "transport/transport.h"

#define PM_VITALS_INTERVAL 1.0 // s between two messages

// Storage the caller owns; zero-initialise. Times in s, of the owner's clock (endpoint.h).
typedef struct pm_vitals {
    portmet_vitals_t message; // the sums so far
    char channel[PM_CHANNEL_SIZE];
    unsigned char *data; // [capacity] the encoded message
    size_t capacity;
    double begun, next; // when it began to take part; when the next message is due
    double looked;      // when the present poll began
    double rested;      // when the last poll ended; 0: unknown
    int peer;           // that it has waited for since then
    int64_t checkpoint; // step of its last checkpoint
    double saved;       // when it was made
} pm_vitals;

// Writes the processes that exchange fluxes with process `process_id` into `list` [nprocess] (may
// be NULL), in no particular order, and returns their number.
int pm_vitals_neighbours(const pm_scene *scene, int process_id, int *list);

// Makes vitals of process `process_id` with the peers `peer` [npeer], positions in the scene, and
// the coordinator. Memory comes from the arena. PM_ECONFIG, PM_ENOMEM.
pm_status pm_vitals_init(pm_vitals *vitals, pm_arena *arena, const pm_scene *scene, int process_id,
                         int npeer, const int *peer);

// Begins and ends a poll: the time between an end and the next begin was spent waiting for the peer
// `peer`, a position in the list of peers, in which the coordinator is the last one. Without calls
// of pm_vitals_rest no times are measured.
void pm_vitals_look(pm_vitals *vitals, double now);
void pm_vitals_rest(pm_vitals *vitals, double now, int peer);

// Count messages of a peer that were requested again or used, and requests of it that were
// answered.
void pm_vitals_ask(pm_vitals *vitals, int peer);
void pm_vitals_use(pm_vitals *vitals, int peer);
void pm_vitals_answer(pm_vitals *vitals, int peer);

// Returns true once in each interval, for a process that takes part in the run `session`.
bool pm_vitals_are_due(pm_vitals *vitals, int64_t session, double now);

// Publishes the vitals after `step` steps. `checkpoint` is the step of the last checkpoint, or -1
// if none is kept; `drops` are those of the owner. PM_ENET.
pm_status pm_vitals_publish(pm_vitals *vitals, pm_transport *transport, int64_t step,
                            int64_t checkpoint, const pm_drops *drops);

#endif
