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

// Returns the slot of a message, or NULL if it is not kept.
static const pm_resend_buffer_slot *find_slot(const pm_resend_buffer *buffer, int64_t key) {
    for (int i = 0; i < buffer->depth; ++i) {
        if (buffer->slot[i].key == key) {
            return &buffer->slot[i];
        }
    }
    return NULL;
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

bool pm_resend_buffer_keeps(const pm_resend_buffer *buffer, int64_t key) {
    return key >= 0 && find_slot(buffer, key) != NULL;
}

pm_status pm_resend_buffer_repeat(const pm_resend_buffer *buffer, pm_transport *transport,
                                  int64_t key) {
    const pm_resend_buffer_slot *slot = key < 0 ? NULL : find_slot(buffer, key);
    return slot == NULL ? PM_OK
                        : pm_transport_publish(transport, buffer->channel, slot->data, slot->size);
}
