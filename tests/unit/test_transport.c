// The memory transport of the tests and its faults, and URLs that are refused before LCM is called.
// Messages over real LCM are tested in tests/distributed.
#include <string.h>

#include "tests/support/memory_hub.h"
#include "tests/support/unit.h"
#include "transport/transport.h"

#define MANY 2000

// The messages that an endpoint heard: the numbers sent as single integers.
typedef struct ear {
    int count;
    int heard[2 * MANY];
    pm_transport *echo_to; // NULL, or where to publish again what was heard on channel "a", as "b"
} ear;

static void listen(void *context, const char *channel, const void *data, size_t size) {
    ear *e = context;
    assert_int_equal(size, sizeof(int));
    assert_true(e->count < 2 * MANY);
    memcpy(&e->heard[e->count++], data, sizeof(int));
    if (e->echo_to != NULL && strcmp(channel, "a") == 0) {
        assert_int_equal(pm_transport_publish(e->echo_to, "b", data, size), PM_OK);
    }
}

static pm_transport *join(pm_hub *hub, const char *channel, ear *e) {
    pm_transport *transport = NULL;
    assert_int_equal(pm_hub_connect(hub, &transport), PM_OK);
    if (channel != NULL) {
        assert_int_equal(pm_transport_subscribe(transport, channel, listen, e), PM_OK);
    }
    return transport;
}

static void publish(pm_transport *transport, const char *channel, int number) {
    assert_int_equal(pm_transport_publish(transport, channel, &number, sizeof number), PM_OK);
}

static int take(pm_transport *transport) {
    int handled = -1;
    assert_int_equal(pm_transport_wait(transport, 0, &handled), PM_OK);
    return handled;
}

static void test_order_and_channels(void **context) {
    (void)context;
    pm_hub *hub;
    ear one = {0}, two = {0};
    assert_int_equal(pm_hub_open(&hub, NULL), PM_OK);
    pm_transport *a = join(hub, "a", &one), *b = join(hub, "ab", &two);
    for (int i = 0; i < 100; ++i) {
        publish(b, "a", i);
        publish(a, i % 2 == 0 ? "ab" : "abc", i);
    }
    assert_int_equal(one.count, 0); // only a wait hands out
    assert_int_equal(take(a), 100);
    assert_int_equal(take(b), 50);
    assert_int_equal(take(a), 0);
    for (int i = 0; i < 100; ++i) {
        assert_int_equal(one.heard[i], i);
        assert_int_equal(two.heard[i / 2], i / 2 * 2);
    }
    publish(a, "a", 7); // its own messages too
    assert_int_equal(take(a), 1);
    pm_transport_close(a);
    publish(b, "a", 1); // nobody is left to hear it
    publish(b, "ab", 1);
    pm_transport_close(b); // with a message waiting
    pm_hub_close(hub);
}

// A handler may publish, even to its own endpoint; that is heard at the next wait.
static void test_handlers_may_publish(void **context) {
    (void)context;
    pm_hub *hub;
    ear e = {0};
    assert_int_equal(pm_hub_open(&hub, NULL), PM_OK);
    pm_transport *t = join(hub, "a", &e);
    assert_int_equal(pm_transport_subscribe(t, "b", listen, &e), PM_OK);
    e.echo_to = t;
    publish(t, "a", 1);
    publish(t, "a", 2);
    assert_int_equal(take(t), 2);
    assert_int_equal(take(t), 2);
    assert_int_equal(take(t), 0);
    const int expected[] = {1, 2, 1, 2};
    assert_memory_equal(e.heard, expected, sizeof expected);
    pm_transport_close(t);
    pm_hub_close(hub);
}

