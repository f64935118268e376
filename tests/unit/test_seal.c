// Seals of messages, the key file, and the transport that uses both. Seals over real LCM are tested
// in tests/distributed/test_key.sh.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
// cmocka needs the above.
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "lockstep/codec.h"
#include "tests/support/scratch.h"
#include "transport/seal.h"
#include "transport/transport.h"

#define NOW INT64_C(1700000000000000000) // ns
#define PAYLOAD 100

static const pm_key one = {"0123456789abcdef0123456789abcde"};
static const pm_key other = {"0123456789abcdef0123456789abcdX"};

static pm_seal *seal_of(const pm_key *key) {
    pm_seal *seal = NULL;
    assert_int_equal(pm_seal_open(&seal, key, NOW), PM_OK);
    return seal;
}

// A copy that is exactly as long as the message, so that a read beyond its end is seen.
static pm_drop check(pm_seal *seal, const char *channel, const void *data, size_t size) {
    unsigned char *copy = malloc(size + (size == 0));
    assert_non_null(copy);
    memcpy(copy, data, size);
    const size_t before = size;
    const pm_drop drop = pm_seal_check(seal, channel, copy, &size);
    assert_int_equal(size, drop == PM_KEEP ? before - PM_SEAL_SIZE : before);
    free(copy);
    return drop;
}

static void fill(unsigned char *data, const pm_seal *seal, int64_t stamp) {
    for (int i = 0; i < PAYLOAD; ++i) {
        data[i] = (unsigned char)(3 * i);
    }
    pm_seal_write(seal, "pair_FLUX_left", data, PAYLOAD, stamp);
}

static void test_any_change_is_seen(void **context) {
    (void)context;
    pm_seal *seal = seal_of(&one), *foreign = seal_of(&other);
    unsigned char data[PAYLOAD + PM_SEAL_SIZE];
    fill(data, seal, NOW);
    assert_int_equal(check(seal, "pair_FLUX_left", data, sizeof data), PM_KEEP);
    assert_int_equal(check(foreign, "pair_FLUX_left", data, sizeof data), PM_DROP_SEAL);
    assert_int_equal(check(seal, "pair_FLUX_righ", data, sizeof data), PM_DROP_SEAL);
    assert_int_equal(check(seal, "pair_FLUX_lef", data, sizeof data), PM_DROP_SEAL);
    for (size_t i = 0; i < 8 * sizeof data; ++i) {
        data[i / 8] ^= (unsigned char)(1u << i % 8);
        assert_int_equal(check(seal, "pair_FLUX_left", data, sizeof data), PM_DROP_SEAL);
        data[i / 8] ^= (unsigned char)(1u << i % 8);
    }
    for (size_t size = 0; size < sizeof data; ++size) {
        assert_int_equal(check(seal, "pair_FLUX_left", data, size),
                         size < PM_SEAL_SIZE ? PM_DROP_LENGTH : PM_DROP_SEAL);
    }
    pm_seal_close(foreign);
    pm_seal_close(seal);
}

// The tag as RFC 7693 defines it, made by Python's hashlib.blake2b.
static void test_known_tag(void **context) {
    (void)context;
    static const unsigned char expected[PM_SEAL_SIZE] = {
        0x17, 0x97, 0x9c, 0xfe, 0x36, 0x2a, 0x00, 0x00, 0x3b, 0xf2, 0x0f, 0x95,
        0xe0, 0xca, 0xb2, 0x57, 0x93, 0x5c, 0xae, 0x3d, 0xe9, 0x5d, 0x56, 0xc3};
    pm_seal *seal = seal_of(&one);
    unsigned char data[PAYLOAD + PM_SEAL_SIZE];
    fill(data, seal, NOW);
    assert_memory_equal(data + PAYLOAD, expected, sizeof expected);
    pm_seal_close(seal);
}

static void test_old_messages_are_refused(void **context) {
    (void)context;
    pm_seal *seal = seal_of(&one);
    unsigned char data[PAYLOAD + PM_SEAL_SIZE];
    const struct {
        int64_t stamp;
        pm_drop expected;
    } heard[] = {
        {NOW - PM_SEAL_AGE - 1, PM_DROP_REPLAY}, // before the start of listening
        {NOW - PM_SEAL_AGE, PM_KEEP},            // clocks may differ
        {NOW + PM_SEAL_AGE, PM_KEEP},
        {NOW - 1, PM_DROP_REPLAY}, // of this run, but of long ago
        {NOW, PM_KEEP},            // late or repeated: the lock-step's concern
        {INT64_MIN, PM_DROP_REPLAY},
    };
    for (size_t i = 0; i < sizeof heard / sizeof heard[0]; ++i) {
        fill(data, seal, heard[i].stamp);
        assert_int_equal(check(seal, "pair_FLUX_left", data, sizeof data), heard[i].expected);
    }
    // What is not authentic does not move the clock.
    fill(data, seal, NOW + 10 * PM_SEAL_AGE);
    data[0] ^= 1;
    assert_int_equal(check(seal, "pair_FLUX_left", data, sizeof data), PM_DROP_SEAL);
    fill(data, seal, NOW);
    assert_int_equal(check(seal, "pair_FLUX_left", data, sizeof data), PM_KEEP);
    pm_seal_close(seal);
}

