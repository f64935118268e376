// A transport in front of another one that loses, delays and repeats received messages, as a bad
// network does. It lets anybody try, without rights over the network, what loss does to a run.
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/progress.h"
#include "base/rng.h"
#include "transport/transport_table.h"

#define LATEST 0.004 // s, of a delay

typedef struct faulty_subscription {
    struct faulty *owner;
    pm_message_handler *handler;
    void *context;
    struct faulty_subscription *next;
} faulty_subscription;

// A message that comes later.
typedef struct late {
    double due; // s of pm_clock
    const faulty_subscription *to;
    struct late *next;
    size_t size;
    char channel[PM_CHANNEL_SIZE];
    char data[];
} late;

typedef struct faulty {
    pm_transport_front front;
    double lose, mix;
    pm_rng rng;
    faulty_subscription *subscriptions;
    late *queue;
} faulty;

// Reads the option NAME=FRACTION of a URL; 0 if it does not have it.
static pm_status read_fraction(const char *url, const char *name, double *value) {
    *value = 0;
    for (const char *at = strchr(url, '?'); at != NULL; at = strchr(at, '&')) {
        ++at;
        const size_t length = strlen(name);
        if (strncmp(at, name, length) == 0 && at[length] == '=') {
            char *end;
            *value = strtod(at + length + 1, &end);
            return end > at + length + 1 && (*end == '&' || *end == '\0') && *value >= 0 &&
                           *value < 1
                       ? PM_OK
                       : pm_fail(PM_ECONFIG,
                                 "expected a number from 0 to below 1 as %s, found \"%.64s\"", name,
                                 url);
        }
    }
    return PM_OK;
}

static void faulty_close(void *state) {
    faulty *f = state;
    f->front.table->close(f->front.beneath);
    while (f->subscriptions != NULL) {
        faulty_subscription *s = f->subscriptions;
        f->subscriptions = s->next;
        free(s);
    }
    while (f->queue != NULL) {
        late *l = f->queue;
        f->queue = l->next;
        free(l);
    }
    free(f);
}

static void receive(void *context, const char *channel, const void *data, size_t size) {
    const faulty_subscription *s = context;
    faulty *f = s->owner;
    if (pm_rng_uniform(&f->rng) < f->lose) {
        return;
    }
    const bool mixed = pm_rng_uniform(&f->rng) < f->mix, repeated = pm_rng_uniform(&f->rng) < 0.5;
    late *l = mixed ? malloc(sizeof *l + size) : NULL;
    if (l != NULL) {
        *l = (late){.due = pm_clock() + LATEST * pm_rng_uniform(&f->rng), .to = s, .size = size};
        strcpy(l->channel, channel);
        memcpy(l->data, data, size);
        l->next = f->queue;
        f->queue = l;
    }
    if (l == NULL || repeated) {
        s->handler(s->context, channel, data, size);
    }
}

static pm_status faulty_subscribe(void *state, const char *channel, pm_message_handler *handler,
                                  void *context) {
    faulty *f = state;
    faulty_subscription *s = calloc(1, sizeof *s);
    PM_TRY(pm_allocated(s, "channel %s", channel));
    *s = (faulty_subscription){f, handler, context, f->subscriptions};
    f->subscriptions = s;
    return pm_front_subscribe(f, channel, receive, s);
}

static pm_status faulty_wait(void *state, double seconds, int *handled) {
    faulty *f = state;
    double now = pm_clock();
    for (const late *l = f->queue; l != NULL; l = l->next) {
        seconds = l->due - now < seconds ? l->due - now : seconds;
    }
    PM_TRY(pm_front_wait(f, seconds > 0 ? seconds : 0, handled));
    now = pm_clock();
    for (late **l = &f->queue; *l != NULL;) {
        late *due = *l;
        if (due->due > now) {
            l = &due->next;
            continue;
        }
        *l = due->next;
        due->to->handler(due->to->context, due->channel, due->data, due->size);
        free(due);
        *handled += 1;
    }
    return PM_OK;
}

static const pm_transport_table faulty_table = {
    .close = faulty_close,
    .subscribe = faulty_subscribe,
    .publish = pm_front_publish,
    .wait = faulty_wait,
    .file = pm_front_file,
};

pm_status pm_transport_faulty_open(const char *url, const pm_transport_table **table,
                                   void **state) {
    double lose, mix;
    PM_TRY(read_fraction(url, "lose", &lose));
    PM_TRY(read_fraction(url, "mix", &mix));
    if (state == NULL || (lose == 0 && mix == 0)) {
        return PM_OK;
    }
    faulty *f = NULL;
    PM_TRY(PM_NEW(f, "a transport"));
    *f = (faulty){.front = {*table, *state}, .lose = lose, .mix = mix};
    pm_rng_init(&f->rng, (uint64_t)getpid(), 0);
    *table = &faulty_table;
    *state = f;
    return PM_OK;
}
