// A ring of published messages, by key modulo the depth.
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

static pm_resend_buffer_slot *slot_of(const pm_resend_buffer *buffer, int64_t key) {
    return &buffer->slot[key % buffer->depth];
}

unsigned char *pm_resend_buffer_data(pm_resend_buffer *buffer, int64_t key) {
    pm_resend_buffer_slot *slot = slot_of(buffer, key);
    slot->key = -1;
    return slot->data;
}

pm_status pm_resend_buffer_publish(pm_resend_buffer *buffer, pm_transport *transport, int64_t key,
                                   size_t size) {
    pm_resend_buffer_slot *slot = slot_of(buffer, key);
    slot->key = key;
    slot->size = size;
    return pm_transport_publish(transport, buffer->channel, slot->data, size);
}

bool pm_resend_buffer_keeps(const pm_resend_buffer *buffer, int64_t key) {
    return key >= 0 && slot_of(buffer, key)->key == key;
}

pm_status pm_resend_buffer_repeat(const pm_resend_buffer *buffer, pm_transport *transport,
                                  int64_t key) {
    if (!pm_resend_buffer_keeps(buffer, key)) {
        return PM_OK;
    }
    const pm_resend_buffer_slot *slot = slot_of(buffer, key);
    return pm_transport_publish(transport, buffer->channel, slot->data, slot->size);
}
