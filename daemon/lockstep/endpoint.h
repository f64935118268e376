// An endpoint is the part that nodes and coordinators have in common: the identity, the channels
// that all processes share, requests for missing messages, and the result of the run. An endpoint
// decodes hello, command and request messages, counts those it drops, and passes the others to
// handlers.
#ifndef PM_LOCKSTEP_ENDPOINT_H
#define PM_LOCKSTEP_ENDPOINT_H

#include "base/presence.h"
#include "lockstep/codec.h"
#include "lockstep/identity.h"
#include "lockstep/waiting.h"

// The time between two requests to all processes, in s for each process of the run.
#define PM_ENDPOINT_ALL_ASKED 0.02

// Functions of the owner of an endpoint, called with each well-formed message. Each handler returns
// PM_KEEP or the reason for which it drops the message.
typedef struct pm_handlers {
    pm_drop (*hello)(void *context, const portmet_hello_t *hello);
    pm_drop (*command)(void *context, const portmet_command_t *command);
    pm_drop (*request)(void *context, const portmet_request_t *request);
} pm_handlers;

// The caller owns this storage and initialises it with zeros. All pointers are borrowed.
typedef struct pm_endpoint {
    const pm_system *system;
    pm_transport *transport;
    const pm_handlers *handlers;
    void *context; // passed to the handlers
    pm_identity identity;
    char tick_channel[PM_CHANNEL_SIZE], request_channel[PM_CHANNEL_SIZE];
    char coordinator_address[PM_CHANNEL_SIZE]; // channel of requests to the coordinator
    int64_t session, steps;                    // session and length of the run; session 0: no run
    int64_t attempt;                           // number of rollbacks since the start
    double all_asked_at;                       // s, when it last sent a request to all processes
    double now;                                // s, set by pm_endpoint_look
    pm_presence presence;
    pm_waiting waiting;
    pm_status status;              // result of the run; PM_OK until it has failed
    char message[PM_TEXT_MAX + 1]; // of the failure
    pm_drops drops;                // counts of used and dropped messages
} pm_endpoint;

// Opens an endpoint whose `system` and `transport` are set, and subscribes to hellos, commands and
// requests. `handlers`, `context` and `name` must outlive the endpoint. `name` is the name of the
// process, or "" for the coordinator. `session` is the session that the process was started for; 0:
// none was named. `keeps_checkpoints` tells other processes whether this one can roll back. The
// transport keeps pointers to the endpoint, which must not move. PM_ECONFIG: a channel's name is
// too long; PM_ENET, PM_ENOMEM.
pm_status pm_endpoint_open(pm_endpoint *endpoint, const pm_handlers *handlers, void *context,
                           const char *name, int64_t session, bool keeps_checkpoints);

// Subscribes to the hellos of the process `name` and to the channel `address`, on which that
// process receives requests, and passes both to the handlers. PM_ECONFIG: a channel's name is too
// long; PM_ENET, PM_ENOMEM.
pm_status pm_endpoint_listen_to(pm_endpoint *endpoint, const char *name, const char *address);

// Sets endpoint->now, in s, to `clock`, the present monotonic time in s, minus the total time for
// which this process has not run (base/presence.h). All waiting times refer to endpoint->now, so
// that a process does not count its own absence as the silence of others. The owner calls this
// function at the beginning of each poll.
void pm_endpoint_look(pm_endpoint *endpoint, double clock);

// Returns the monotonic time, in s, at which endpoint->now will reach `time`, in s, if this process
// keeps running.
double pm_endpoint_clock(const pm_endpoint *endpoint, double time);

// Counts a message in endpoint->drops as used (PM_KEEP) or as dropped for the reason `drop`.
void pm_endpoint_count(pm_endpoint *endpoint, pm_drop drop);

// Requests the message of `step` and `round` on the channel `channel` from the process that
// publishes there. The request goes to the channel `address`, which only that process and the
// coordinator receive, so that it wakes no other process. During a long wait (pm_waiting_is_long)
// a request now and then goes to all processes: it reveals a second process of the same name.
// PM_ENET, PM_ENOMEM.
pm_status pm_endpoint_request(pm_endpoint *endpoint, const char *address, const char *channel,
                              int64_t step, int round);

// Stores the result of the run: PM_OK, or a failure with its one-line message, which is copied.
void pm_endpoint_end(pm_endpoint *endpoint, pm_status status, const char *message);

// Returns the stored result, with pm_error() set to its message.
pm_status pm_endpoint_result(const pm_endpoint *endpoint);

// Converts an error code that another process has sent to pm_status; PM_ENET if it is unknown.
pm_status pm_endpoint_code(int8_t code);

#endif
