// LCM as a transport. This is the only file that calls liblcm. liblcm publishes, but messages that
// are larger than a packet are split by this program. This program receives, or liblcm where the
// URL says so. liblcm's queues are then unlimited, since LCM's default silently drops all but the
// oldest 30 messages.
#include <arpa/inet.h>
#include <ctype.h>
#include <endian.h>
#include <errno.h>
#include <lcm/lcm.h>
#include <math.h>
#include <poll.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"
#include "transport/datagram.h"
#include "transport/spin.h"
#include "transport/transport_table.h"

// Messages handled in one wait at most, so that a flood cannot keep the caller from its own work.
#define BURST 1024

// --- URLs ---

// Parses an LCM URL: "udpm://GROUP:PORT" or "mpudpm://GROUP:PORT", perhaps with options
// "?NAME=VALUE&NAME=VALUE". Only its form is checked; opening a transport shows whether messages
// get through.
typedef struct lcm_url {
    struct sockaddr_in group; // multicast group and port
    int receive_buffer;       // recv_buf_size=N: bytes of the kernel's buffer
    int ttl;                  // ttl=N: hops of a multicast packet; 0, the default: this host alone
    bool receives_itself;     // receive=own (the default of udpm) or receive=lcm
    bool spins;               // spin=yes (spin.h; the default) or spin=no, with receive=own
} lcm_url;

// Bytes of the kernel's buffer: room for about 9600 small messages; the usual default holds 256.
#define RECEIVE_BUFFER 4000000

// Reads ":PORT", which ends the URL or precedes its options. Returns 0 if the text is something
// else.
static in_port_t read_port(const char *text) {
    if (*text != ':') {
        return 0;
    }
    const size_t count = strspn(text + 1, "0123456789");
    const char end = text[1 + count];
    const long port = strtol(text + 1, NULL, 10);
    const bool good = count > 0 && port >= 1 && port <= 65535 && (end == 0 || end == '?');
    return good ? (in_port_t)port : 0;
}

static bool read_address(const char *url, struct sockaddr_in *group) {
    const char *scheme = url + (url[0] == 'm' && url[1] == 'p' ? 2 : 0);
    if (strncmp(scheme, "udpm://", 7) != 0) {
        return false;
    }
    const char *address = scheme + 7;
    const size_t host_size = strcspn(address, ":?");
    char host[INET_ADDRSTRLEN] = "";
    if (host_size < sizeof host) {
        memcpy(host, address, host_size);
    }
    *group = (struct sockaddr_in){.sin_family = AF_INET};
    group->sin_port = htons(read_port(address + host_size));
    return inet_pton(AF_INET, host, &group->sin_addr) == 1 &&
           IN_MULTICAST(ntohl(group->sin_addr.s_addr)) && group->sin_port != 0;
}

// Returns the value of an option, and writes its length to `length`; NULL if the URL does not have
// the option.
static const char *find_option(const char *url, const char *name, size_t *length) {
    const char *option = strchr(url, '?');
    while (option != NULL) {
        ++option;
        const size_t size = strlen(name);
        if (strncmp(option, name, size) == 0 && option[size] == '=') {
            *length = strcspn(option + size + 1, "&");
            return option + size + 1;
        }
        option = strchr(option, '&');
    }
    return NULL;
}

static bool is(const char *value, size_t length, const char *word) {
    return value != NULL && length == strlen(word) && strncmp(value, word, length) == 0;
}

// Reads an option whose value is a whole number; `number` keeps its value if the URL does not have
// the option.
static pm_status read_number(const char *url, const char *name, int least, int most, int *number) {
    size_t length = 0;
    const char *value = find_option(url, name, &length);
    if (value == NULL) {
        return PM_OK;
    }
    char *end;
    const long found = strtol(value, &end, 10);
    if (length == 0 || end != value + length || found < least || found > most) {
        return pm_fail(PM_ECONFIG, "expected %d to %d as %s, found \"%.64s\"", least, most, name,
                       url);
    }
    *number = (int)found;
    return PM_OK;
}

