// LCM datagrams: parsing, reassembly of fragments, and the kernel's filter (on a socket pair, where
// a filter works as on a UDP socket). tests/distributed/test_receive.sh compares with liblcm
// itself.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/rng.h"
#include "tests/support/unit.h"
#include "transport/datagram.h"
#include "transport/transport.h"

#define MOST 512

// --- writing datagrams ---

typedef struct bytes {
    unsigned char at[MOST];
    size_t size;
} bytes;

static void put(bytes *b, uint32_t number, int size) {
    for (int i = size - 1; i >= 0; --i) {
        b->at[b->size++] = (unsigned char)(number >> (8 * i));
    }
}

static void put_bytes(bytes *b, const void *data, size_t size) {
    assert_true(b->size + size <= MOST);
    memcpy(b->at + b->size, data, size);
    b->size += size;
}

static bytes short_message(const char *channel, const void *data, size_t size) {
    bytes b = {.size = 0};
    put(&b, PM_DATAGRAM_SHORT, 4);
    put(&b, 77, 4);
    put_bytes(&b, channel, strlen(channel) + 1);
    put_bytes(&b, data, size);
    return b;
}

// Part `number` of `count` of the message `data` [total], [from, to) of it.
static bytes fragment(const char *channel, const unsigned char *data, size_t total, size_t from,
                      size_t to, unsigned number, unsigned count) {
    bytes b = {.size = 0};
    put(&b, PM_DATAGRAM_FRAGMENT, 4);
    put(&b, 5, 4);
    put(&b, (uint32_t)total, 4);
    put(&b, (uint32_t)from, 4);
    put(&b, number, 2);
    put(&b, count, 2);
    if (number == 0) {
        put_bytes(&b, channel, strlen(channel) + 1);
    }
    put_bytes(&b, data + from, to - from);
    return b;
}

// Parses a copy that is exactly as long as the datagram.
static bool parses(const bytes *b, size_t size, pm_datagram *d, unsigned char **copy) {
    *copy = malloc(size + (size == 0));
    assert_non_null(*copy);
    memcpy(*copy, b->at, size);
    return pm_datagram_parse(d, *copy, size);
}

static bool is_good(const bytes *b) {
    pm_datagram d;
    unsigned char *copy;
    const bool good = parses(b, b->size, &d, &copy);
    free(copy);
    return good;
}

// --- parsing ---

static void test_short_messages(void **context) {
    (void)context;
    char name[PM_CHANNEL_SIZE + 1] = {0};
    memset(name, 'n', PM_CHANNEL_SIZE - 1);
    const char *const channel[] = {"pair_TICK", "", name};
    for (int i = 0; i < 3; ++i) {
        const bytes b = short_message(channel[i], "data", 4);
        pm_datagram d;
        unsigned char *copy;
        assert_true(parses(&b, b.size, &d, &copy));
        assert_string_equal(d.channel, channel[i]);
        assert_int_equal(d.size, 4);
        assert_int_equal(d.total, 4);
        assert_int_equal(d.count, 1);
        assert_memory_equal(d.data, "data", 4);
        free(copy);
    }
    memset(name, 'n', PM_CHANNEL_SIZE);
    bytes b = short_message(name, "", 0);
    assert_false(is_good(&b)); // no name is that long
    b = short_message("pair_TICK", "", 0);
    assert_true(is_good(&b)); // a message may be empty
    for (size_t size = 0; size < b.size; ++size) {
        const bytes cut = {.size = size};
        memcpy((void *)cut.at, b.at, size);
        assert_false(is_good(&cut));
    }
    b.at[3] = '1';
    assert_false(is_good(&b)); // another magic
}

static void test_fragments_that_contradict_themselves(void **context) {
    (void)context;
    const unsigned char data[100] = {1};
    bytes b = fragment("c", data, 100, 0, 60, 0, 2);
    assert_true(is_good(&b));
    b = fragment("c", data, 100, 60, 100, 1, 2);
    assert_true(is_good(&b));
    b = fragment("c", data, 100, 60, 100, 2, 2);
    assert_false(is_good(&b)); // number beyond count
    b = fragment("c", data, 100, 60, 100, 0, 0);
    assert_false(is_good(&b));
    b = fragment("c", data, 99, 60, 100, 1, 2);
    assert_false(is_good(&b)); // beyond the end
    b = fragment("c", data, 39, 60, 100, 1, 2);
    assert_false(is_good(&b));
    b = fragment("c", data, 0, 1, 1, 1, 2);
    assert_false(is_good(&b));
    b = fragment("c", data, PM_MESSAGE_MAX + 1, 60, 100, 1, 2);
    assert_false(is_good(&b)); // too large
    b = fragment("c", data, 100, 1, 60, 0, 2);
    assert_false(is_good(&b)); // the first part stands at the beginning
}

