// Passes any datagrams in any order, from two senders, through the steps of the receiver: parsing,
// reassembly, dispatch by channel, check of the seal, decoding. In the input each datagram is
// preceded by its length (two bytes) and its sender (one byte).

// The way from a datagram to its handler is private to the receiver.
#include "tests/fuzz/target.h"
#include "transport/transport_lcm.c"

#include "lockstep/codec.h"
#include "transport/seal.h"

static const char *const channels[] = {"s_TICK", "s_FLUX_a", "s_FLUX_a", "s_REPORT_ab", "s"};
#define CHANNELS (int)(sizeof channels / sizeof channels[0])

static void listen_to(void *context, const char *channel, const void *data, size_t size) {
    pm_seal *seal = context;
    portmet_tick_t tick = {0};
    portmet_request_t request = {0};
    // Every byte is there, in a copy that ends where the message does.
    unsigned char *copy = malloc(size + (size == 0));
    check(copy != NULL);
    memcpy(copy, data, size);
    (void)pm_tick_decode(&tick, copy, size);
    (void)pm_request_decode(&request, copy, size);
    size_t payload = size;
    check(pm_seal_check(seal, channel, copy, &payload, NULL) != PM_KEEP && payload == size);
    free(copy);
}

static void receiver_fill(receiver *r, pm_drops *drops, pm_seal *seal) {
    *r = (receiver){.file = -1, .drops = drops};
    for (int i = 0; i < CHANNELS; ++i) {
        check(receiver_subscribe(r, channels[i], listen_to, seal) == PM_OK);
    }
    qsort(r->subscription, (size_t)r->count, sizeof *r->subscription, compare_channels);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static receiver r;
    static pm_seal *seal;
    if (seal == NULL) {
        const pm_key key = {{1}};
        check(pm_seal_open(&seal, &key, "fuzz", 0) == PM_OK);
    }
    pm_drops drops = {{0}};
    receiver_fill(&r, &drops, seal);
    while (size >= 3) {
        size_t length = (size_t)data[0] << 8 | data[1];
        const unsigned sender = data[2] % 2;
        const int may_be_large = data[2] == 0xff;
        data += 3;
        size -= 3;
        length = length < size ? length : size;
        unsigned char *bytes = malloc(length + (length == 0));
        check(bytes != NULL);
        memcpy(bytes, data, length);
        if (length > PM_DATAGRAM_FRAGMENT_HEAD && bytes[3] == '3' && !may_be_large) {
            // Most messages in fragments are made short: large ones take the sanitizer's time.
            memset(bytes + 8, 0, 2);
        }
        r.vector[0].iov_base = bytes;
        r.head[0].msg_len = (unsigned)length;
        r.sender[0].sin_port = (in_port_t)sender;
        check(take_datagram(&r, 0) == PM_OK);
        free(bytes);
        data += length;
        size -= length;
    }
    for (int i = 0; i < r.count; ++i) {
        pm_reassembly_free(&r.subscription[i].large);
    }
    free(r.subscription);
    return 0;
}
