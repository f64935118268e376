// A ring of sent messages, by key modulo depth.
#include "net/outbox.h"

pm_status pm_outbox_init(pm_outbox *outbox, pm_arena *arena, int depth, size_t capacity) {
    outbox->depth = depth;
    outbox->capacity = capacity;
    outbox->slot = pm_arena_array(arena, (size_t)depth, sizeof *outbox->slot);
    unsigned char *data = pm_arena_array(arena, (size_t)depth, capacity);
    if (outbox->slot == NULL || data == NULL) {
        return pm_fail(PM_ENOMEM, "channel %s: out of memory", outbox->channel);
    }
    for (int i = 0; i < depth; ++i) {
        outbox->slot[i] = (pm_outbox_slot){-1, 0, data + (size_t)i * capacity};
    }
    return PM_OK;
}

static pm_outbox_slot *slot_of(const pm_outbox *outbox, int64_t key) {
    return &outbox->slot[key % outbox->depth];
}

unsigned char *pm_outbox_data(pm_outbox *outbox, int64_t key) {
    pm_outbox_slot *slot = slot_of(outbox, key);
    slot->key = -1;
    return slot->data;
}

pm_status pm_outbox_publish(pm_outbox *outbox, pm_transport *transport, int64_t key, size_t size) {
    pm_outbox_slot *slot = slot_of(outbox, key);
    slot->key = key;
    slot->size = size;
    return pm_transport_publish(transport, outbox->channel, slot->data, size);
}

bool pm_outbox_keeps(const pm_outbox *outbox, int64_t key) {
    return key >= 0 && slot_of(outbox, key)->key == key;
}

pm_status pm_outbox_repeat(const pm_outbox *outbox, pm_transport *transport, int64_t key) {
    if (!pm_outbox_keeps(outbox, key)) {
        return PM_OK;
    }
    const pm_outbox_slot *slot = slot_of(outbox, key);
    return pm_transport_publish(transport, outbox->channel, slot->data, slot->size);
}
