// The last messages sent on one channel, kept as bytes, so that a request for a lost one can be
// answered.
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

// Storage the caller owns.
typedef struct pm_resend_buffer {
    char channel[PM_CHANNEL_SIZE];
    size_t capacity; // bytes of one message
    int depth;       // messages kept
    pm_resend_buffer_slot *slot;
} pm_resend_buffer;

// Memory for `depth` messages from the arena; the caller writes the channel's name. PM_ENOMEM.
pm_status pm_resend_buffer_init(pm_resend_buffer *resend_buffer, pm_arena *arena, int depth,
                                size_t capacity);

// Where the message numbered `key` (>= 0, rising) is to be encoded; it takes the oldest one's
// place.
unsigned char *pm_resend_buffer_data(pm_resend_buffer *resend_buffer, int64_t key);
// Publishes the `size` bytes written there.
pm_status pm_resend_buffer_publish(pm_resend_buffer *resend_buffer, pm_transport *transport,
                                   int64_t key, size_t size);

// Publishes message `key` again if it is still kept; otherwise does nothing.
bool pm_resend_buffer_keeps(const pm_resend_buffer *resend_buffer, int64_t key);
pm_status pm_resend_buffer_repeat(const pm_resend_buffer *resend_buffer, pm_transport *transport,
                                  int64_t key);

#endif
