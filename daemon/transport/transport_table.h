// What a transport provides; private to transport*.c.
#ifndef PM_TRANSPORT_TRANSPORT_TABLE_H
#define PM_TRANSPORT_TRANSPORT_TABLE_H

#include "transport/transport.h"

// The functions of transport.h, on the transport's own state.
typedef struct pm_transport_table {
    pm_status (*check)(const char *url); // its scheme is one of the transport's
    // `drops` is where it counts what it cannot hand out.
    pm_status (*open)(void **state, const char *url, pm_hub *hub, pm_drops *drops);
    void (*close)(void *state);
    pm_status (*subscribe)(void *state, const char *channel, pm_message_handler *handler,
                           void *context);
    pm_status (*publish)(void *state, const char *channel, const void *data, size_t size);
    pm_status (*wait)(void *state, double seconds, int *handled);
    int (*file)(const void *state);
} pm_transport_table;

extern const pm_transport_table pm_transport_lcm;
extern const pm_transport_table pm_transport_memory;

// A transport in front of another one, which it owns from now on; its `check` and `open` are NULL.
extern const pm_transport_table pm_transport_sealed;
pm_status pm_transport_sealed_open(void **state, const pm_transport_table *table, void *beneath,
                                   const pm_key *key, pm_drops *drops);

#endif
