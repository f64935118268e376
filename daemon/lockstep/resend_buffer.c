// A ring of published messages, in the order of publishing.
#include "lockstep/resend_buffer.h"

pm_status pm_resend_buffer_init(pm_resend_buffer *buffer, pm_arena *arena, int depth,
                                size_t capacity) {
    buffer->depth = depth;
    buffer->capacity = capacity;
    buffer->slot = pm_arena_array(arena, (size_t)depth, sizeof *buffer->slot);
    unsigned char *data = pm_arena_array(arena, (size_t)depth, capacity);
    if (buffer->slot == NULL || data == NULL) {
        return pm_fail(PM_ENOMEM, "channel %s: out of memory", buffer->channel);
    }
    for (int i = 0; i < depth; ++i) {
        buffer->slot[i] = (pm_resend_buffer_slot){-1, 0, data + (size_t)i * capacity};
    }
    return PM_OK;
}

unsigned char *pm_resend_buffer_data(pm_resend_buffer *buffer) {
    pm_resend_buffer_slot *slot = &buffer->slot[buffer->next];
    slot->key = -1;
    return slot->data;
}

pm_status pm_resend_buffer_publish(pm_resend_buffer *buffer, pm_transport *transport, int64_t key,
                                   size_t size) {
    pm_resend_buffer_slot *slot = &buffer->slot[buffer->next];
    buffer->next = (buffer->next + 1) % buffer->depth;
    slot->key = key;
    slot->size = size;
    return pm_transport_publish(transport, buffer->channel, slot->data, size);
}

pm_status pm_resend_buffer_repeat(const pm_resend_buffer *buffer, pm_transport *transport,
                                  int64_t key, bool *kept) {
    *kept = false;
    for (int i = 0; i < buffer->depth && key >= 0; ++i) {
        const pm_resend_buffer_slot *slot = &buffer->slot[i];
        if (slot->key == key) {
            *kept = true;
            return pm_transport_publish(transport, buffer->channel, slot->data, slot->size);
        }
    }
    return PM_OK;
}
