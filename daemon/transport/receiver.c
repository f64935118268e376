// A multicast socket, its filter, and the dispatch of datagrams to handlers.
#include "transport/receiver.h"

#include <errno.h>
#include <math.h>
#include <poll.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"
#include "transport/channel_filter.h"
#include "transport/datagram.h"
#include "transport/multicast.h"
#include "transport/spin.h"

#define BATCH 16            // datagrams taken from the kernel at once
#define DATAGRAM_SIZE 65536 // bytes, of the largest
#define UDP_HEAD 8          // bytes of UDP's header, which the socket's filter sees, too

// Messages handled in one wait at most, so that a flood cannot keep the caller from its own work.
#define BURST 1024

typedef struct channel_subscription {
    char channel[PM_CHANNEL_SIZE];
    pm_message_handler *handler;
    void *context;
    pm_reassembly large; // a message in fragments
} channel_subscription;

struct pm_receiver {
    int file;
    pm_drops *drops;
    int count, capacity;
    channel_subscription *subscription; // [count], by channel if `sorted`
    bool sorted;                        // the filter is in place, too
    bool spins;
    pm_spin spin;
    unsigned char *data; // [BATCH][DATAGRAM_SIZE]
    struct mmsghdr head[BATCH];
    struct iovec vector[BATCH];
    struct sockaddr_in sender[BATCH];
};

// --- opening ---