// --- reassembly ---

#define TOTAL 1000
#define PART 100

// Hands the parts over in the given order; true if that made the message.
static bool reassemble(pm_reassembly *r, int count, const int *order, uint64_t sender,
                       long *discarded) {
    unsigned char data[TOTAL];
    for (int i = 0; i < TOTAL; ++i) {
        data[i] = (unsigned char)(7 * i + (int)sender);
    }
    for (int i = 0; i < count; ++i) {
        const size_t from = (size_t)order[i] * PART;
        const bytes b =
            fragment("c", data, TOTAL, from, from + PART, (unsigned)order[i], TOTAL / PART);
        pm_datagram d;
        assert_true(pm_datagram_parse(&d, b.at, b.size));
        if (d.channel != NULL) {
            assert_int_equal(pm_reassembly_begin(r, &d, sender, discarded), PM_OK);
        } else {
            pm_reassembly_add(r, &d, sender);
        }
    }
    return pm_reassembly_complete(r) && memcmp(r->data, data, TOTAL) == 0;
}

static void test_reassembly(void **context) {
    (void)context;
    const int in_order[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9};
    const int mixed[] = {0, 9, 0, 9, 4, 8, 7, 6, 4, 5, 0, 3, 2, 1};
    const int incomplete[] = {0, 1, 2, 3, 4, 5, 5, 5, 5, 5, 5, 7, 8, 9};
    pm_reassembly r = {0};
    long lost = 0;
    assert_false(reassemble(&r, 9, in_order + 1, 1, &lost)); // nothing before the first part
    assert_true(reassemble(&r, 10, in_order, 1, &lost));
    r.count = 0;
    assert_true(reassemble(&r, 14, mixed, 2, &lost));
    r.count = 0;
    assert_false(reassemble(&r, 14, incomplete, 3, &lost));
    assert_false(reassemble(&r, 9, in_order + 1, 4, &lost)); // another sender's parts
    assert_int_equal(lost, 0);
    assert_true(reassemble(&r, 10, in_order, 4, &lost)); // a new message takes the place
    assert_int_equal(lost, 1);
    pm_reassembly_free(&r);
}

// Two parts of a message that leave out the most of it, or tell some of it twice.
static void test_parts_must_make_the_whole(void **context) {
    (void)context;
    static const size_t to[] = {490, 500, 510};
    const unsigned char data[TOTAL] = {1};
    pm_reassembly r = {0};
    long lost = 0;
    for (unsigned i = 0; i < 3; ++i) {
        const size_t half = TOTAL / 2;
        bytes b = fragment("c", data, half, 0, 250, 0, 2);
        pm_datagram d;
        assert_true(pm_datagram_parse(&d, b.at, b.size));
        assert_int_equal(pm_reassembly_begin(&r, &d, i, &lost), PM_OK);
        b = fragment("c", data, half, half - (to[i] - 250), half, 1, 2);
        assert_true(pm_datagram_parse(&d, b.at, b.size));
        assert_true(pm_reassembly_add(&r, &d, i));
        assert_int_equal(pm_reassembly_complete(&r), to[i] == half);
        assert_int_equal(lost, i == 0 ? 0 : 1); // the first message was not made whole
    }
    pm_reassembly_free(&r);
}

// --- the filter ---

typedef struct gate {
    int file[2];
    bool filtered;
} gate;

