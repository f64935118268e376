// A ring of sent messages, by key modulo depth.
#include "lockstep/resend_buffer.h"

pm_status pm_resend_buffer_init(pm_resend_buffer *resend_buffer, pm_arena *arena, int depth,
                                size_t capacity) {
    resend_buffer->depth = depth;
    resend_buffer->capacity = capacity;
    resend_buffer->slot = pm_arena_array(arena, (size_t)depth, sizeof *resend_buffer->slot);
    unsigned char *data = pm_arena_array(arena, (size_t)depth, capacity);
    if (resend_buffer->slot == NULL || data == NULL) {
        return pm_fail(PM_ENOMEM, "channel %s: out of memory", resend_buffer->channel);
    }
    for (int i = 0; i < depth; ++i) {
        resend_buffer->slot[i] = (pm_resend_buffer_slot){-1, 0, data + (size_t)i * capacity};
    }
    return PM_OK;
}

static pm_resend_buffer_slot *slot_of(const pm_resend_buffer *resend_buffer, int64_t key) {
    return &resend_buffer->slot[key % resend_buffer->depth];
}

unsigned char *pm_resend_buffer_data(pm_resend_buffer *resend_buffer, int64_t key) {
    pm_resend_buffer_slot *slot = slot_of(resend_buffer, key);
    slot->key = -1;
    return slot->data;
}

pm_status pm_resend_buffer_publish(pm_resend_buffer *resend_buffer, pm_transport *transport,
                                   int64_t key, size_t size) {
    pm_resend_buffer_slot *slot = slot_of(resend_buffer, key);
    slot->key = key;
    slot->size = size;
    return pm_transport_publish(transport, resend_buffer->channel, slot->data, size);
}

bool pm_resend_buffer_keeps(const pm_resend_buffer *resend_buffer, int64_t key) {
    return key >= 0 && slot_of(resend_buffer, key)->key == key;
}

pm_status pm_resend_buffer_repeat(const pm_resend_buffer *resend_buffer, pm_transport *transport,
                                  int64_t key) {
    if (!pm_resend_buffer_keeps(resend_buffer, key)) {
        return PM_OK;
    }
    const pm_resend_buffer_slot *slot = slot_of(resend_buffer, key);
    return pm_transport_publish(transport, resend_buffer->channel, slot->data, slot->size);
}
