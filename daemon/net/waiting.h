// Waiting for a message that may have been lost: when to ask for it again, and when to give up.
#ifndef PM_NET_WAITING_H
#define PM_NET_WAITING_H

#include <stdbool.h>
#include <stdint.h>

#include "net/transport.h"

// s between requests: the first comes soon after a loss, later ones spare the network. Longer than
// a message takes on a busy machine, so that few requests are needless.
#define PM_WAITING_FIRST 0.005
#define PM_WAITING_LAST 0.1

// How many times the scene's patience one message may take although its sender shows life. Longer
// than patience itself: the sender may be waiting for another one, who is about to be found
// missing.
#define PM_WAITING_ALIVE 3

// Storage the caller owns. Times in s, monotonic.
typedef struct pm_waiting {
    double since, next, interval;
} pm_waiting;

void pm_waiting_start(pm_waiting *waiting, double now);

// True when it is time to ask again; then the next time is set, twice as far away as the last.
bool pm_waiting_ask(pm_waiting *waiting, double now);

// True when a peer last heard at `heard` is to be given up.
bool pm_waiting_over(const pm_waiting *waiting, double heard, double patience, double now);

// Publishes a request_t on `request_channel`: `sender` misses a message on `channel`.
pm_status pm_waiting_request(pm_transport *transport, const char *request_channel, int64_t session,
                             const char *sender, const char *channel, int64_t step, int round);

#endif
