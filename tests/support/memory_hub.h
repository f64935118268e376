// Transports between endpoints in one thread, for tests. Endpoints of one hub receive each other's
// messages, each through its own first-in first-out queue. The hub can lose, repeat and delay
// messages.
#ifndef PM_TESTS_MEMORY_HUB_H
#define PM_TESTS_MEMORY_HUB_H

#include "transport/transport.h"

typedef struct pm_hub pm_hub;

// Faults that a hub simulates for tests; a struct of zeros means no faults. The hub draws them at
// random, from `seed`, for each message and receiver. A delayed message waits for 1 to `max_delay`
// of the receiver's calls of pm_transport_wait, so that later messages overtake it.
typedef struct pm_hub_faults {
    uint64_t seed;
    double drop, duplicate, delay; // probabilities
    int max_delay;
} pm_hub_faults;

// Opens a hub; `faults` may be NULL: none. PM_ENOMEM. The caller must close the hub after its
// endpoints.
pm_status pm_hub_open(pm_hub **hub, const pm_hub_faults *faults);
void pm_hub_close(pm_hub *hub); // NULL is allowed

// Opens a transport on the hub. Its pm_transport_wait never waits, since nobody could send
// meanwhile. PM_ENOMEM.
pm_status pm_hub_connect(pm_hub *hub, pm_transport **transport);

// Transports that connect from now on seal their messages with the key, which must outlive the hub;
// NULL: they do not.
void pm_hub_seal(pm_hub *hub, const pm_key *key);

#endif
