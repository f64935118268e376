// replayer record FILE WORD: appends every datagram on a channel of the scene that ends in WORD to
// FILE, until it is killed. replayer replay FILE SECONDS: sends the datagrams in FILE again and
// again, and prints how many it has sent. Whoever listens to a network can do this without the key.
// For tests in a private network.
#include <arpa/inet.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"
#include "transport/datagram.h"

#define LARGEST 2048
#define MOST 4096       // datagrams that are sent again
#define INTERVAL 500000 // ns between two datagrams

typedef struct datagram {
    uint32_t size;
    unsigned char bytes[LARGEST];
} datagram;

static struct sockaddr_in group;

static void require(bool holds, const char *what) {
    if (!holds) {
        perror(what);
        exit(1);
    }
}

static void record(int file, const char *path, const char *word) {
    const struct ip_mreq membership = {group.sin_addr, {INADDR_ANY}};
    const int on = 1;
    FILE *kept = fopen(path, "wb");
    require(kept != NULL, path);
    setsockopt(file, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    require(bind(file, (const struct sockaddr *)&group, sizeof group) == 0, "bind");
    require(setsockopt(file, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) == 0,
            "join");
    puts("listening");
    fflush(stdout);
    for (;;) {
        static datagram d;
        const ssize_t size = recv(file, d.bytes, sizeof d.bytes, 0);
        require(size >= 0, "recv");
        d.size = (uint32_t)size;
        const char *channel = (const char *)d.bytes + PM_DATAGRAM_SHORT_HEAD;
        const size_t most = d.size > PM_DATAGRAM_SHORT_HEAD ? d.size - PM_DATAGRAM_SHORT_HEAD : 0;
        const size_t length = strnlen(channel, most), end = strlen(word);
        if (length < most && length > end && strcmp(channel + length - end, word) == 0) {
            require(fwrite(&d, sizeof d, 1, kept) == 1 && fflush(kept) == 0, path);
        }
    }
}

static void replay(int file, const char *path, double seconds) {
    static datagram kept[MOST];
    const unsigned char none = 0;
    FILE *from = fopen(path, "rb");
    require(from != NULL, path);
    const size_t count = fread(kept, sizeof kept[0], MOST, from);
    fclose(from);
    require(count > 0, "nothing was recorded");
    setsockopt(file, IPPROTO_IP, IP_MULTICAST_TTL, &none, sizeof none);
    long sent = 0;
    for (const double end = pm_clock() + seconds; pm_clock() < end; ++sent) {
        const datagram *d = &kept[(size_t)sent % count];
        (void)sendto(file, d->bytes, d->size, 0, (const struct sockaddr *)&group, sizeof group);
        nanosleep(&(struct timespec){.tv_nsec = INTERVAL}, NULL);
    }
    printf("%zu datagrams, sent %ld times\n", count, sent);
}

int main(int argc, char **argv) {
    group = (struct sockaddr_in){AF_INET, htons(7667), {inet_addr("239.255.76.67")}, {0}};
    require(argc == 4, "usage: replayer record FILE WORD | replay FILE SECONDS");
    const int file = socket(AF_INET, SOCK_DGRAM, 0);
    require(file >= 0, "socket");
    if (strcmp(argv[1], "record") == 0) {
        record(file, argv[2], argv[3]);
    } else {
        replay(file, argv[2], atof(argv[3]));
    }
    return 0;
}