static pm_status read_options(const char *url, lcm_url *parsed) {
    parsed->receive_buffer = RECEIVE_BUFFER;
    parsed->ttl = 0;
    PM_TRY(read_number(url, "recv_buf_size", 1, 1 << 30, &parsed->receive_buffer));
    PM_TRY(read_number(url, "ttl", 0, 255, &parsed->ttl));
    size_t length = 0;
    const char *value = find_option(url, "spin", &length);
    const bool no = is(value, length, "no");
    if (value != NULL && !no && !is(value, length, "yes")) {
        return pm_fail(PM_ECONFIG, "expected yes or no as spin, found \"%.64s\"", url);
    }
    parsed->spins = !no;
    value = find_option(url, "receive", &length);
    const bool own = is(value, length, "own"), lcm = is(value, length, "lcm");
    const bool udpm = strncmp(url, "udpm:", 5) == 0;
    if ((value != NULL && !own && !lcm) || (own && !udpm)) {
        return pm_fail(PM_ECONFIG, "expected own (udpm only) or lcm as receive, found \"%.64s\"",
                       url);
    }
    parsed->receives_itself = udpm && !lcm;
    return PM_OK;
}

static pm_status parse_url(const char *url, lcm_url *parsed) {
    if (!read_address(url, &parsed->group)) {
        return pm_fail(PM_ECONFIG,
                       "expected udpm://GROUP:PORT or mpudpm://GROUP:PORT, an IPv4 multicast group "
                       "from 224.0.0.0 to 239.255.255.255 and a port from 1 to 65535, found "
                       "\"%.64s\"",
                       url);
    }
    return read_options(url, parsed);
}

// --- whether multicast works ---

// Tests whether this host can send and receive multicast. The test comes before LCM is opened,
// because LCM prints a page of text to standard error if multicast fails.
// The commands that enable multicast on one host, for error messages.
#define MULTICAST_REMEDY                                              \
    "run \"ip link set lo up\", \"ip link set lo multicast on\" and " \
    "\"ip route add 224.0.0.0/4 dev lo\""

// On one host a datagram takes microseconds, but a busy machine may wake this process late.
#define ECHO_TIMEOUT 500 // ms

static pm_status fail_route(const char *url, const char *what, const char *why) {
    return pm_fail(PM_ENET, "transport \"%s\": %s: %s; for this host only, " MULTICAST_REMEDY, url,
                   what, why);
}

// Sends one datagram to the group at a free port, and reads it back.
static pm_status echo(int file, const char *url, struct in_addr group) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_ANY)}};
    socklen_t size = sizeof here;
    if (bind(file, (const struct sockaddr *)&here, size) != 0 ||
        getsockname(file, (struct sockaddr *)&here, &size) != 0) {
        return pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    }
    const struct ip_mreq membership = {.imr_multiaddr = group, .imr_interface = {INADDR_ANY}};
    if (setsockopt(file, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) != 0) {
        return fail_route(url, "cannot join the multicast group", strerror(errno));
    }
    const unsigned char ttl = 0;
    setsockopt(file, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
    const struct sockaddr_in there = {AF_INET, here.sin_port, group, {0}};
    if (sendto(file, "", 1, 0, (const struct sockaddr *)&there, sizeof there) != 1) {
        return fail_route(url, "cannot send to the multicast group", strerror(errno));
    }
    struct pollfd readable = {file, POLLIN, 0};
    if (poll(&readable, 1, ECHO_TIMEOUT) != 1) {
        return fail_route(url, "multicast messages do not come back",
                          "a firewall, or an interface without multicast");
    }
    return PM_OK;
}

static pm_status check_multicast(const char *url, struct in_addr group) {
    const int file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (file < 0) {
        return pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    }
    const pm_status status = echo(file, url, group);
    close(file);
    return status;
}

// --- splitting ---

