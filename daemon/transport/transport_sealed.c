// A transport in front of another one: it seals what is published, and passes on only messages that
// were sealed with the same key.
#include <stdlib.h>
#include <string.h>

#include "transport/transport_table.h"

#define FIRST_CAPACITY 1024 // bytes
#define MOST_TOLD 16        // senders whose clocks are told of

typedef struct sealed_subscription {
    struct sealed_subscription *next;
    struct sealed *owner;
    pm_message_handler *handler;
    void *context;
} sealed_subscription;

typedef struct sealed {
    const pm_transport_table *table; // of the transport beneath
    void *beneath;
    pm_seal *seal;
    pm_drops *drops;
    unsigned char *data; // [capacity] a message with its seal
    size_t capacity;
    sealed_subscription *subscriptions;
    pm_clock_handler *on_clock; // NULL: nobody is told
    const void *context;        // of on_clock
    int ntold;
    char told[MOST_TOLD][PM_SEAL_SENDER]; // the senders that it was called for
} sealed;

static void sealed_close(void *state) {
    sealed *s = state;
    s->table->close(s->beneath);
    pm_seal_close(s->seal);
    while (s->subscriptions != NULL) {
        sealed_subscription *next = s->subscriptions->next;
        free(s->subscriptions);
        s->subscriptions = next;
    }
    free(s->data);
    free(s);
}

pm_status pm_transport_sealed_open(void **state, const pm_transport_table *table, void *beneath,
                                   const pm_key *key, const char *sender,
                                   pm_clock_handler *on_clock, const void *context,
                                   pm_drops *drops) {
    sealed *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "sealed transport: out of memory");
    }
    const pm_status status = pm_seal_open(&s->seal, key, sender, pm_seal_clock(NULL));
    if (status != PM_OK) {
        free(s);
        return status;
    }
    s->table = table;
    s->beneath = beneath;
    s->drops = drops;
    s->on_clock = on_clock;
    s->context = context;
    *state = s;
    return PM_OK;
}

// Tells once of each sender whose clock is ahead. A stamp that is behind may be that of a replayed
// message; a sender whose clock is behind finds the others' ahead.
static void tell_clock(sealed *s, const pm_seal_origin *origin) {
    int i = 0;
    while (i < s->ntold && strcmp(s->told[i], origin->sender) != 0) {
        ++i;
    }
    if (i == s->ntold && i < MOST_TOLD && s->on_clock != NULL) {
        strcpy(s->told[s->ntold++], origin->sender);
        s->on_clock(s->context, origin->sender, 1e-9 * (double)origin->ahead);
    }
}

static void check(void *context, const char *channel, const void *data, size_t size) {
    const sealed_subscription *s = context;
    pm_seal_origin origin;
    const pm_drop drop = pm_seal_check(s->owner->seal, channel, data, &size, &origin);
    if (drop == PM_KEEP) {
        s->handler(s->context, channel, data, size);
        return;
    }
    s->owner->drops->count[drop] += 1;
    if (drop == PM_DROP_CLOCK) {
        tell_clock(s->owner, &origin);
    }
}

static pm_status sealed_subscribe(void *state, const char *channel, pm_message_handler *handler,
                                  void *context) {
    sealed *s = state;
    sealed_subscription *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return pm_fail(PM_ENOMEM, "channel %s: out of memory", channel);
    }
    *made = (sealed_subscription){s->subscriptions, s, handler, context};
    s->subscriptions = made;
    return s->table->subscribe(s->beneath, channel, check, made);
}

static pm_status sealed_publish(void *state, const char *channel, const void *data, size_t size) {
    sealed *s = state;
    if (s->capacity < size + PM_SEAL_MOST) {
        const size_t capacity = 2 * size + FIRST_CAPACITY;
        unsigned char *larger = realloc(s->data, capacity);
        if (larger == NULL) {
            return pm_fail(PM_ENOMEM, "channel %s: no memory for %zu bytes", channel, size);
        }
        s->data = larger;
        s->capacity = capacity;
    }
    if (size > 0) {
        memcpy(s->data, data, size);
    }
    size += pm_seal_write(s->seal, channel, s->data, size, pm_seal_clock(s->seal));
    return s->table->publish(s->beneath, channel, s->data, size);
}

static pm_status sealed_wait(void *state, double seconds, int *handled) {
    const sealed *s = state;
    return s->table->wait(s->beneath, seconds, handled);
}

static int sealed_file(const void *state) {
    const sealed *s = state;
    return s->table->file(s->beneath);
}

const pm_transport_table pm_transport_sealed = {
    .close = sealed_close,
    .subscribe = sealed_subscribe,
    .publish = sealed_publish,
    .wait = sealed_wait,
    .file = sealed_file,
};
