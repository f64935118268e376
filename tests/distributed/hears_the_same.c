// Compares liblcm's receiver with this program's. Both must receive the same messages that a
// transport publishes, short and fragmented, and neither messages of other channels nor foreign
// bytes. Runs in a private network.
#include <arpa/inet.h>
#include <poll.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/rng.h"
#include "transport/transport.h"

#define URL "udpm://239.255.76.67:7667?ttl=0"
#define LARGEST 1000000 // bytes of a message
#define PATIENCE 2.0    // s for a message on its way
#define ATTEMPTS 10     // to say it

static unsigned char data[LARGEST];

typedef struct ear {
    pm_transport *transport;
    int count;
    size_t size; // of the last message
    int wrong;   // messages with other bytes or from another channel
} ear;

static void require(pm_status status) {
    if (status != PM_OK) {
        fprintf(stderr, "hears_the_same: %s\n", pm_error());
        exit(1);
    }
}

static void expect(int holds, const char *what, int found) {
    if (!holds) {
        fprintf(stderr, "hears_the_same: %s: found %d\n", what, found);
        exit(1);
    }
}

static void listen_to(void *context, const char *channel, const void *bytes, size_t size) {
    ear *e = context;
    e->count += 1;
    e->size = size;
    e->wrong +=
        strcmp(channel, "pair_WANTED") != 0 || size > LARGEST || memcmp(bytes, data, size) != 0;
}

static void open_ear(ear *e, const char *url) {
    require(pm_transport_open(&e->transport, url));
    require(pm_transport_subscribe(e->transport, "pair_WANTED", listen_to, e));
    require(pm_transport_wait(e->transport, 0, NULL));
}

// One more message.
static bool hears(ear *e) {
    const int count = e->count;
    for (int handled = 1; e->count == count && handled > 0;) {
        require(pm_transport_wait(e->transport, PATIENCE, &handled));
    }
    return e->count > count;
}

// Publishes it until both have heard it at once; returns how often. The network may lose it where
// nobody reads for a while.
static int say(pm_transport *mouth, ear *e, size_t size) {
    bool heard = false;
    int times = 0;
    for (; times < ATTEMPTS && !heard; ++times) {
        require(pm_transport_publish(mouth, "pair_WANTED", data, size));
        const bool first = hears(&e[0]), second = hears(&e[1]);
        heard = first && second;
    }
    for (int k = 0; k < 2; ++k) {
        expect(heard && e[k].size == size, "size heard", (int)e[k].size);
        expect(e[k].wrong == 0, "wrong messages", e[k].wrong);
    }
    return times;
}

// Bytes of all kinds to the group, some with a beginning as LCM's.
static void send_garbage(void) {
    const struct sockaddr_in group = {
        .sin_family = AF_INET, .sin_port = htons(7667), .sin_addr = {inet_addr("239.255.76.67")}};
    const unsigned char none = 0;
    const int file = socket(AF_INET, SOCK_DGRAM, 0);
    setsockopt(file, IPPROTO_IP, IP_MULTICAST_TTL, &none, sizeof none);
    pm_rng rng;
    pm_rng_init(&rng, 3, 0);
    for (int i = 0; i < 2000; ++i) {
        unsigned char bytes[256];
        const size_t size = pm_rng_below(&rng, sizeof bytes);
        for (size_t k = 0; k < size; ++k) {
            bytes[k] = (unsigned char)pm_rng_below(&rng, 256);
        }
        if (i % 2 == 0 && size > 4) {
            memcpy(bytes, i % 4 == 0 ? "LC02" : "LC03", 4);
        }
        if (i % 8 == 2 && size > 18) {
            bytes[16] = bytes[17] = 0; // a first fragment
        }
        sendto(file, bytes, size, 0, (const struct sockaddr *)&group, sizeof group);
    }
    close(file);
}

int main(void) {
    static const size_t sizes[] = {0, 1, 8, 92, 1400, 65400, 65499, 65600, 200000, LARGEST};
    const int count = (int)(sizeof sizes / sizeof sizes[0]);
    ear e[2] = {{0}, {0}};
    pm_transport *mouth = NULL;
    int said = 0;
    for (size_t i = 0; i < LARGEST; ++i) {
        data[i] = (unsigned char)(i * i >> 3);
    }
    open_ear(&e[0], URL "&receive=own");
    open_ear(&e[1], URL "&receive=lcm");
    require(pm_transport_open(&mouth, URL));
    for (int i = 0; i < count; ++i) {
        said += say(mouth, e, sizes[i]);
    }
    for (int i = 0; i < 100; ++i) {
        require(pm_transport_publish(mouth, "pair_UNWANTED", data, 100));
        require(pm_transport_publish(mouth, "pair_WANT", data, 100));
    }
    // The kernel itself drops them: nobody is woken.
    struct pollfd file = {pm_transport_file(e[0].transport), POLLIN, 0};
    expect(poll(&file, 1, 50) == 0, "woken by an unwanted message", 1);
    send_garbage();
    said += say(e[0].transport, e, 10); // to itself too
    for (int k = 0; k < 2; ++k) {
        // One for each size, and the last; more only where one was said again.
        expect(e[k].count > count && e[k].count <= said, "messages heard", e[k].count);
        pm_transport_close(e[k].transport);
    }
    pm_transport_close(mouth);
    return 0;
}