// Publishes LCM messages that are larger than a packet of the network. liblcm would send up to 64
// kB as one datagram, which IP then cuts into fragments; some switches and firewalls drop these,
// and the kernel gives few of them room. A splitter sends LCM's own fragments (datagram.h), each of
// which is a packet, so that every LCM program can join them.
#define SENT_AT_ONCE 32  // datagrams given to the kernel at once
#define PACKET_HEAD 28   // bytes of the headers of IP and UDP
#define LEAST_PACKET 576 // bytes, of the smallest packets that a network may have

typedef struct splitter {
    int file;
    size_t largest; // bytes of a datagram that fits into a packet
    uint32_t sequence;
    unsigned char head[SENT_AT_ONCE][PM_DATAGRAM_FRAGMENT_HEAD];
    struct iovec part[SENT_AT_ONCE][3]; // header, channel or nothing, data
    struct mmsghdr datagram[SENT_AT_ONCE];
} splitter;

static void splitter_close(splitter *s) {
    if (s != NULL) {
        if (s->file >= 0) {
            close(s->file);
        }
        free(s);
    }
}

static pm_status splitter_open(splitter **made, const char *url, const lcm_url *address) {
    splitter *s = NULL;
    PM_TRY(PM_NEW(s, url));
    const unsigned char ttl = (unsigned char)address->ttl;
    int packet = 0;
    socklen_t size = sizeof packet;
    s->file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (s->file < 0 || setsockopt(s->file, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl) != 0 ||
        connect(s->file, (const struct sockaddr *)&address->group, sizeof address->group) != 0 ||
        getsockopt(s->file, IPPROTO_IP, IP_MTU, &packet, &size) != 0) {
        const pm_status status =
            pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
        splitter_close(s);
        return status;
    }
    s->largest = (size_t)(packet < LEAST_PACKET ? LEAST_PACKET : packet) - PACKET_HEAD;
    for (int i = 0; i < SENT_AT_ONCE; ++i) {
        s->datagram[i].msg_hdr = (struct msghdr){.msg_iov = s->part[i], .msg_iovlen = 3};
    }
    *made = s;
    return PM_OK;
}

// The number of fragments of a message of `size` bytes with its channel.
static size_t count_fragments(const splitter *s, size_t size) {
    const size_t room = s->largest - PM_DATAGRAM_FRAGMENT_HEAD;
    return (size + room - 1) / room;
}

static int splitter_publish(splitter *s, const char *channel, const void *data, size_t size) {
    const size_t name = strlen(channel) + 1, count = count_fragments(s, name + size);
    size_t offset = 0;
    unsigned filled = 0;
    s->sequence += 1;
    for (size_t i = 0; i < count; ++i) {
        const size_t first = i == 0 ? name : 0;
        const size_t room = s->largest - PM_DATAGRAM_FRAGMENT_HEAD - first;
        const size_t part = size - offset < room ? size - offset : room;
        const uint32_t word[4] = {htobe32(PM_DATAGRAM_FRAGMENT), htobe32(s->sequence),
                                  htobe32((uint32_t)size), htobe32((uint32_t)offset)};
        const uint16_t half[2] = {htobe16((uint16_t)i), htobe16((uint16_t)count)};
        memcpy(s->head[filled], word, sizeof word);
        memcpy(s->head[filled] + sizeof word, half, sizeof half);
        s->part[filled][0] = (struct iovec){s->head[filled], PM_DATAGRAM_FRAGMENT_HEAD};
        s->part[filled][1] = (struct iovec){(char *)channel, first};
        s->part[filled][2] = (struct iovec){(char *)data + offset, part};
        offset += part;
        filled += 1;
        if (filled == SENT_AT_ONCE || i + 1 == count) {
            for (unsigned sent = 0; sent < filled;) {
                const int more = sendmmsg(s->file, s->datagram + sent, filled - sent, MSG_NOSIGNAL);
                if (more < 0) {
                    return -1;
                }
                sent += (unsigned)more;
            }
            filled = 0;
        }
    }
    return 0;
}

