// What a transport provides; private to transport*.c.
#ifndef PM_NET_TRANSPORT_TABLE_H
#define PM_NET_TRANSPORT_TABLE_H

#include "net/transport.h"

// The functions of transport.h, on the transport's own state.
typedef struct pm_transport_table {
    pm_status (*check)(const char *url); // its scheme is one of the transport's
    pm_status (*open)(void **state, const char *url, pm_hub *hub);
    void (*close)(void *state);
    pm_status (*subscribe)(void *state, const char *channel, pm_message_handler *handler,
                           void *context);
    pm_status (*publish)(void *state, const char *channel, const void *data, size_t size);
    pm_status (*wait)(void *state, double seconds, int *handled);
    int (*file)(const void *state);
} pm_transport_table;

extern const pm_transport_table pm_transport_lcm;
extern const pm_transport_table pm_transport_memory;

#endif
