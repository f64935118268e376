// LCM as a transport. This is the only file that calls liblcm. liblcm publishes; a receiver of this
// program receives (receiver.h), or liblcm where the URL says so. Its queues are then unlimited,
// since LCM's default silently drops all but the oldest 30 messages.
#include <ctype.h>
#include <errno.h>
#include <lcm/lcm.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "transport/lcm_url.h"
#include "transport/multicast.h"
#include "transport/receiver.h"
#include "transport/splitter.h"
#include "transport/transport_table.h"

// Messages handled in one wait at most, so that a flood cannot keep the caller from its own work.
#define BURST 1024

typedef struct liblcm_subscription {
    struct liblcm_subscription *next;
    pm_message_handler *handler;
    void *context;
} liblcm_subscription;

// Receiving begins with the first subscription, so that no messages pile up at an endpoint that
// only publishes.
typedef struct lcm_endpoint {
    lcm_t *lcm;
    pm_splitter *splitter; // of messages that are too large for a packet; NULL: liblcm sends them
    char *url;
    pm_drops *drops;
    pm_receiver *receiver; // NULL: liblcm receives, for `subscriptions`, or nobody
    int file;              // -1: nobody receives
    liblcm_subscription *subscriptions;
} lcm_endpoint;

static void lcm_endpoint_close(void *state) {
    lcm_endpoint *e = state;
    pm_receiver_close(e->receiver);
    if (e->lcm != NULL) {
        lcm_destroy(e->lcm);
    }
    while (e->subscriptions != NULL) {
        liblcm_subscription *next = e->subscriptions->next;
        free(e->subscriptions);
        e->subscriptions = next;
    }
    pm_splitter_close(e->splitter);
    free(e->url);
    free(e);
}

// Makes the URL for liblcm: the address and the options that it knows. NULL: out of memory.
static char *provider_of(const char *url, const pm_lcm_url *parsed) {
    const size_t size = strlen(url) + 64;
    char *text = malloc(size);
    if (text == NULL) {
        return NULL;
    }
    const char *ttl = strstr(url, "ttl=");
    snprintf(text, size, "%.*s?recv_buf_size=%d%s%.*s", (int)strcspn(url, "?"), url,
             parsed->receive_buffer, ttl == NULL ? "" : "&",
             ttl == NULL ? 0 : (int)strcspn(ttl, "&"), ttl == NULL ? "" : ttl);
    return text;
}

static pm_status lcm_endpoint_open(void **state, const char *url, pm_hub *hub, pm_drops *drops) {
    (void)hub;
    pm_lcm_url parsed;
    PM_TRY(pm_lcm_url_parse(url, &parsed));
    PM_TRY(pm_multicast_check(url, parsed.group.sin_addr));
    pm_status status = PM_OK;
    lcm_endpoint *e = calloc(1, sizeof *e);
    char *provider = provider_of(url, &parsed);
    if (e == NULL || provider == NULL || (e->url = strdup(url)) == NULL) {
        status = pm_fail(PM_ENOMEM, "transport \"%s\": out of memory", url);
        goto done;
    }
    e->drops = drops;
    e->file = -1;
    e->lcm = lcm_create(provider);
    if (e->lcm == NULL) {
        status = pm_fail(PM_ENET, "transport \"%s\": LCM cannot open it", url);
        goto done;
    }
    if (strncmp(url, "udpm:", 5) == 0) {
        PM_TRY_DONE(pm_splitter_open(&e->splitter, url, &parsed));
    }
    *state = e;
done:
    free(provider);
    if (status != PM_OK && e != NULL) {
        lcm_endpoint_close(e);
    }
    return status;
}

static pm_status begin_receiving(lcm_endpoint *e) {
    pm_lcm_url parsed;
    PM_TRY(pm_lcm_url_parse(e->url, &parsed));
    if (parsed.receives_itself) {
        PM_TRY(pm_receiver_open(&e->receiver, e->url, &parsed, e->drops));
        e->file = pm_receiver_file(e->receiver);
    } else {
        e->file = lcm_get_fileno(e->lcm);
    }
    return PM_OK;
}

