// What a process and the coordinator of a run have in common: who they are, the channels on which
// all speak to all, requests for what was lost, and how it ended.
#ifndef PM_LOCKSTEP_ENDPOINT_H
#define PM_LOCKSTEP_ENDPOINT_H

#include "lockstep/codec.h"
#include "lockstep/identity.h"
#include "lockstep/waiting.h"

// What each of them does with a message that is well formed, and why it drops it, if it does.
typedef struct pm_handlers {
    pm_drop (*hello)(void *context, const portmet_hello_t *hello);
    pm_drop (*command)(void *context, const portmet_command_t *command);
    pm_drop (*request)(void *context, const portmet_request_t *request);
} pm_handlers;

// Storage the caller owns; zero-initialise.
typedef struct pm_endpoint {
    const pm_system *system;
    pm_transport *transport;
    const pm_handlers *handlers;
    void *context; // of the handlers
    pm_identity identity;
    char tick_channel[PM_CHANNEL_SIZE], request_channel[PM_CHANNEL_SIZE];
    char tick_address[PM_CHANNEL_SIZE]; // of requests to the coordinator
    int64_t session, steps;             // of the run; session 0: none yet
    int64_t attempt;                    // how often it has gone back to a checkpoint
    double now;                         // s, last poll
    pm_waiting waiting;
    pm_status status; // how it ended, and why
    char message[PM_TEXT_MAX + 1];
    pm_drops drops;
} pm_endpoint;

// `name` and `asked` as pm_identity_init's name and session. Subscribes to hellos, commands and
// requests; `system` and `transport` are set already. PM_ECONFIG, PM_ENET, PM_ENOMEM.
pm_status pm_endpoint_open(pm_endpoint *endpoint, const pm_handlers *handlers, void *context,
                           const char *name, int64_t asked, bool keeps_checkpoints);

// Hears requests to another one, too. PM_ENET, PM_ENOMEM.
pm_status pm_endpoint_overhear(pm_endpoint *endpoint, const char *address);

void pm_endpoint_count(pm_endpoint *endpoint, pm_drop drop);

// Misses a message on `channel`: publishes a request for it on `address`, where its sender hears
// it, and the coordinator. Nobody else is to wake for it: on a busy machine many wait. After a long
// wait on the channel of all: a sign of life, and whoever else speaks by this name hears of it.
pm_status pm_endpoint_request(const pm_endpoint *endpoint, const char *address, const char *channel,
                              int64_t step, int round);

// The end, and what it is told with: PM_OK, or `status` with pm_error() set to `message`.
void pm_endpoint_end(pm_endpoint *endpoint, pm_status status, const char *message);
pm_status pm_endpoint_result(const pm_endpoint *endpoint);

// The class of failure that a code from the network stands for; PM_ENET if it is none.
pm_status pm_endpoint_code(int8_t code);

#endif
