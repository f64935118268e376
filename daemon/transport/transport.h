// Carries messages, as bytes, between processes or within one. The URL's beginning chooses how:
//   udpm://, mpudpm://       LCM, best effort over UDP multicast (transport_lcm.c); udpm is heard
//                            on a filtered socket of our own unless "?receive=lcm" says otherwise
//   memory://                between endpoints of one hub in this thread (transport_memory.c)
// A transport is a table of functions (transport_table.h) and one line in transport.c. With a key,
// a transport that seals and checks (transport_sealed.c) takes the place of any of them.
#ifndef PM_TRANSPORT_TRANSPORT_H
#define PM_TRANSPORT_TRANSPORT_H

#include <stddef.h>
#include <stdint.h>

#include "base/status.h"
#include "transport/channel.h"
#include "transport/drops.h"
#include "transport/seal.h"

typedef struct pm_transport pm_transport;

// Called for each message during pm_transport_wait. `data` [size] and `channel` are valid until it
// returns. It may publish; it must not wait, subscribe or close.
typedef void pm_message_handler(void *context, const char *channel, const void *data, size_t size);

// --- the memory transport's meeting place ---

// Endpoints opened on the same hub hear each other, each through its own first-in first-out queue.
typedef struct pm_hub pm_hub;

// What a hub does to messages on purpose, for tests; all zero: nothing. Drawn per message and
// receiver from the seed. A delayed message waits for 1 to `max_delay` of the receiver's calls of
// pm_transport_wait, so that later ones overtake it.
typedef struct pm_hub_faults {
    uint64_t seed;
    double drop, duplicate, delay; // probabilities
    int max_delay;
} pm_hub_faults;

pm_status pm_hub_open(pm_hub **hub, const pm_hub_faults *faults); // faults may be NULL
void pm_hub_close(pm_hub *hub); // after its endpoints; NULL is allowed

// --- any transport ---

// The URL's shape; opens nothing. PM_ECONFIG: unknown scheme or malformed address.
pm_status pm_transport_check(const char *url);

// `hub` is needed for "memory://" and ignored otherwise. PM_ECONFIG: as pm_transport_check.
// PM_ENET: no socket or no way for multicast; then the error names the commands that mend it.
// PM_ENOMEM.
pm_status pm_transport_open(pm_transport **transport, const char *url, pm_hub *hub);
void pm_transport_close(pm_transport *transport); // NULL is allowed

// From now on what is published carries a seal, and what arrives without a good one is dropped
// (seal.h). To be called before the first subscription; the key may be cleared afterwards.
// PM_ENOMEM.
pm_status pm_transport_seal(pm_transport *transport, const pm_key *key);

// Messages on `channel`, exactly, go to `handler`. One's own messages count. PM_ENET, PM_ENOMEM.
pm_status pm_transport_subscribe(pm_transport *transport, const char *channel,
                                 pm_message_handler *handler, void *context);

// Sends without waiting. PM_ENET, PM_ENOMEM.
pm_status pm_transport_publish(pm_transport *transport, const char *channel, const void *data,
                               size_t size);

// Waits up to `seconds` (0: not at all) for a message, then hands out all that have arrived.
// `handled` (may be NULL) receives their number; 0 also when a signal cut the wait short. The
// memory transport never waits: while its thread is in here nobody could send. PM_ENET.
pm_status pm_transport_wait(pm_transport *transport, double seconds, int *handled);

// Becomes readable when a message arrives, for use with poll(); -1 if there is none.
int pm_transport_file(const pm_transport *transport);

// What was dropped before it reached a handler, and why.
const pm_drops *pm_transport_drops(const pm_transport *transport);

#endif
