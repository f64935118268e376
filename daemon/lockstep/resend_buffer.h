// A resend buffer keeps the last messages published on one channel, as bytes, so that a lost
// message can be sent again without computing it again. Each message has a key: a number that rises
// from message to message.
#ifndef PM_LOCKSTEP_RESEND_BUFFER_H
#define PM_LOCKSTEP_RESEND_BUFFER_H

#include <stdbool.h>

#include "base/arena.h"
#include "transport/transport.h"

typedef struct pm_resend_buffer_slot {
    int64_t key; // -1: empty
    size_t size;
    unsigned char *data; // [capacity]
} pm_resend_buffer_slot;

// The caller owns this storage.
typedef struct pm_resend_buffer {
    char channel[PM_CHANNEL_SIZE];
    size_t capacity; // bytes of one message
    int depth, next; // messages kept; slot of the next one
    pm_resend_buffer_slot *slot;
} pm_resend_buffer;

// Allocates memory for `depth` messages of at most `capacity` bytes in the arena. The caller sets
// `channel` first. PM_ENOMEM.
pm_status pm_resend_buffer_init(pm_resend_buffer *buffer, pm_arena *arena, int depth,
                                size_t capacity);

// Forgets all messages.
static inline void pm_resend_buffer_clear(pm_resend_buffer *buffer) {
    for (int i = 0; i < buffer->depth; ++i) {
        buffer->slot[i].key = -1;
    }
}

// Returns the memory [capacity] into which the next message is to be encoded. The message replaces
// the oldest one.
unsigned char *pm_resend_buffer_data(pm_resend_buffer *buffer);

// Publishes the next message as number `key` (>= 0), of which `size` bytes were encoded in this
// memory, and keeps it. PM_ENET, PM_ENOMEM.
pm_status pm_resend_buffer_publish(pm_resend_buffer *buffer, pm_transport *transport, int64_t key,
                                   size_t size);

// Publishes message `key` again, unless it is no longer kept, which `kept` tells. PM_ENET,
// PM_ENOMEM.
pm_status pm_resend_buffer_repeat(const pm_resend_buffer *buffer, pm_transport *transport,
                                  int64_t key, bool *kept);

#endif
