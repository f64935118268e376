// stranger MODE SECONDS: an attacker, for tests in a private network. In either mode it sends
// datagrams of 92 bytes whose array counts crash LCM's own decoders, and garbage on the scene's
// channels. With MODE "echo" it also sends every message that it receives again: cut, with a bit
// turned, on another channel, and unchanged, at once and much later. No scene without a key
// survives that. After each round it prints the number of rounds and of messages sent again.
#include <arpa/inet.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/progress.h"
#include "base/rng.h"
#include "lockstep/codec.h"
#include "transport/datagram.h"

#define LARGEST 2048
#define KEPT 512     // datagrams, to be sent again later
#define SILENCE 5    // ms between two rounds of its own
#define ECHOES 20000 // at most: it must not drown the network
#define FLUX_SIZE 92 // bytes of a datagram
#define CHANNELS                                                                  \
    "pair_TICK\0pair_COMMAND\0pair_REQUEST\0pair_REQUEST_left\0pair_FLUX_right\0" \
    "pair_REPORT_left\0"

typedef struct datagram {
    size_t size;
    unsigned char bytes[LARGEST];
} datagram;

static struct sockaddr_in group;
static datagram kept[KEPT];

static void require(bool holds, const char *what) {
    if (!holds) {
        perror(what);
        exit(1);
    }
}

static int open_socket(void) {
    const int file = socket(AF_INET, SOCK_DGRAM, 0), on = 1;
    const unsigned char none = 0;
    require(file >= 0, "socket");
    setsockopt(file, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    setsockopt(file, IPPROTO_IP, IP_MULTICAST_TTL, &none, sizeof none);
    return file;
}

static void send_bytes(int file, const void *bytes, size_t size) {
    (void)sendto(file, bytes, size, 0, (const struct sockaddr *)&group, sizeof group);
}

// A flux message to the coordinator's and the neighbour's taste, but for its number of ends.
static void send_crashing_flux(int file, uint32_t count) {
    const char channel[] = "pair_FLUX_left";
    const portmet_flux_t flux = {.session = 1};
    unsigned char bytes[LARGEST] = "LC02";
    size_t size = PM_DATAGRAM_SHORT_HEAD;
    memcpy(bytes + size, channel, sizeof channel);
    size += sizeof channel;
    (void)pm_flux_encode(&flux, bytes + size, sizeof bytes - size);
    const uint32_t word = htonl(count);
    memcpy(bytes + size + 36, &word, sizeof word); // behind fingerprint, session, step, round, time
    send_bytes(file, bytes, FLUX_SIZE);
}

static void send_garbage(int file, pm_rng *rng) {
    for (const char *channel = CHANNELS; *channel != 0; channel += strlen(channel) + 1) {
        unsigned char bytes[256] = "LC02";
        size_t size = PM_DATAGRAM_SHORT_HEAD;
        memcpy(bytes + size, channel, strlen(channel) + 1);
        size += strlen(channel) + 1;
        for (const size_t end = size + pm_rng_below(rng, 128); size < end; ++size) {
            bytes[size] = (unsigned char)pm_rng_below(rng, 256);
        }
        bytes[3] = pm_rng_below(rng, 4) == 0 ? '3' : '2'; // now and then a fragment
        send_bytes(file, bytes, size);
    }
}

static void send_again(int file, const datagram *heard, pm_rng *rng) {
    datagram d = *heard;
    const size_t head = PM_DATAGRAM_SHORT_HEAD;
    const size_t body = head + strnlen((const char *)d.bytes + head, d.size - head) + 1;
    send_bytes(file, d.bytes, d.size);
    if (body < d.size) {
        send_bytes(file, d.bytes, body + pm_rng_below(rng, d.size - body));
        d.bytes[body + pm_rng_below(rng, d.size - body)] ^=
            (unsigned char)(1u << pm_rng_below(rng, 8));
        send_bytes(file, d.bytes, d.size);
    }
    const datagram *old = &kept[pm_rng_below(rng, KEPT)];
    if (old->size > 0) {
        send_bytes(file, old->bytes, old->size);
    }
}

// What others have sent, until nothing more comes for a while.
static void echo(int ear, int mouth, in_port_t own_port, long *echoes, pm_rng *rng) {
    static datagram heard;
    struct sockaddr_in from;
    struct pollfd file = {ear, POLLIN, 0};
    while (poll(&file, 1, SILENCE) == 1) {
        socklen_t length = sizeof from;
        const ssize_t size =
            recvfrom(ear, heard.bytes, sizeof heard.bytes, 0, (struct sockaddr *)&from, &length);
        if (size <= PM_DATAGRAM_SHORT_HEAD || from.sin_port == own_port || *echoes >= ECHOES) {
            continue;
        }
        heard.size = (size_t)size;
        *echoes += 1;
        send_again(mouth, &heard, rng);
        kept[pm_rng_below(rng, KEPT)] = heard;
        if (*echoes % 64 == 0) {
            return;
        }
    }
}

int main(int argc, char **argv) {
    static const uint32_t counts[] = {0x10000000, 0x20000001, 0x7fffffff, 0xffffffff};
    require(argc == 3, "usage: stranger plain|echo SECONDS");
    const bool echoes_too = strcmp(argv[1], "echo") == 0;
    const double end = pm_clock() + atof(argv[2]);
    group = (struct sockaddr_in){AF_INET, htons(7667), {inet_addr("239.255.76.67")}, {0}};
    const struct ip_mreq membership = {group.sin_addr, {INADDR_ANY}};
    const int ear = open_socket(), mouth = open_socket();
    require(bind(ear, (const struct sockaddr *)&group, sizeof group) == 0, "bind");
    require(setsockopt(ear, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) == 0,
            "join");
    struct sockaddr_in own = {.sin_family = AF_INET};
    socklen_t length = sizeof own;
    require(bind(mouth, (const struct sockaddr *)&own, sizeof own) == 0, "bind");
    getsockname(mouth, (struct sockaddr *)&own, &length);
    pm_rng rng;
    pm_rng_init(&rng, 5, 0);
    long echoes = 0;
    for (long i = 0; pm_clock() < end; ++i) {
        send_crashing_flux(mouth, counts[i % 4]);
        send_garbage(mouth, &rng);
        if (echoes_too) {
            echo(ear, mouth, own.sin_port, &echoes, &rng);
        } else {
            usleep(1000 * SILENCE);
        }
        printf("%ld %ld\n", i + 1, echoes);
        fflush(stdout);
    }
    return 0;
}