static void receive(const lcm_recv_buf_t *buffer, const char *channel, void *context) {
    const liblcm_subscription *s = context;
    s->handler(s->context, channel, buffer->data, buffer->data_size);
}

static pm_status lcm_endpoint_subscribe(void *state, const char *channel,
                                        pm_message_handler *handler, void *context) {
    lcm_endpoint *e = state;
    PM_TRY(e->file < 0 ? begin_receiving(e) : PM_OK);
    if (e->receiver != NULL) {
        return pm_receiver_subscribe(e->receiver, channel, handler, context);
    }
    liblcm_subscription *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "channel %s: out of memory", channel);
    }
    s->handler = handler;
    s->context = context;
    s->next = e->subscriptions;
    e->subscriptions = s;
    // LCM takes a regular expression, and anchors it at both ends.
    char pattern[2 * PM_CHANNEL_SIZE];
    size_t length = 0;
    for (const char *c = channel; *c != 0; ++c) {
        if (!isalnum((unsigned char)*c) && *c != '_') {
            pattern[length++] = '\\';
        }
        pattern[length++] = *c;
    }
    pattern[length] = 0;
    lcm_subscription_t *made = lcm_subscribe(e->lcm, pattern, receive, s);
    if (made == NULL || lcm_subscription_set_queue_capacity(made, 0) != 0) {
        return pm_fail(PM_ENET, "channel %s: LCM cannot subscribe", channel);
    }
    return PM_OK;
}

static pm_status lcm_endpoint_publish(void *state, const char *channel, const void *data,
                                      size_t size) {
    const lcm_endpoint *e = state;
    errno = 0;
    const bool split = e->splitter != NULL && pm_splitter_is_needed(e->splitter, channel, size);
    if ((split ? pm_splitter_publish(e->splitter, channel, data, size)
               : lcm_publish(e->lcm, channel, data, (unsigned int)size)) == 0) {
        return PM_OK;
    }
    switch (errno) {
    case EAGAIN:
    case EINTR:
    case ENOBUFS:
    case EPERM:       // a packet filter
        return PM_OK; // the message is lost, as any message may be
    case ENETDOWN:
    case ENETUNREACH:
        return pm_fail(PM_ENET, "channel %s: %s; " PM_MULTICAST_REMEDY, channel, strerror(errno));
    default:
        return pm_fail(PM_ENET, "channel %s: cannot publish %zu bytes: %s", channel, size,
                       strerror(errno));
    }
}

static pm_status lcm_endpoint_wait(void *state, double seconds, int *handled) {
    const lcm_endpoint *e = state;
    if (e->receiver != NULL) {
        return pm_receiver_wait(e->receiver, seconds, handled);
    }
    const double whole = floor(seconds);
    const struct timespec timeout = {(time_t)whole, (long)(1e9 * (seconds - whole))};
    struct pollfd file = {e->file, POLLIN, 0};
    int ready = ppoll(&file, 1, &timeout, NULL);
    while (ready > 0 && *handled < BURST) {
        if (lcm_handle(e->lcm) != 0) {
            return pm_fail(PM_ENET, "LCM cannot receive");
        }
        *handled += 1;
        ready = poll(&file, 1, 0);
    }
    if (ready < 0 && errno != EINTR) {
        return pm_fail(PM_ENET, "waiting for messages: %s", strerror(errno));
    }
    return PM_OK;
}

static pm_status lcm_endpoint_check(const char *url) {
    pm_lcm_url parsed;
    return pm_lcm_url_parse(url, &parsed);
}

static int lcm_endpoint_file(const void *state) {
    return ((const lcm_endpoint *)state)->file;
}

const pm_transport_table pm_transport_lcm = {
    lcm_endpoint_check,   lcm_endpoint_open, lcm_endpoint_close, lcm_endpoint_subscribe,
    lcm_endpoint_publish, lcm_endpoint_wait, lcm_endpoint_file,  NULL,
};