static pm_status join(const pm_receiver *r, const char *url, const pm_lcm_url *address) {
    const int on = 1, off = 0;
    const struct ip_mreq membership = {address->group.sin_addr, {INADDR_ANY}};
    // Other processes of this host may read the same group. This socket receives no other group,
    // whatever others on the same port have joined.
    if (setsockopt(r->file, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 ||
        setsockopt(r->file, IPPROTO_IP, IP_MULTICAST_ALL, &off, sizeof off) != 0 ||
        bind(r->file, (const struct sockaddr *)&address->group, sizeof address->group) != 0) {
        return pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    }
    // The kernel's limit may allow less; then it gives as much as it allows.
    setsockopt(r->file, SOL_SOCKET, SO_RCVBUF, &address->receive_buffer, sizeof(int));
    if (setsockopt(r->file, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) != 0) {
        return pm_fail(
            PM_ENET, "transport \"%s\": cannot join the multicast group: %s; " PM_MULTICAST_REMEDY,
            url, strerror(errno));
    }
    return PM_OK;
}

pm_status pm_receiver_open(pm_receiver **receiver, const char *url, const pm_lcm_url *address,
                           pm_drops *drops) {
    pm_receiver *r = calloc(1, sizeof *r);
    if (r == NULL) {
        return pm_fail(PM_ENOMEM, "transport \"%s\": out of memory", url);
    }
    pm_status status = PM_OK;
    r->drops = drops;
    r->spins = address->spins;
    r->data = malloc((size_t)BATCH * DATAGRAM_SIZE);
    r->file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (r->data == NULL) {
        status = pm_fail(PM_ENOMEM, "transport \"%s\": out of memory", url);
    } else if (r->file < 0) {
        status = pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    } else {
        status = join(r, url, address);
    }
    if (status != PM_OK) {
        pm_receiver_close(r);
        return status;
    }
    for (int i = 0; i < BATCH; ++i) {
        r->vector[i] = (struct iovec){r->data + (size_t)i * DATAGRAM_SIZE, DATAGRAM_SIZE};
        r->head[i].msg_hdr =
            (struct msghdr){.msg_name = &r->sender[i], .msg_iov = &r->vector[i], .msg_iovlen = 1};
    }
    *receiver = r;
    return PM_OK;
}

void pm_receiver_close(pm_receiver *receiver) {
    if (receiver == NULL) {
        return;
    }
    if (receiver->file >= 0) {
        close(receiver->file);
    }
    for (int i = 0; i < receiver->count; ++i) {
        pm_reassembly_free(&receiver->subscription[i].large);
    }
    free(receiver->subscription);
    free(receiver->data);
    free(receiver);
}

// --- subscriptions ---

pm_status pm_receiver_subscribe(pm_receiver *receiver, const char *channel,
                                pm_message_handler *handler, void *context) {
    pm_receiver *r = receiver;
    if (r->count == r->capacity) {
        const int capacity = 2 * r->capacity + 8;
        channel_subscription *larger =
            realloc(r->subscription, (size_t)capacity * sizeof *r->subscription);
        if (larger == NULL) {
            return pm_fail(PM_ENOMEM, "channel %s: out of memory", channel);
        }
        r->subscription = larger;
        r->capacity = capacity;
    }
    channel_subscription *s = &r->subscription[r->count++];
    *s = (channel_subscription){.handler = handler, .context = context};
    strcpy(s->channel, channel);
    r->sorted = false;
    return PM_OK;
}

static int compare_channels(const void *a, const void *b) {
    return strcmp(((const channel_subscription *)a)->channel,
                  ((const channel_subscription *)b)->channel);
}

// Sorts the subscriptions and tells the kernel which channels are wanted.
static pm_status sort_subscriptions(pm_receiver *r) {
    qsort(r->subscription, (size_t)r->count, sizeof *r->subscription, compare_channels);
    const char **name = calloc((size_t)r->count + 1, sizeof *name);
    if (name == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the names of channels");
    }
    int count = 0;
    for (int i = 0; i < r->count; ++i) {
        if (count == 0 || strcmp(name[count - 1], r->subscription[i].channel) != 0) {
            name[count++] = r->subscription[i].channel;
        }
    }
    struct sock_fprog program;
    const pm_status status = pm_channel_filter_build(&program, count, name, UDP_HEAD);
    free(name);
    PM_TRY(status);
    if (program.filter != NULL) {
        // If the kernel refuses the filter, find_subscription drops the other channels.
        setsockopt(r->file, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program);
    } else {
        setsockopt(r->file, SOL_SOCKET, SO_DETACH_FILTER, NULL, 0);
    }
    free(program.filter);
    r->sorted = true;
    return PM_OK;
}

// Returns the first subscription to this channel, or NULL.
static channel_subscription *find_subscription(const pm_receiver *r, const char *channel) {
    int low = 0, high = r->count;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (strcmp(r->subscription[middle].channel, channel) < 0) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    const bool found = low < r->count && strcmp(r->subscription[low].channel, channel) == 0;
    return found ? &r->subscription[low] : NULL;
}

// --- receiving ---

// Passes a message to every subscription to its channel, from `first` on.
static void dispatch(const pm_receiver *r, const channel_subscription *first, const void *data,
                     size_t size) {
    const channel_subscription *end = r->subscription + r->count;
    for (const channel_subscription *s = first; s < end && strcmp(s->channel, first->channel) == 0;
         ++s) {
        s->handler(s->context, s->channel, data, size);
    }
}

// Handles a fragment. A first fragment names its channel and begins a message; later ones are added
// to it.
static pm_status take_fragment(pm_receiver *r, channel_subscription *s, const pm_datagram *d,
                               uint64_t sender) {
    if (s != NULL) {
        PM_TRY(pm_reassembly_begin(&s->large, d, sender, &r->drops->count[PM_DROP_FRAGMENT]));
    } else if (d->channel == NULL) {
        for (int i = 0; i < r->count && s == NULL; ++i) {
            if (pm_reassembly_add(&r->subscription[i].large, d, sender)) {
                s = &r->subscription[i];
            }
        }
    }
    if (s != NULL && pm_reassembly_complete(&s->large)) {
        dispatch(r, s, s->large.data, s->large.total);
        s->large.count = 0;
    }
    return PM_OK;
}

static pm_status take_datagram(pm_receiver *r, int i) {
    pm_datagram d;
    if ((r->head[i].msg_hdr.msg_flags & MSG_TRUNC) != 0 ||
        !pm_datagram_parse(&d, r->vector[i].iov_base, r->head[i].msg_len)) {
        r->drops->count[PM_DROP_DATAGRAM] += 1;
        return PM_OK;
    }
    channel_subscription *s = d.channel == NULL ? NULL : find_subscription(r, d.channel);
    if (d.count > 1 || d.channel == NULL) {
        const struct sockaddr_in *from = &r->sender[i];
        return take_fragment(r, s, &d, (uint64_t)from->sin_addr.s_addr << 16 | from->sin_port);
    }
    if (s != NULL) {
        dispatch(r, s, d.data, d.size);
    }
    return PM_OK;
}

// Receives and dispatches one batch of datagrams; `count` receives their number.
static pm_status take_batch(pm_receiver *r, int *count) {
    for (int i = 0; i < BATCH; ++i) {
        r->head[i].msg_hdr.msg_namelen = sizeof r->sender[i];
    }
    *count = recvmmsg(r->file, r->head, BATCH, MSG_DONTWAIT, NULL);
    if (*count < 0) {
        *count = 0;
        // An unreachable port, or a network that is down for a while, does not end listening.
        return PM_OK;
    }
    for (int i = 0; i < *count; ++i) {
        PM_TRY(take_datagram(r, i));
    }
    return PM_OK;
}

static pm_status sleep_for(const pm_receiver *r, double seconds) {
    const double whole = floor(seconds);
    const struct timespec timeout = {(time_t)whole, (long)(1e9 * (seconds - whole))};
    struct pollfd file = {r->file, POLLIN, 0};
    return ppoll(&file, 1, &timeout, NULL) >= 0 || errno == EINTR
               ? PM_OK
               : pm_fail(PM_ENET, "waiting for messages: %s", strerror(errno));
}

// Polls without sleeping, for the time that pm_spin_time allows; `count` receives the number of
// datagrams.
static pm_status poll_batch(pm_receiver *r, double start, double seconds, int *count) {
    const double most = pm_spin_time(&r->spin, start);
    const double end = start + (seconds < most ? seconds : most);
    *count = 0;
    for (double now = start, before = start; now < end && *count == 0; before = now) {
        PM_TRY(take_batch(r, count));
        if (*count == 0) {
            sched_yield();
            now = pm_clock();
            pm_spin_note_yield(&r->spin, now - before, now);
        }
    }
    return PM_OK;
}

// Receives the first batch of datagrams, if one comes within `seconds`.
static pm_status await_batch(pm_receiver *r, double seconds, int *count) {
    const double start = pm_clock();
    *count = 0;
    if (r->spins) {
        PM_TRY(poll_batch(r, start, seconds, count));
    }
    if (*count == 0) {
        const double left = start + seconds - pm_clock();
        PM_TRY(sleep_for(r, left > 0 ? left : 0));
        PM_TRY(take_batch(r, count));
    }
    pm_spin_note_wait(&r->spin, pm_clock() - start);
    return PM_OK;
}

pm_status pm_receiver_wait(pm_receiver *receiver, double seconds, int *handled) {
    pm_receiver *r = receiver;
    if (!r->sorted) {
        PM_TRY(sort_subscriptions(r));
    }
    int count;
    PM_TRY(seconds > 0 ? await_batch(r, seconds, &count) : take_batch(r, &count));
    *handled = count;
    while (count == BATCH && *handled < BURST) {
        PM_TRY(take_batch(r, &count));
        *handled += count;
    }
    return PM_OK;
}

int pm_receiver_file(const pm_receiver *receiver) {
    return receiver->file;
}
