// Seals of messages, the key file, and the transport that uses both. Seals over real LCM are tested
// in tests/distributed/test_key.sh.
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "lockstep/codec.h"
#include "tests/support/memory_hub.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"
#include "transport/seal.h"
#include "transport/transport.h"

#define NOW INT64_C(1700000000000000000) // ns
#define PAYLOAD 100
#define SENDER "left@here"
#define SEAL (PM_SEAL_LEAST + 9)   // bytes
#define SECOND INT64_C(1000000000) // ns, more than a test takes

static const pm_key one = {"0123456789abcdef0123456789abcde"};
static const pm_key other = {"0123456789abcdef0123456789abcdX"};

static pm_seal *seal_of(const pm_key *key) {
    pm_seal *seal = NULL;
    assert_int_equal(pm_seal_open(&seal, key, SENDER, NOW), PM_OK);
    return seal;
}

// A copy that is exactly as long as the message, so that a read beyond its end is seen.
static pm_drop check(pm_seal *seal, const char *channel, const void *data, size_t size) {
    unsigned char *copy = malloc(size + (size == 0));
    assert_non_null(copy);
    memcpy(copy, data, size);
    const size_t before = size;
    const pm_drop drop = pm_seal_check(seal, channel, copy, &size, NULL);
    assert_int_equal(size, drop == PM_KEEP ? before - SEAL : before);
    free(copy);
    return drop;
}

static void fill(unsigned char *data, const pm_seal *seal, int64_t stamp) {
    for (int i = 0; i < PAYLOAD; ++i) {
        data[i] = (unsigned char)(3 * i);
    }
    assert_int_equal(pm_seal_write(seal, "pair_FLUX_left", data, PAYLOAD, stamp), SEAL);
}

static void test_any_change_is_seen(void **context) {
    (void)context;
    pm_seal *seal = seal_of(&one), *foreign = seal_of(&other);
    unsigned char data[PAYLOAD + SEAL];
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
                         size < PM_SEAL_LEAST ? PM_DROP_LENGTH : PM_DROP_SEAL);
    }
    pm_seal_close(foreign);
    pm_seal_close(seal);
}

// The tag as RFC 7693 defines it, made by Python's hashlib.blake2b.
static void test_known_tag(void **context) {
    (void)context;
    static const unsigned char expected[SEAL] = {
        0x17, 0x97, 0x9c, 0xfe, 0x36, 0x2a, 0x00, 0x00, 0x6c, 0x65, 0x66, 0x74,
        0x40, 0x68, 0x65, 0x72, 0x65, 0x09, 0x3a, 0x36, 0x98, 0xe8, 0x4f, 0x86,
        0x64, 0x8d, 0x9b, 0x64, 0xf8, 0x33, 0x36, 0x36, 0x91, 0x0c};
    pm_seal *seal = seal_of(&one);
    unsigned char data[PAYLOAD + SEAL];
    fill(data, seal, NOW);
    assert_memory_equal(data + PAYLOAD, expected, sizeof expected);
    pm_seal_close(seal);
}

static void test_old_messages_are_refused(void **context) {
    (void)context;
    pm_seal *seal = seal_of(&one);
    unsigned char data[PAYLOAD + SEAL];
    const struct {
        int64_t stamp;
        pm_drop expected;
    } heard[] = {
        {NOW - PM_SEAL_AGE - 1, PM_DROP_REPLAY},
        {NOW - PM_SEAL_AGE + SECOND, PM_KEEP}, // clocks may differ
        {NOW + PM_SEAL_AGE, PM_KEEP},
        {NOW + PM_SEAL_AGE + SECOND, PM_DROP_CLOCK}, // a clock that is wrong
        {NOW + 3600 * SECOND, PM_DROP_CLOCK},
        {NOW, PM_KEEP}, // what others sent meanwhile makes nobody's message old
        {INT64_MIN, PM_DROP_REPLAY},
        {INT64_MAX, PM_DROP_CLOCK},
    };
    for (size_t i = 0; i < sizeof heard / sizeof heard[0]; ++i) {
        fill(data, seal, heard[i].stamp);
        assert_int_equal(check(seal, "pair_FLUX_left", data, sizeof data), heard[i].expected);
    }
    pm_seal_close(seal);
}

// A message that is refused for its stamp says whose clock differs, and by how much.
static void test_origin(void **context) {
    (void)context;
    pm_seal *seal = seal_of(&one);
    unsigned char data[PAYLOAD + SEAL];
    size_t size = sizeof data;
    pm_seal_origin origin;
    fill(data, seal, NOW + 3600 * SECOND);
    assert_int_equal(pm_seal_check(seal, "pair_FLUX_left", data, &size, &origin), PM_DROP_CLOCK);
    assert_string_equal(origin.sender, SENDER);
    assert_in_range(origin.ahead, 3599 * SECOND, 3600 * SECOND);
    pm_seal_close(seal);

    // A name of any length is cut.
    char name[2 * PM_SEAL_SENDER];
    memset(name, 'x', sizeof name);
    name[sizeof name - 1] = 0;
    unsigned char long_data[PAYLOAD + PM_SEAL_MOST];
    assert_int_equal(pm_seal_open(&seal, &one, name, NOW), PM_OK);
    size = PAYLOAD + pm_seal_write(seal, "a", long_data, PAYLOAD, NOW - 3600 * SECOND);
    assert_true(size <= sizeof long_data);
    assert_int_equal(pm_seal_check(seal, "a", long_data, &size, &origin), PM_DROP_REPLAY);
    assert_int_equal(strlen(origin.sender), PM_SEAL_SENDER - 1);
    pm_seal_close(seal);
}

// Programs that know the types but not the key go on decoding.
static void test_lcm_decodes_sealed_messages(void **context) {
    (void)context;
    pm_seal *seal = seal_of(&one);
    const portmet_tick_t tick = {.session = 7, .granted = 3, .steps = 9, .dt = 0.5};
    unsigned char data[256];
    const size_t size = pm_tick_encode(&tick, data, sizeof data - PM_SEAL_MOST);
    const size_t seal_size = pm_seal_write(seal, "pair_TICK", data, size, NOW);
    portmet_tick_t decoded;
    assert_int_equal(portmet_tick_t_decode(data, 0, (int)(size + seal_size), &decoded), size);
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
    assert_int_equal(pm_hub_connect(hub, &transport), PM_OK);
    if (key != NULL) {
        assert_int_equal(pm_transport_seal(transport, key, SENDER, NULL, NULL), PM_OK);
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
        cmocka_unit_test(test_origin),
        cmocka_unit_test(test_lcm_decodes_sealed_messages),
        cmocka_unit_test(test_key_files),
        cmocka_unit_test(test_sealed_transport),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