// Programs that know the types but not the key go on decoding.
static void test_lcm_decodes_sealed_messages(void **context) {
    (void)context;
    pm_seal *seal = seal_of(&one);
    const portmet_tick_t tick = {.session = 7, .granted = 3, .steps = 9, .dt = 0.5};
    unsigned char data[256];
    const size_t size = pm_tick_encode(&tick, data, sizeof data - PM_SEAL_SIZE);
    pm_seal_write(seal, "pair_TICK", data, size, NOW);
    portmet_tick_t decoded;
    assert_int_equal(portmet_tick_t_decode(data, 0, (int)(size + PM_SEAL_SIZE), &decoded), size);
    assert_int_equal(decoded.steps, 9);
    assert_true(decoded.dt == 0.5);
    pm_seal_close(seal);
}

// --- the key ---

static void assert_no_key(const char *path, const char *part) {
    pm_key key;
    assert_int_equal(pm_key_load(&key, path), PM_EFILE);
    if (strstr(pm_error(), part) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", pm_error(), part);
    }
}

static void test_key_files(void **context) {
    (void)context;
    scratch s;
    scratch_open(&s);
    const char *path = scratch_path(&s, "pair.key");
    assert_no_key(path, "No such file");
    assert_no_key(s.folder, "not a file");
    scratch_write(path, one.byte, PM_KEY_SIZE);
    static const mode_t open_to_others[] = {0640, 0604, 0610, 0602};
    for (int i = 0; i < 4; ++i) {
        chmod(path, open_to_others[i]);
        assert_no_key(path, "others may use this key");
    }
    chmod(path, 0400);
    pm_key key = other;
    assert_int_equal(pm_key_load(&key, path), PM_OK);
    assert_memory_equal(&key, &one, sizeof key);
    pm_key_clear(&key);
    assert_int_equal(key.byte[0], 0);

    const char *bad = scratch_path(&s, "bad.key");
    scratch_write(bad, "", 0);
    chmod(bad, 0600);
    assert_no_key(bad, "0 bytes");
    scratch_write(bad, one.byte, PM_KEY_SIZE - 1);
    assert_no_key(bad, "31 bytes, expected a key of 32");
    char hex[65] = {0};
    scratch_write(bad, hex, sizeof hex);
    assert_no_key(bad, "65 bytes");
    scratch_close(&s);
}

// --- the transport ---

typedef struct ear {
    int count;
    char last[64];
    size_t size;
} ear;

static void listen(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    ear *e = context;
    ++e->count;
    e->size = size;
    assert_true(size < sizeof e->last);
    memcpy(e->last, data, size);
}

static pm_transport *join(pm_hub *hub, const pm_key *key, ear *e) {
    pm_transport *transport = NULL;
    assert_int_equal(pm_transport_open(&transport, "memory://", hub), PM_OK);
    if (key != NULL) {
        assert_int_equal(pm_transport_seal(transport, key), PM_OK);
    }
    assert_int_equal(pm_transport_subscribe(transport, "a", listen, e), PM_OK);
    return transport;
}

static void say(pm_transport *transport, const char *text) {
    assert_int_equal(pm_transport_publish(transport, "a", text, strlen(text)), PM_OK);
}

static void test_sealed_transport(void **context) {
    (void)context;
    ear with = {0}, without = {0}, wrong = {0};
    pm_hub *hub = NULL;
    assert_int_equal(pm_hub_open(&hub, NULL), PM_OK);
    pm_transport *a = join(hub, &one, &with), *b = join(hub, NULL, &without),
                 *c = join(hub, &other, &wrong);
    say(a, "sealed");
    say(b, "plain");
    say(b, "plain, longer than a seal is");
    say(c, "another key");
    say(a, "");
    pm_transport *const all[] = {a, b, c};
    for (int i = 0; i < 3; ++i) {
        assert_int_equal(pm_transport_wait(all[i], 0, NULL), PM_OK);
    }
    assert_int_equal(with.count, 2);
    assert_string_equal(with.last, "sealed");
    assert_int_equal(with.size, 0);
    assert_int_equal(wrong.count, 1);
    assert_int_equal(wrong.size, strlen("another key"));
    assert_int_equal(without.count, 5); // sees all of it, with what is behind
    const pm_drops *drops = pm_transport_drops(a);
    assert_int_equal(drops->count[PM_KEEP], 0); // the listener counts what it uses
    assert_int_equal(drops->count[PM_DROP_LENGTH], 1);
    assert_int_equal(drops->count[PM_DROP_SEAL], 2);
    for (int i = 0; i < 3; ++i) {
        pm_transport_close(all[i]);
    }
    pm_hub_close(hub);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_any_change_is_seen),
        cmocka_unit_test(test_known_tag),
        cmocka_unit_test(test_old_messages_are_refused),
        cmocka_unit_test(test_lcm_decodes_sealed_messages),
        cmocka_unit_test(test_key_files),
        cmocka_unit_test(test_sealed_transport),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
