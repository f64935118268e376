// Writes fragments in LCM's format and sends them in batches.
#include "transport/splitter.h"

#include <endian.h>
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include "transport/datagram.h"

#define BATCH 32         // datagrams given to the kernel at once
#define PACKET_HEAD 28   // bytes of the headers of IP and UDP
#define LEAST_PACKET 576 // bytes, of the smallest packets that a network may have

struct pm_splitter {
    int file;
    size_t largest; // bytes of a datagram that fits into a packet
    uint32_t sequence;
    unsigned char head[BATCH][PM_DATAGRAM_FRAGMENT_HEAD];
    struct iovec part[BATCH][3]; // header, channel or nothing, data
    struct mmsghdr datagram[BATCH];
};

pm_status pm_splitter_open(pm_splitter **splitter, const char *url, const pm_lcm_url *address) {
    pm_splitter *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return pm_fail(PM_ENOMEM, "transport \"%s\": out of memory", url);
    }
    const unsigned char ttl = (unsigned char)address->ttl;
    int packet = 0;
    socklen_t size = sizeof packet;
    s->file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (s->file < 0 || setsockopt(s->file, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl) != 0 ||
        connect(s->file, (const struct sockaddr *)&address->group, sizeof address->group) != 0 ||
        getsockopt(s->file, IPPROTO_IP, IP_MTU, &packet, &size) != 0) {
        const pm_status status =
            pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
        pm_splitter_close(s);
        return status;
    }
    s->largest = (size_t)(packet < LEAST_PACKET ? LEAST_PACKET : packet) - PACKET_HEAD;
    for (int i = 0; i < BATCH; ++i) {
        s->datagram[i].msg_hdr = (struct msghdr){.msg_iov = s->part[i], .msg_iovlen = 3};
    }
    *splitter = s;
    return PM_OK;
}

void pm_splitter_close(pm_splitter *splitter) {
    if (splitter != NULL) {
        if (splitter->file >= 0) {
            close(splitter->file);
        }
        free(splitter);
    }
}

// The number of fragments of a message of `size` bytes with its channel.
static size_t count_fragments(const pm_splitter *s, size_t size) {
    const size_t room = s->largest - PM_DATAGRAM_FRAGMENT_HEAD;
    return (size + room - 1) / room;
}

bool pm_splitter_is_needed(const pm_splitter *splitter, const char *channel, size_t size) {
    const size_t whole = strlen(channel) + 1 + size;
    return PM_DATAGRAM_SHORT_HEAD + whole > splitter->largest &&
           count_fragments(splitter, whole) <= UINT16_MAX;
}

static void write_head(unsigned char *head, uint32_t sequence, size_t size, size_t offset,
                       size_t number, size_t count) {
    const uint32_t word[4] = {htobe32(PM_DATAGRAM_FRAGMENT), htobe32(sequence),
                              htobe32((uint32_t)size), htobe32((uint32_t)offset)};
    const uint16_t half[2] = {htobe16((uint16_t)number), htobe16((uint16_t)count)};
    memcpy(head, word, sizeof word);
    memcpy(head + sizeof word, half, sizeof half);
}

// Sends the first `count` datagrams of the batch.
static int send_batch(pm_splitter *s, unsigned count) {
    for (unsigned sent = 0; sent < count;) {
        const int more = sendmmsg(s->file, s->datagram + sent, count - sent, MSG_NOSIGNAL);
        if (more < 0) {
            return -1;
        }
        sent += (unsigned)more;
    }
    return 0;
}

int pm_splitter_publish(pm_splitter *splitter, const char *channel, const void *data, size_t size) {
    pm_splitter *s = splitter;
    const size_t name = strlen(channel) + 1, count = count_fragments(s, name + size);
    size_t offset = 0;
    unsigned filled = 0;
    s->sequence += 1;
    for (size_t i = 0; i < count; ++i) {
        const size_t first = i == 0 ? name : 0;
        const size_t room = s->largest - PM_DATAGRAM_FRAGMENT_HEAD - first;
        const size_t part = size - offset < room ? size - offset : room;
        write_head(s->head[filled], s->sequence, size, offset, i, count);
        s->part[filled][0] = (struct iovec){s->head[filled], PM_DATAGRAM_FRAGMENT_HEAD};
        s->part[filled][1] = (struct iovec){(char *)channel, first};
        s->part[filled][2] = (struct iovec){(char *)data + offset, part};
        offset += part;
        filled += 1;
        if (filled == BATCH || i + 1 == count) {
            if (send_batch(s, filled) != 0) {
                return -1;
            }
            filled = 0;
        }
    }
    return 0;
}
