// The functions that a transport provides. Private to transport*.c.
#ifndef PM_TRANSPORT_TRANSPORT_TABLE_H
#define PM_TRANSPORT_TRANSPORT_TABLE_H

#include "transport/transport.h"

// The functions of one kind of transport, which implement those of transport.h. Each receives the
// state of its transport.
typedef struct pm_transport_table {
    pm_status (*check)(const char *url); // called only with a scheme of this transport
    // `drops` counts the messages that the transport drops, and outlives the state.
    pm_status (*open)(void **state, const char *url, pm_drops *drops);
    void (*close)(void *state);
    pm_status (*subscribe)(void *state, const char *channel, pm_message_handler *handler,
                           void *context);
    pm_status (*publish)(void *state, const char *channel, const void *data, size_t size);
    pm_status (*wait)(void *state, double seconds, int *handled);
    int (*file)(const void *state);
    pm_status (*place)(int *rank, int *count); // NULL: the processes have no ranks
} pm_transport_table;

extern const pm_transport_table pm_transport_lcm;

// A transport in front of another one begins with this. Its table has the functions below where it
// passes a call on as it is.
typedef struct pm_transport_front {
    const pm_transport_table *table; // of the transport beneath
    void *beneath;
} pm_transport_front;

static inline pm_status pm_front_subscribe(void *state, const char *channel,
                                           pm_message_handler *handler, void *context) {
    const pm_transport_front *f = state;
    return f->table->subscribe(f->beneath, channel, handler, context);
}
static inline pm_status pm_front_publish(void *state, const char *channel, const void *data,
                                         size_t size) {
    const pm_transport_front *f = state;
    return f->table->publish(f->beneath, channel, data, size);
}
static inline pm_status pm_front_wait(void *state, double seconds, int *handled) {
    const pm_transport_front *f = state;
    return f->table->wait(f->beneath, seconds, handled);
}
static inline int pm_front_file(const void *state) {
    const pm_transport_front *f = state;
    return f->table->file(f->beneath);
}

// The transport that seals and checks messages in front of another transport. Its `check` and
// `open` are NULL, because pm_transport_sealed_open opens it.
extern const pm_transport_table pm_transport_sealed;

// Opens the state of a sealed transport in front of the transport `beneath`, whose functions are
// `table`. The sealed transport owns and closes `beneath`. PM_ENOMEM; the caller then keeps
// `beneath`. pm_transport_seal describes `key`, `sender`, `on_clock` and
// `context`.
pm_status pm_transport_sealed_open(void **state, const pm_transport_table *table, void *beneath,
                                   const pm_key *key, const char *sender,
                                   pm_clock_handler *on_clock, const void *context,
                                   pm_drops *drops);

// Puts a transport in front of the one whose functions are *table and whose state is *state, if the
// URL has one of the options lose=FRACTION, of received messages that are dropped, and
// mix=FRACTION, of those that come up to 4 ms late, half of them at once as well. With `state` NULL
// it only checks the options. PM_ECONFIG: a fraction is no number from 0 to below 1; PM_ENOMEM; the
// caller then keeps the state.
pm_status pm_transport_faulty_open(const char *url, const pm_transport_table **table, void **state);

#endif