static int compare_names(const void *a, const void *b) {
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

static gate open_gate(int count, const char **name) {
    gate g;
    struct sock_fprog program;
    qsort(name, (size_t)count, sizeof *name, compare_names);
    assert_int_equal(pm_channel_filter_build(&program, count, name, 0), PM_OK);
    assert_int_equal(socketpair(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0, g.file), 0);
    g.filtered = program.filter != NULL;
    if (g.filtered) {
        assert_int_equal(
            setsockopt(g.file[1], SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program), 0);
    }
    free(program.filter);
    return g;
}

static void close_gate(gate g) {
    close(g.file[0]);
    close(g.file[1]);
}

static bool lets_through(gate g, const bytes *b) {
    unsigned char received[MOST];
    // The sender of a local socket is told that the filter dropped it.
    (void)send(g.file[0], b->at, b->size, 0);
    const ssize_t size = recv(g.file[1], received, sizeof received, MSG_DONTWAIT);
    if (size >= 0) {
        assert_int_equal(size, b->size);
        assert_memory_equal(received, b->at, b->size);
    }
    return size >= 0;
}

static bool channel_passes(gate g, const char *channel) {
    const bytes b = short_message(channel, "abcdefgh", 8);
    const bytes empty = short_message(channel, "", 0);
    const bool passes = lets_through(g, &b);
    assert_int_equal(lets_through(g, &empty), passes);
    return passes;
}

static void test_filter(void **context) {
    (void)context;
    const char *name[] = {"pair_TICK",
                          "pair_COMMAND",
                          "pair_REPORT_link1",
                          "pair_REPORT_link",
                          "pair_REPORT_link12",
                          "pair",
                          "pai",
                          "pair_"};
    const char *const others[] = {"pair_TICKS",
                                  "pair_TIC",
                                  "pair_REPORT_link2",
                                  "pair_REPORT_lin",
                                  "air_TICK",
                                  "pair_REPORT_link123",
                                  "pa",
                                  "",
                                  "PAIR_TICK",
                                  "pair_TACK",
                                  "qair_TICK",
                                  "pair_COMMANDS"};
    gate g = open_gate(8, name);
    assert_true(g.filtered);
    for (int i = 0; i < 8; ++i) {
        assert_true(channel_passes(g, name[i]));
    }
    for (size_t i = 0; i < sizeof others / sizeof others[0]; ++i) {
        assert_false(channel_passes(g, others[i]));
    }
    const unsigned char data[100] = {0};
    bytes b = fragment("pair_TICK", data, 100, 0, 50, 0, 2);
    assert_true(lets_through(g, &b));
    b = fragment("pair_TACK", data, 100, 0, 50, 0, 2);
    assert_false(lets_through(g, &b));
    b = fragment("pair_TACK", data, 100, 50, 100, 1, 2);
    assert_true(lets_through(g, &b)); // names no channel
    b = short_message("pair_TICK", "", 0);
    b.at[0] = 'M';
    assert_false(lets_through(g, &b));
    close_gate(g);
}

// Random names over a small alphabet, so that many agree in their beginnings.
static void test_filter_is_exact(void **context) {
    (void)context;
    pm_rng rng;
    pm_rng_init(&rng, 20, 0);
    for (int round = 0; round < 20; ++round) {
        char text[60][PM_CHANNEL_SIZE];
        const char *name[60];
        const int wanted = 1 + (int)pm_rng_below(&rng, 40);
        int count = 0;
        for (int i = 0; i < 60; ++i) {
            const size_t length = 3 + pm_rng_below(&rng, 12);
            for (size_t k = 0; k < length; ++k) {
                text[i][k] = (char)('a' + pm_rng_below(&rng, 2));
            }
            text[i][length] = 0;
        }
        for (int i = 0; i < wanted; ++i) {
            bool known = false;
            for (int k = 0; k < count; ++k) {
                known = known || strcmp(text[i], name[k]) == 0;
            }
            if (!known) {
                name[count++] = text[i];
            }
        }
        gate g = open_gate(count, name);
        for (int i = 0; i < 60; ++i) {
            const char *key = text[i];
            const bool expected =
                bsearch(&key, name, (size_t)count, sizeof *name, compare_names) != NULL;
            if (channel_passes(g, text[i]) != expected) {
                fail_msg("seed 20, round %d: channel %s: expected %d", round, text[i], expected);
            }
        }
        close_gate(g);
    }
}

static void test_no_filter(void **context) {
    (void)context;
    const char *short_names[] = {"ab", "pair_TICK"};
    gate g = open_gate(0, short_names); // nothing is wanted
    assert_true(g.filtered);
    assert_false(channel_passes(g, "pair_TICK"));
    close_gate(g);
    g = open_gate(2, short_names);
    assert_false(g.filtered);
    close_gate(g);
    // More than a filter's length.
    static char text[4096][16];
    static const char *many[4096];
    for (int i = 0; i < 4096; ++i) {
        snprintf(text[i], sizeof text[i], "%04d_channel", i);
        many[i] = text[i];
    }
    g = open_gate(4096, many);
    assert_false(g.filtered);
    close_gate(g);
    g = open_gate(200, many);
    assert_true(g.filtered);
    assert_true(channel_passes(g, "0199_channel"));
    assert_false(channel_passes(g, "0200_channel"));
    close_gate(g);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_short_messages),
        cmocka_unit_test(test_fragments_that_contradict_themselves),
        cmocka_unit_test(test_reassembly),
        cmocka_unit_test(test_parts_must_make_the_whole),
        cmocka_unit_test(test_filter),
        cmocka_unit_test(test_filter_is_exact),
        cmocka_unit_test(test_no_filter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