// --- receiving ---

// Receives LCM messages of one multicast group on a socket of this program. Compared with liblcm's
// receiving it saves a thread, a pipe, and a wake-up of every process for every message of the
// group: the kernel delivers only the channels that are subscribed to (datagram.h), several
// messages per call, and short waits poll instead of sleeping (spin.h). Publishing stays with
// liblcm.
#define RECEIVED_AT_ONCE 16 // datagrams taken from the kernel at once
#define DATAGRAM_SIZE 65536 // bytes, of the largest
#define UDP_HEAD 8          // bytes of UDP's header, which the socket's filter sees, too

typedef struct channel_subscription {
    char channel[PM_CHANNEL_SIZE];
    pm_message_handler *handler;
    void *context;
    pm_reassembly large; // a message in fragments
} channel_subscription;

typedef struct receiver {
    int file;
    pm_drops *drops;
    int count, capacity;
    channel_subscription *subscription; // [count], by channel if `sorted`
    bool sorted;                        // the filter is in place, too
    bool spins;
    pm_spin spin;
    unsigned char *data; // [RECEIVED_AT_ONCE][DATAGRAM_SIZE]
    struct mmsghdr head[RECEIVED_AT_ONCE];
    struct iovec vector[RECEIVED_AT_ONCE];
    struct sockaddr_in sender[RECEIVED_AT_ONCE];
} receiver;

// --- opening ---

static pm_status join(const receiver *r, const char *url, const lcm_url *address) {
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
        return pm_fail(PM_ENET,
                       "transport \"%s\": cannot join the multicast group: %s; " MULTICAST_REMEDY,
                       url, strerror(errno));
    }
    return PM_OK;
}

static void receiver_close(receiver *r) {
    if (r == NULL) {
        return;
    }
    if (r->file >= 0) {
        close(r->file);
    }
    for (int i = 0; i < r->count; ++i) {
        pm_reassembly_free(&r->subscription[i].large);
    }
    free(r->subscription);
    free(r->data);
    free(r);
}

static pm_status receiver_open(receiver **made, const char *url, const lcm_url *address,
                               pm_drops *drops) {
    receiver *r = NULL;
    PM_TRY(PM_NEW(r, url));
    pm_status status = PM_OK;
    r->drops = drops;
    r->spins = address->spins;
    r->data = malloc((size_t)RECEIVED_AT_ONCE * DATAGRAM_SIZE);
    r->file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (r->data == NULL) {
        status = pm_fail(PM_ENOMEM, "transport \"%s\": out of memory", url);
    } else if (r->file < 0) {
        status = pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    } else {
        status = join(r, url, address);
    }
    if (status != PM_OK) {
        receiver_close(r);
        return status;
    }
    for (int i = 0; i < RECEIVED_AT_ONCE; ++i) {
        r->vector[i] = (struct iovec){r->data + (size_t)i * DATAGRAM_SIZE, DATAGRAM_SIZE};
        r->head[i].msg_hdr =
            (struct msghdr){.msg_name = &r->sender[i], .msg_iov = &r->vector[i], .msg_iovlen = 1};
    }
    *made = r;
    return PM_OK;
}

// --- subscriptions ---