// Sends MANY numbers through a faulty hub and empties it.
static void send_many(const pm_hub_faults *faults, ear *e) {
    pm_hub *hub;
    assert_int_equal(pm_hub_open(&hub, faults), PM_OK);
    pm_transport *sender = join(hub, NULL, NULL), *receiver = join(hub, "a", e);
    for (int i = 0; i < MANY; ++i) {
        publish(sender, "a", i);
        if (i % 10 == 0) {
            take(receiver);
        }
    }
    for (int i = 0; i <= faults->max_delay; ++i) {
        take(receiver);
    }
    pm_transport_close(sender);
    pm_transport_close(receiver);
    pm_hub_close(hub);
}

static void test_faults(void **context) {
    (void)context;
    static ear drop, again, duplicate, delay;
    send_many(&(pm_hub_faults){.seed = 1, .drop = 0.25}, &drop);
    assert_in_range(drop.count, MANY * 0.7, MANY * 0.8);
    send_many(&(pm_hub_faults){.seed = 1, .drop = 0.25}, &again);
    assert_memory_equal(&drop, &again, sizeof drop);

    send_many(&(pm_hub_faults){.seed = 2, .duplicate = 0.25}, &duplicate);
    assert_in_range(duplicate.count, MANY * 1.2, MANY * 1.3);

    send_many(&(pm_hub_faults){.seed = 3, .delay = 0.25, .max_delay = 5}, &delay);
    assert_int_equal(delay.count, MANY);
    int overtaken = 0;
    for (int i = 1; i < MANY; ++i) {
        overtaken += delay.heard[i] < delay.heard[i - 1];
    }
    assert_true(overtaken > MANY / 20);
}

static void test_refused_urls(void **context) {
    (void)context;
    static const struct {
        const char *url, *part;
    } bad[] = {
        {"", "expected udpm://"},
        {"carrier_pigeon://", "expected udpm://"},
        {"memory://", "expected udpm://"},
        {"udpm://1.2.3.4:7667", "IPv4 multicast group"},
        {"udpm://239.255.76.67.99:7667", "IPv4 multicast group"},
        {"udpm://a.name.longer.than.any.address:7667", "IPv4 multicast group"},
        {"udpm://239.255.76.67:0", "a port from 1 to 65535"},
        {"udpm://239.255.76.67:65536?ttl=0", "a port from 1 to 65535"},
        {"udpm://239.255.76.67:12x", "a port from 1 to 65535"},
        {"udpm://239.255.76.67", "a port from 1 to 65535"},
        {"mpudpm://239.255.76.67?ttl=0", "a port from 1 to 65535"},
        {"udpm://", "IPv4 multicast group"},
        {"udpm://?ttl=1", "IPv4 multicast group"},
        {"udpm://239.255.76.67:7667?ttl=256", "0 to 255 as ttl"},
        {"udpm://239.255.76.67:7667?ttl=", "0 to 255 as ttl"},
        {"udpm://239.255.76.67:+7667", "a port from 1 to 65535"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        pm_transport *transport = NULL;
        assert_int_equal(pm_transport_open(&transport, bad[i].url), PM_ECONFIG);
        assert_null(transport);
        if (strstr(pm_error(), bad[i].part) == NULL) {
            fail_msg("\"%s\" does not say \"%s\"", pm_error(), bad[i].part);
        }
    }
}

static void test_urls_are_checked_without_opening(void **context) {
    (void)context;
    static const char *const good[] = {
        "udpm://239.255.76.67:7667", "udpm://239.255.76.67:7667?ttl=0",
        "udpm://239.255.76.67:7667?spin=no", "mpudpm://239.255.76.67:7667"};
    for (size_t i = 0; i < sizeof good / sizeof good[0]; ++i) {
        assert_int_equal(pm_transport_check(good[i]), PM_OK);
    }
    assert_int_equal(pm_transport_check("carrier_pigeon://"), PM_ECONFIG);
    assert_int_equal(pm_transport_check("udpm://239.255.76.67"), PM_ECONFIG);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_order_and_channels),
        cmocka_unit_test(test_handlers_may_publish),
        cmocka_unit_test(test_faults),
        cmocka_unit_test(test_refused_urls),
        cmocka_unit_test(test_urls_are_checked_without_opening),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
