// Each receiver has a queue. Message buffers are reused, so that the steps of a run allocate
// nothing.
#include "tests/support/memory_hub.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "transport/transport_table.h"

typedef struct memory_subscription {
    struct memory_subscription *next;
    pm_message_handler *handler;
    void *context;
    char channel[PM_CHANNEL_SIZE];
} memory_subscription;

typedef struct queued_message {
    struct queued_message *next;
    const memory_subscription *to;
    long due; // the receiver's count of waits at which it is passed on
    size_t size, capacity;
    unsigned char data[];
} queued_message;

typedef struct memory_endpoint {
    struct memory_endpoint *next;
    pm_hub *hub;
    memory_subscription *subscriptions;
    queued_message *head, **tail; // waiting, oldest first; where the next one is linked
    long waits;                   // calls of pm_transport_wait so far
} memory_endpoint;

struct pm_hub {
    memory_endpoint *endpoints;
    queued_message *unused;
    pm_hub_faults faults;
    pm_rng rng;
    const pm_key *key; // with which transports seal; NULL: they do not
};

static void free_messages(queued_message *m) {
    while (m != NULL) {
        queued_message *next = m->next;
        free(m);
        m = next;
    }
}

pm_status pm_hub_open(pm_hub **hub, const pm_hub_faults *faults) {
    pm_hub *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return pm_fail(PM_ENOMEM, "message hub: out of memory");
    }
    if (faults != NULL) {
        made->faults = *faults;
    }
    pm_rng_init(&made->rng, made->faults.seed, 0);
    *hub = made;
    return PM_OK;
}

void pm_hub_close(pm_hub *hub) {
    if (hub != NULL) {
        free_messages(hub->unused);
        free(hub);
    }
}

static void memory_close(void *state) {
    memory_endpoint *e = state;
    memory_endpoint **link = &e->hub->endpoints;
    while (*link != e) {
        link = &(*link)->next;
    }
    *link = e->next;
    free_messages(e->head);
    while (e->subscriptions != NULL) {
        memory_subscription *next = e->subscriptions->next;
        free(e->subscriptions);
        e->subscriptions = next;
    }
    free(e);
}

static pm_status memory_subscribe(void *state, const char *channel, pm_message_handler *handler,
                                  void *context) {
    memory_endpoint *e = state;
    memory_subscription *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "channel %s: out of memory", channel);
    }
    s->handler = handler;
    s->context = context;
    strcpy(s->channel, channel);
    s->next = e->subscriptions;
    e->subscriptions = s;
    return PM_OK;
}

// Returns a buffer for `size` bytes: the first unused one that is large enough, else a new one.
static queued_message *take_message(pm_hub *hub, size_t size) {
    for (queued_message **link = &hub->unused; *link != NULL; link = &(*link)->next) {
        queued_message *m = *link;
        if (m->capacity >= size) {
            *link = m->next;
            return m;
        }
    }
    const size_t capacity = size < 256 ? 256 : size;
    queued_message *m = malloc(sizeof *m + capacity);
    if (m != NULL) {
        m->capacity = capacity;
    }
    return m;
}

static pm_status enqueue(memory_endpoint *e, const memory_subscription *to, const void *data,
                         size_t size) {
    pm_hub *hub = e->hub;
    queued_message *m = take_message(hub, size);
    if (m == NULL) {
        return pm_fail(PM_ENOMEM, "channel %s: out of memory", to->channel);
    }
    m->next = NULL;
    m->to = to;
    m->due = 0;
    m->size = size;
    memcpy(m->data, data, size);
    if (hub->faults.delay > 0 && pm_rng_uniform(&hub->rng) < hub->faults.delay) {
        m->due = e->waits + 1 + (long)pm_rng_below(&hub->rng, (uint64_t)hub->faults.max_delay);
    }
    *e->tail = m;
    e->tail = &m->next;
    return PM_OK;
}

static pm_status memory_publish(void *state, const char *channel, const void *data, size_t size) {
    pm_hub *hub = ((memory_endpoint *)state)->hub;
    const pm_hub_faults *faults = &hub->faults;
    for (memory_endpoint *e = hub->endpoints; e != NULL; e = e->next) {
        for (const memory_subscription *s = e->subscriptions; s != NULL; s = s->next) {
            if (strcmp(s->channel, channel) != 0) {
                continue;
            }
            if (faults->drop > 0 && pm_rng_uniform(&hub->rng) < faults->drop) {
                continue;
            }
            PM_TRY(enqueue(e, s, data, size));
            if (faults->duplicate > 0 && pm_rng_uniform(&hub->rng) < faults->duplicate) {
                PM_TRY(enqueue(e, s, data, size));
            }
        }
    }
    return PM_OK;
}

static pm_status memory_wait(void *state, double seconds, int *handled) {
    (void)seconds;
    memory_endpoint *e = state;
    e->waits += 1;
    // Only the messages that are queued now are passed on, since handlers may add more.
    const queued_message *const *end = (const queued_message *const *)e->tail;
    queued_message **link = &e->head;
    for (bool more = e->head != NULL; more;) {
        queued_message *m = *link;
        more = (const queued_message *const *)&m->next != end;
        if (m->due > e->waits) {
            link = &m->next;
            continue;
        }
        *link = m->next;
        if (e->tail == &m->next) {
            e->tail = link;
        }
        m->to->handler(m->to->context, m->to->channel, m->data, m->size);
        *handled += 1;
        m->next = e->hub->unused;
        e->hub->unused = m;
    }
    return PM_OK;
}

static int memory_file(const void *state) {
    (void)state;
    return -1;
}

static const pm_transport_table table = {
    .close = memory_close,
    .subscribe = memory_subscribe,
    .publish = memory_publish,
    .wait = memory_wait,
    .file = memory_file,
};

pm_status pm_hub_connect(pm_hub *hub, pm_transport **transport) {
    memory_endpoint *e = calloc(1, sizeof *e);
    if (e == NULL) {
        return pm_fail(PM_ENOMEM, "message hub: out of memory");
    }
    const pm_status status = pm_transport_make(transport, &table, e);
    if (status != PM_OK) {
        free(e);
        return status;
    }
    e->hub = hub;
    e->tail = &e->head;
    // At the end of the list: messages go out in the order in which endpoints were opened.
    memory_endpoint **link = &hub->endpoints;
    while (*link != NULL) {
        link = &(*link)->next;
    }
    *link = e;
    return hub->key == NULL ? PM_OK
                            : pm_transport_seal(*transport, hub->key, "test@hub", NULL, NULL);
}

void pm_hub_seal(pm_hub *hub, const pm_key *key) {
    hub->key = key;
}