static pm_status receiver_subscribe(receiver *r, const char *channel, pm_message_handler *handler,
                                    void *context) {
    if (r->count == r->capacity) {
        const int capacity = 2 * r->capacity + 8;
        channel_subscription *larger =
            realloc(r->subscription, (size_t)capacity * sizeof *r->subscription);
        PM_TRY(pm_allocated(larger, "channel %s", channel));
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
static pm_status sort_subscriptions(receiver *r) {
    qsort(r->subscription, (size_t)r->count, sizeof *r->subscription, compare_channels);
    const char **name = calloc((size_t)r->count + 1, sizeof *name);
    PM_TRY(pm_allocated(name, "the names of channels"));
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
static channel_subscription *find_subscription(const receiver *r, const char *channel) {
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
static void dispatch(const receiver *r, const channel_subscription *first, const void *data,
                     size_t size) {
    const channel_subscription *end = r->subscription + r->count;
    for (const channel_subscription *s = first; s < end && strcmp(s->channel, first->channel) == 0;
         ++s) {
        s->handler(s->context, s->channel, data, size);
    }
}

// Handles a fragment. A first fragment names its channel and begins a message; later ones are added
// to it.
static pm_status take_fragment(receiver *r, channel_subscription *s, const pm_datagram *d,
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

static pm_status take_datagram(receiver *r, int i) {
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
static pm_status take_batch(receiver *r, int *count) {
    for (int i = 0; i < RECEIVED_AT_ONCE; ++i) {
        r->head[i].msg_hdr.msg_namelen = sizeof r->sender[i];
    }
    *count = recvmmsg(r->file, r->head, RECEIVED_AT_ONCE, MSG_DONTWAIT, NULL);
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

// Receives the first batch of datagrams, if one comes within `seconds`.
static pm_status await_batch(receiver *r, double seconds, int *count) {
    const double start = pm_clock();
    *count = 0;
    if (r->spins) {
        // Polls without sleeping, for the time that pm_spin_time allows.
        const double most = pm_spin_time(&r->spin, start);
        const double end = start + (seconds < most ? seconds : most);
        for (double now = start, before = start; now < end && *count == 0; before = now) {
            PM_TRY(take_batch(r, count));
            if (*count == 0) {
                sched_yield();
                now = pm_clock();
                pm_spin_note_yield(&r->spin, now - before, now);
            }
        }
    }
    if (*count == 0) {
        const double left = start + seconds - pm_clock();
        const double asleep = left > 0 ? left : 0, whole = floor(asleep);
        const struct timespec timeout = {(time_t)whole, (long)(1e9 * (asleep - whole))};
        struct pollfd file = {r->file, POLLIN, 0};
        if (ppoll(&file, 1, &timeout, NULL) < 0 && errno != EINTR) {
            return pm_fail(PM_ENET, "waiting for messages: %s", strerror(errno));
        }
        PM_TRY(take_batch(r, count));
    }
    pm_spin_note_wait(&r->spin, pm_clock() - start);
    return PM_OK;
}

static pm_status receiver_wait(receiver *r, double seconds, int *handled) {
    if (!r->sorted) {
        PM_TRY(sort_subscriptions(r));
    }
    int count;
    PM_TRY(seconds > 0 ? await_batch(r, seconds, &count) : take_batch(r, &count));
    *handled = count;
    while (count == RECEIVED_AT_ONCE && *handled < BURST) {
        PM_TRY(take_batch(r, &count));
        *handled += count;
    }
    return PM_OK;
}

// --- the transport ---

typedef struct liblcm_subscription {
    struct liblcm_subscription *next;
    pm_message_handler *handler;
    void *context;
} liblcm_subscription;

// Receiving begins with the first subscription, so that no messages pile up at an endpoint that
// only publishes.
typedef struct lcm_endpoint {
    lcm_t *lcm;
    splitter *splitter; // of messages that are too large for a packet; NULL: liblcm sends them
    char *url;
    pm_drops *drops;
    receiver *receiver; // NULL: liblcm receives, for `subscriptions`, or nobody
    int file;           // -1: nobody receives
    liblcm_subscription *subscriptions;
} lcm_endpoint;

static void lcm_endpoint_close(void *state) {
    lcm_endpoint *e = state;
    receiver_close(e->receiver);
    if (e->lcm != NULL) {
        lcm_destroy(e->lcm);
    }
    while (e->subscriptions != NULL) {
        liblcm_subscription *next = e->subscriptions->next;
        free(e->subscriptions);
        e->subscriptions = next;
    }
    splitter_close(e->splitter);
    free(e->url);
    free(e);
}

// Makes the URL for liblcm: the address and the options that it knows. NULL: out of memory.
static char *provider_of(const char *url, const lcm_url *parsed) {
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

static pm_status lcm_endpoint_open(void **state, const char *url, pm_drops *drops) {
    lcm_url parsed;
    PM_TRY(parse_url(url, &parsed));
    PM_TRY(check_multicast(url, parsed.group.sin_addr));
    pm_status status = PM_OK;
    lcm_endpoint *e = calloc(1, sizeof *e);
    char *provider = provider_of(url, &parsed);
    if (e == NULL || provider == NULL || (e->url = strdup(url)) == NULL) {
        PM_TRY_DONE(pm_fail(PM_ENOMEM, "transport \"%s\": out of memory", url));
    }
    e->drops = drops;
    e->file = -1;
    e->lcm = lcm_create(provider);
    if (e->lcm == NULL) {
        PM_TRY_DONE(pm_fail(PM_ENET, "transport \"%s\": LCM cannot open it", url));
    }
    if (strncmp(url, "udpm:", 5) == 0) {
        PM_TRY_DONE(splitter_open(&e->splitter, url, &parsed));
    }
    *state = e;
done:
    free(provider);
    if (status != PM_OK && e != NULL) {
        lcm_endpoint_close(e);
    }
    return status;
}

static void receive(const lcm_recv_buf_t *buffer, const char *channel, void *context) {
    const liblcm_subscription *s = context;
    s->handler(s->context, channel, buffer->data, buffer->data_size);
}

static pm_status lcm_endpoint_subscribe(void *state, const char *channel,
                                        pm_message_handler *handler, void *context) {
    lcm_endpoint *e = state;
    if (e->file < 0) { // receiving begins
        lcm_url parsed;
        PM_TRY(parse_url(e->url, &parsed));
        if (parsed.receives_itself) {
            PM_TRY(receiver_open(&e->receiver, e->url, &parsed, e->drops));
            e->file = e->receiver->file;
        } else {
            e->file = lcm_get_fileno(e->lcm);
        }
    }
    if (e->receiver != NULL) {
        return receiver_subscribe(e->receiver, channel, handler, context);
    }
    liblcm_subscription *s = calloc(1, sizeof *s);
    PM_TRY(pm_allocated(s, "channel %s", channel));
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
    const size_t whole = strlen(channel) + 1 + size;
    const bool split = e->splitter != NULL &&
                       PM_DATAGRAM_SHORT_HEAD + whole > e->splitter->largest &&
                       count_fragments(e->splitter, whole) <= UINT16_MAX;
    if ((split ? splitter_publish(e->splitter, channel, data, size)
               : lcm_publish(e->lcm, channel, data, (unsigned int)size)) == 0) {
        return PM_OK;
    }
    switch (errno) {
    case EAGAIN:
    case EINTR:
    case ENOBUFS:
    case EPERM: // a packet filter
    case ENETDOWN:
    case ENETUNREACH: // an interface that is down may come up again
    case EHOSTUNREACH:
    case EADDRNOTAVAIL:
        return PM_OK; // the message is lost, as any message may be
    default:
        return pm_fail(PM_ENET, "channel %s: cannot publish %zu bytes: %s", channel, size,
                       strerror(errno));
    }
}

static pm_status lcm_endpoint_wait(void *state, double seconds, int *handled) {
    const lcm_endpoint *e = state;
    if (e->receiver != NULL) {
        return receiver_wait(e->receiver, seconds, handled);
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
    lcm_url parsed;
    return parse_url(url, &parsed);
}

static int lcm_endpoint_file(const void *state) {
    return ((const lcm_endpoint *)state)->file;
}

const pm_transport_table pm_transport_lcm = {
    lcm_endpoint_check,   lcm_endpoint_open, lcm_endpoint_close, lcm_endpoint_subscribe,
    lcm_endpoint_publish, lcm_endpoint_wait, lcm_endpoint_file,  NULL,
};
