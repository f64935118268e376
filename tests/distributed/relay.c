// relay PROCESS SECONDS SEED: simulates an unreliable network, for tests in private networks.
// Carries the datagrams of LCM's default group between this network and the network of another
// process. It repeats some of them later, and delays some so that others overtake. It prints
// "carries" when it is ready. At its end, at the latest after SECONDS, it prints how many it
// repeated and delayed.
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/progress.h"
#include "base/rng.h"

#define LARGEST 2048  // bytes
#define QUEUE 4096    // datagrams on their way
#define REPEATED 0.3  // of all: once more
#define DELAYED 0.3   // of all: so that later ones overtake
#define LONGEST 0.004 // s, of a delay

typedef struct datagram {
    double due; // s; 0: an empty place
    int to;     // side
    size_t size;
    unsigned char bytes[LARGEST];
} datagram;

static struct sockaddr_in group;
static datagram queue[QUEUE];
static volatile sig_atomic_t stopped;

static void stop(int number) {
    (void)number;
    stopped = 1;
}

static void require(bool holds, const char *what) {
    if (!holds) {
        perror(what);
        exit(1);
    }
}

// One end of the cable: a socket that hears the group, and one that speaks, by whose port the first
// knows its own words.
typedef struct side {
    int hears, speaks;
    in_port_t port;
} side;

static side open_side(void) {
    side s = {socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK, 0), socket(AF_INET, SOCK_DGRAM, 0), 0};
    const int on = 1, buffer = 4000000;
    const unsigned char none = 0;
    const struct ip_mreq membership = {group.sin_addr, {INADDR_ANY}};
    struct sockaddr_in own = {.sin_family = AF_INET};
    socklen_t size = sizeof own;
    require(s.hears >= 0 && s.speaks >= 0, "socket");
    setsockopt(s.hears, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    setsockopt(s.hears, SOL_SOCKET, SO_RCVBUF, &buffer, sizeof buffer);
    setsockopt(s.speaks, IPPROTO_IP, IP_MULTICAST_TTL, &none, sizeof none);
    require(bind(s.hears, (const struct sockaddr *)&group, sizeof group) == 0, "bind");
    require(setsockopt(s.hears, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) == 0,
            "join");
    require(bind(s.speaks, (const struct sockaddr *)&own, sizeof own) == 0, "bind");
    require(getsockname(s.speaks, (struct sockaddr *)&own, &size) == 0, "getsockname");
    s.port = own.sin_port;
    return s;
}

static void enter_network_of(const char *process) {
    char path[64];
    snprintf(path, sizeof path, "/proc/%s/ns/net", process);
    const int network = open(path, O_RDONLY | O_CLOEXEC);
    require(network >= 0 && setns(network, CLONE_NEWNET) == 0, path);
    close(network);
}

static void send_now(const side *s, const void *bytes, size_t size) {
    (void)sendto(s->speaks, bytes, size, 0, (const struct sockaddr *)&group, sizeof group);
}

// False: no room, which only loses the datagram.
static bool send_later(int to, const void *bytes, size_t size, double due) {
    for (int i = 0; i < QUEUE; ++i) {
        if (queue[i].due == 0) {
            queue[i].due = due;
            queue[i].to = to;
            queue[i].size = size;
            memcpy(queue[i].bytes, bytes, size);
            return true;
        }
    }
    return false;
}

// Sends what is due; when the next one is.
static double send_due(const side *sides, double now) {
    double next = INFINITY;
    for (int i = 0; i < QUEUE; ++i) {
        datagram *d = &queue[i];
        if (d->due != 0 && d->due <= now) {
            send_now(&sides[d->to], d->bytes, d->size);
            d->due = 0;
        }
        next = d->due != 0 && d->due < next ? d->due : next;
    }
    return next;
}

typedef struct counts {
    long carried, repeated, delayed;
} counts;

static void carry(const side *sides, int from, pm_rng *rng, counts *n) {
    unsigned char bytes[LARGEST];
    struct sockaddr_in sender;
    socklen_t size = sizeof sender;
    ssize_t count;
    while ((count = recvfrom(sides[from].hears, bytes, sizeof bytes, 0, (struct sockaddr *)&sender,
                             &size)) >= 0) {
        const double now = pm_clock();
        if (sender.sin_port == sides[from].port) {
            continue;
        }
        const bool delayed = pm_rng_uniform(rng) < DELAYED;
        const double due = now + LONGEST * pm_rng_uniform(rng);
        n->carried += 1;
        if (delayed) {
            n->delayed += send_later(1 - from, bytes, (size_t)count, due);
        } else {
            send_now(&sides[1 - from], bytes, (size_t)count);
        }
        if (pm_rng_uniform(rng) < REPEATED) {
            const double again = now + LONGEST * pm_rng_uniform(rng);
            n->repeated += send_later(1 - from, bytes, (size_t)count, again);
        }
    }
}

int main(int argc, char **argv) {
    if (argc != 4) {
        fprintf(stderr, "relay PROCESS SECONDS SEED\n");
        return 2;
    }
    group = (struct sockaddr_in){.sin_family = AF_INET, .sin_port = htons(7667)};
    inet_pton(AF_INET, "239.255.76.67", &group.sin_addr);
    signal(SIGTERM, stop);
    side sides[2];
    sides[0] = open_side();
    enter_network_of(argv[1]);
    sides[1] = open_side();
    pm_rng rng;
    pm_rng_init(&rng, strtoull(argv[3], NULL, 10), 0);
    counts n = {0};
    printf("carries\n");
    fflush(stdout);
    const double end = pm_clock() + strtod(argv[2], NULL);
    for (double now = pm_clock(); now < end && !stopped; now = pm_clock()) {
        const double next = send_due(sides, now);
        const double wait = next < end ? next - now : 0.1;
        struct pollfd files[2] = {{sides[0].hears, POLLIN, 0}, {sides[1].hears, POLLIN, 0}};
        poll(files, 2, (int)ceil(1e3 * (wait < 0.1 ? wait : 0.1)));
        carry(sides, 0, &rng, &n);
        carry(sides, 1, &rng, &n);
    }
    printf("carried %ld, repeated %ld, delayed %ld\n", n.carried, n.repeated, n.delayed);
    return 0;
}
