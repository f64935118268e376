// Messages of an earlier run, sent again while the next one starts and runs, change nothing. A key
// keeps others from making messages, but not from recording and repeating them, so these are the
// messages that a stranger has within the age that a seal allows.
#include <stdio.h>
#include <string.h>

#include "tests/support/cluster_fixture.h"
#include "tests/support/scratch.h"
#include "tests/support/unit.h"
#include "transport/channel.h"

enum { NODES = 3, SESSION = 77, MOST = 4096, LARGEST = 1024 };

typedef struct message {
    char channel[PM_CHANNEL_SIZE];
    unsigned char data[LARGEST];
    size_t size;
} message;

// An eavesdropper that records all messages of a run.
typedef struct recorder {
    pm_transport *transport;
    int count;
    message *message; // [MOST]
} recorder;

static void record(void *context, const char *channel, const void *data, size_t size) {
    recorder *r = context;
    if (r->count < MOST && size <= LARGEST) {
        message *m = &r->message[r->count++];
        strcpy(m->channel, channel);
        memcpy(m->data, data, size);
        m->size = size;
    }
}

static void recorder_open(recorder *r, pm_hub *hub) {
    static const char *const common[] = {"TICK", "COMMAND", "HELLO", "REQUEST", "REQUEST_TICK"};
    static const char *const of_process[] = {"HELLO", "FLUX", "REPORT", "REQUEST"};
    char channel[2 * PM_CHANNEL_SIZE];
    *r = (recorder){.message = test_calloc(MOST, sizeof *r->message)};
    assert_int_equal(pm_hub_connect(hub, &r->transport), PM_OK);
    for (size_t i = 0; i < sizeof common / sizeof common[0]; ++i) {
        snprintf(channel, sizeof channel, "chain_%s", common[i]);
        assert_int_equal(pm_transport_subscribe(r->transport, channel, record, r), PM_OK);
    }
    for (int i = 0; i < 4 * NODES; ++i) {
        snprintf(channel, sizeof channel, "chain_%s_link%d", of_process[i % 4], i / 4 + 1);
        assert_int_equal(pm_transport_subscribe(r->transport, channel, record, r), PM_OK);
    }
}

// Takes in what has been sent, and closes the ears.
static void recorder_stop(recorder *r) {
    assert_int_equal(pm_transport_wait(r->transport, 0, NULL), PM_OK);
    pm_transport_close(r->transport);
    assert_in_range(r->count, 50, MOST - 1);
}

// Sends recorded messages, those on `channel` or all (NULL), during `turns` turns of the cluster or
// until it is over, several in each.
static void replay(const recorder *r, cluster *c, const char *channel, int turns) {
    pm_transport *stranger;
    assert_int_equal(pm_hub_connect(c->hub, &stranger), PM_OK);
    for (int i = 0, next = 0; i < turns && !cluster_is_over(c); ++i) {
        for (int k = 0; k < 20; ++k, next = (next + 1) % r->count) {
            const message *m = &r->message[next];
            if (channel == NULL || strcmp(channel, m->channel) == 0) {
                assert_int_equal(pm_transport_publish(stranger, m->channel, m->data, m->size),
                                 PM_OK);
            }
        }
        cluster_turn(c);
        c->now += TICK; // which cluster_turn() does only in silence
    }
    pm_transport_close(stranger);
}

// A run that was interrupted, or in which a node failed, continues with the session of before.
static void test_a_resumed_run(void **context) {
    (void)context;
    for (int fails = 0; fails < 2; ++fails) {
        scratch s;
        scratch_open(&s);
        pm_hub *hub = cluster_hub(NULL);
        recorder r;
        cluster c;
        cluster_open_keeping(&c, NODES, 1, hub, SESSION, s.folder);
        recorder_open(&r, hub);
        cluster_run_to(&c, CHECKPOINT + 2);
        if (fails) {
            pm_lockstep_node_fail(c.node[1], PM_EINTERRUPTED, "interrupted");
        } else {
            pm_lockstep_coordinator_fail(c.coordinator, PM_EINTERRUPTED, "interrupted");
        }
        cluster_run(&c);
        assert_all_failed(&c, PM_EINTERRUPTED, "interrupted");
        recorder_stop(&r);
        cluster_close(&c);

        cluster_open_keeping(&c, NODES, 1, hub, SESSION, s.folder);
        assert_int_equal(cluster_coordinator_step(c.coordinator), CHECKPOINT);
        replay(&r, &c, NULL, 1000000);
        assert_all_ok(&c);
        cluster_close(&c);
        test_free(r.message);
        pm_hub_close(hub);
        scratch_close(&s);
    }
}

// Nodes that were started by hand do not join a run that is over, and join the next one.
static void test_a_dead_session(void **context) {
    (void)context;
    pm_hub *hub = cluster_hub(NULL);
    recorder r;
    cluster c;
    cluster_open_all(&c, NODES, 1, hub, 0);
    recorder_open(&r, hub);
    cluster_run_to(&c, 5);
    recorder_stop(&r);
    cluster_close(&c);

    cluster_open_all(&c, NODES, 1, hub, 0);
    cluster_kill(&c, NODES);
    replay(&r, &c, "chain_TICK", 200);
    replay(&r, &c, NULL, 200);
    for (int i = 0; i < NODES; ++i) {
        assert_false(cluster_has_joined(c.node[i]));
    }
    cluster_return(&c, NODES);
    replay(&r, &c, NULL, 1000000);
    assert_all_ok(&c);
    cluster_close(&c);
    test_free(r.message);
    pm_hub_close(hub);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_a_resumed_run),
        cmocka_unit_test(test_a_dead_session),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
