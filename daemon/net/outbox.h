// The last messages sent on one channel, kept as bytes, so that a request for a lost one can be
// answered.
#ifndef PM_NET_OUTBOX_H
#define PM_NET_OUTBOX_H

#include <stdbool.h>

#include "base/arena.h"
#include "net/transport.h"

typedef struct pm_outbox_slot {
    int64_t key; // -1: empty
    size_t size;
    unsigned char *data; // [capacity]
} pm_outbox_slot;

// Storage the caller owns.
typedef struct pm_outbox {
    char channel[PM_CHANNEL_SIZE];
    size_t capacity; // bytes of one message
    int depth;       // messages kept
    pm_outbox_slot *slot;
} pm_outbox;

// Memory for `depth` messages from the arena; the caller writes the channel's name. PM_ENOMEM.
pm_status pm_outbox_init(pm_outbox *outbox, pm_arena *arena, int depth, size_t capacity);

// Where the message numbered `key` (>= 0, rising) is to be encoded; it takes the oldest one's
// place.
unsigned char *pm_outbox_data(pm_outbox *outbox, int64_t key);
// Publishes the `size` bytes written there.
pm_status pm_outbox_publish(pm_outbox *outbox, pm_transport *transport, int64_t key, size_t size);

// Publishes message `key` again if it is still kept; otherwise does nothing.
bool pm_outbox_keeps(const pm_outbox *outbox, int64_t key);
pm_status pm_outbox_repeat(const pm_outbox *outbox, pm_transport *transport, int64_t key);

#endif
