// Drives the state machines in virtual time.
#include "tests/support/cluster_fixture.h"
#include "tests/support/unit.h"

#include <stdio.h>
#include <string.h>

#include "lockstep/coordinator.h"
#include "lockstep/node.h"

#define START 100.0   // s, virtual
#define TOO_LONG 60.0 // s, virtual

// Compares every number of a sample with the plain loop's.
pm_status cluster_compare(void *context, const pm_sample *sample) {
    cluster *c = context;
    if (sample->step > 0) {
        assert_int_equal(pm_monolithic_step(c->assembly), PM_OK);
    }
    const pm_sample *plain = pm_monolithic_sample(c->assembly);
    const size_t n = (size_t)c->nlink, number = sizeof(double);
    assert_int_equal(sample->step, c->steps_seen);
    assert_memory_equal(&sample->time, &plain->time, number);
    assert_memory_equal(sample->z, plain->z, (size_t)c->f.scene->physics.nz * number);
#define SAME(member, name, series, unit) assert_memory_equal(sample->name, plain->name, n *number);
    PM_SUBSYSTEM_NUMBERS(SAME, SAME)
    if (n > 1) {
        assert_memory_equal(sample->flux, plain->flux, (n - 1) * sizeof(pm_flux[2]));
    }
    ++c->steps_seen;
    if (sample->step == 5 && c->count_allocations != NULL) {
        c->allocations_at_step_5 = c->count_allocations();
    }
    if (sample->step == c->fail_at_step) {
        return pm_fail(PM_EFILE, "the recording is full");
    }
    return PM_OK;
}

// Remembers how far the plain loop had come when the coordinator wrote its checkpoint.
static void put_steps(void *context, pm_serializer *serializer) {
    cluster *c = context;
    pm_serializer_put_long(serializer, "steps seen", &c->steps_seen);
}

static pm_status resume(void *context, long step) {
    cluster *c = context;
    assert_int_equal(step + 1, c->steps_seen);
    pm_monolithic_set_state(c->assembly, c->f.z);
    for (long i = 0; i < step; ++i) {
        assert_int_equal(pm_monolithic_step(c->assembly), PM_OK);
    }
    return PM_OK;
}

static void tell_pause(void *context, const char *silent) {
    cluster *c = context;
    snprintf(c->silent, sizeof c->silent, "%s", silent);
    ++c->pauses;
}

static void tell_hold(void *context, long step) {
    cluster *c = context;
    c->held_at = step;
    ++c->holds;
}

static const char *checkpoint_of(cluster *c, int i) {
    if (c->folder == NULL) {
        return NULL;
    }
    snprintf(c->path[i], sizeof c->path[i], "%s/%d", c->folder, i);
    return c->path[i];
}

static void add_coordinator(cluster *c) {
    const pm_lockstep_coordinator_options options = {
        .steps = c->steps,
        .session = c->session,
        .want_state = true,
        .observer = {.context = c,
                     .step = cluster_compare,
                     .pause = tell_pause,
                     .hold = tell_hold,
                     .record = put_steps,
                     .resume = resume},
        .held = c->held,
        .stays = c->stays,
        .checkpoint = checkpoint_of(c, c->count),
    };
    assert_int_equal(pm_hub_connect(c->hub, &c->coordinator_transport), PM_OK);
    assert_int_equal(pm_lockstep_coordinator_open(&c->coordinator, c->f.system,
                                                  c->coordinator_transport, &options),
                     PM_OK);
}

// The scene.
static void begin(cluster *c, int nlink, int count, int window, pm_hub *hub, int64_t session,
                  const char *folder) {
    *c = (cluster){.nlink = nlink,
                   .count = count,
                   .session = session,
                   .steps = STEPS,
                   .fail_at_step = -1,
                   .now = START,
                   .hub = hub,
                   .folder = folder};
    fixture_open(&c->f, nlink, 1234);
    if (count != nlink) {
        fixture_deal(&c->f, count);
    }
    c->f.scene->network.window = window;
    c->f.scene->network.patience = PATIENCE;
    c->f.scene->network.checkpoint = CHECKPOINT;
}

// Plain loop, endpoints and coordinator.
static void open_rest(cluster *c) {
    assert_int_equal(pm_monolithic_open(&c->assembly, c->f.system), PM_OK);
    pm_monolithic_set_state(c->assembly, c->f.z);
    for (int i = 0; i < c->count; ++i) {
        assert_int_equal(pm_hub_connect(c->hub, &c->transport[i]), PM_OK);
    }
    add_coordinator(c);
}

static void add_nodes(cluster *c) {
    for (int i = 0; i < c->count; ++i) {
        cluster_add(c, i, c->f.system, c->session);
    }
}

// Everything but the nodes.
void cluster_open(cluster *c, int count, int window, pm_hub *hub, int64_t session) {
    begin(c, count, count, window, hub, session, NULL);
    open_rest(c);
}

void cluster_open_all(cluster *c, int count, int window, pm_hub *hub, int64_t session) {
    cluster_open(c, count, window, hub, session);
    add_nodes(c);
}

void cluster_open_dealt(cluster *c, int nlink, int count, int window, pm_hub *hub) {
    begin(c, nlink, count, window, hub, 0, NULL);
    open_rest(c);
    add_nodes(c);
}

void cluster_open_quick(cluster *c, int count, int window, pm_hub *hub, int64_t session,
                        const char *folder) {
    begin(c, count, count, window, hub, session, folder);
    c->f.scene->physics.integrator = pm_integrator_find("euler");
    c->f.scene->physics.substeps = 1;
    c->f.scene->network.checkpoint = QUICK_CHECKPOINT;
    open_rest(c);
    add_nodes(c);
}

void cluster_open_keeping(cluster *c, int count, int window, pm_hub *hub, int64_t session,
                          const char *folder) {
    begin(c, count, count, window, hub, session, folder);
    open_rest(c);
    add_nodes(c);
}

void cluster_kill(cluster *c, int i) {
    if (i == c->count) {
        pm_lockstep_coordinator_close(c->coordinator);
        pm_transport_close(c->coordinator_transport);
        c->coordinator = NULL;
        c->coordinator_transport = NULL;
    } else {
        pm_lockstep_node_close(c->node[i]);
        pm_transport_close(c->transport[i]);
        c->node[i] = NULL;
        c->transport[i] = NULL;
    }
}

void cluster_return(cluster *c, int i) {
    if (i == c->count) {
        add_coordinator(c);
    } else {
        assert_int_equal(pm_hub_connect(c->hub, &c->transport[i]), PM_OK);
        cluster_add(c, i, c->f.system, c->session);
    }
}

bool cluster_has(const cluster *c, int i) {
    return i == c->count ? c->coordinator != NULL : c->node[i] != NULL;
}

void cluster_add(cluster *c, int i, const pm_system *system, int64_t session) {
    const pm_lockstep_node_options options = {
        .z = c->f.z, .session = session, .stays = c->stays, .checkpoint = checkpoint_of(c, i)};
    assert_int_equal(pm_lockstep_node_open(&c->node[i], system, i, c->transport[i], &options),
                     PM_OK);
}

void cluster_close(cluster *c) {
    pm_lockstep_coordinator_close(c->coordinator);
    pm_transport_close(c->coordinator_transport);
    for (int i = 0; i < c->count; ++i) {
        pm_lockstep_node_close(c->node[i]);
        pm_transport_close(c->transport[i]);
    }
    pm_monolithic_close(c->assembly);
    fixture_close(&c->f);
}

void cluster_end(cluster *c) {
    cluster_close(c);
    pm_hub_close(c->hub);
}

long cluster_node_step(const pm_lockstep_node *node) {
    return (long)node->step;
}

long cluster_coordinator_step(const pm_lockstep_coordinator *coordinator) {
    return (long)coordinator->completed;
}

int64_t cluster_instance(const cluster *c) {
    return c->coordinator->endpoint.identity.hello.instance;
}

int64_t cluster_node_instance(const pm_lockstep_node *node) {
    return node->endpoint.identity.hello.instance;
}

bool cluster_has_joined(const pm_lockstep_node *node) {
    return node->endpoint.session != 0;
}

int64_t cluster_nonce(const pm_lockstep_node *node) {
    return node->endpoint.identity.hello.nonce;
}

bool cluster_is_over(const cluster *c) {
    bool over = c->coordinator == NULL || pm_lockstep_coordinator_finished(c->coordinator);
    for (int i = 0; i < c->count; ++i) {
        over = over && (c->node[i] == NULL || pm_lockstep_node_finished(c->node[i]));
    }
    return over;
}

// Everybody's turn; the number of messages handed out. Time passes when there are none.
int cluster_turn(cluster *c) {
    int total = 0, handled;
    if (c->coordinator != NULL) {
        assert_int_equal(pm_transport_wait(c->coordinator_transport, 0, &handled), PM_OK);
        pm_lockstep_coordinator_poll(c->coordinator, c->now);
        total += handled;
    }
    for (int i = 0; i < c->count; ++i) {
        if (c->node[i] != NULL) {
            assert_int_equal(pm_transport_wait(c->transport[i], 0, &handled), PM_OK);
            pm_lockstep_node_poll(c->node[i], c->now);
            total += handled;
        }
    }
    c->now += total == 0 ? TICK : 0;
    // Nothing may hang.
    if (c->now > START + TOO_LONG) {
        fail_msg("still running after %g virtual seconds", TOO_LONG);
    }
    return total;
}

// Runs on until all are finished; the virtual seconds that took.
double cluster_run(cluster *c) {
    const double start = c->now;
    while (!cluster_is_over(c)) {
        cluster_turn(c);
    }
    return c->now - start;
}

// Until `step` steps are complete.
void cluster_run_to(cluster *c, long step) {
    while (cluster_coordinator_step(c->coordinator) < step) {
        cluster_turn(c);
    }
}

// For `seconds`, without node `absent`.
void cluster_run_without(cluster *c, int absent, double seconds) {
    pm_lockstep_node *node = c->node[absent];
    c->node[absent] = NULL;
    for (const double end = c->now + seconds; c->now < end;) {
        cluster_turn(c);
    }
    c->node[absent] = node;
}

void assert_all_ok(cluster *c) {
    const pm_status status = pm_lockstep_coordinator_result(c->coordinator);
    if (status != PM_OK) {
        fail_msg("coordinator: %s", pm_error());
    }
    assert_int_equal(c->steps_seen, c->steps + 1);
    for (int i = 0; i < c->count; ++i) {
        if (pm_lockstep_node_result(c->node[i]) != PM_OK) {
            fail_msg("node %d: %s", i, pm_error());
        }
        assert_int_equal(cluster_node_step(c->node[i]), c->steps);
    }
}

void assert_error(pm_status status, pm_status expected, const char *part) {
    assert_int_equal(status, expected);
    if (strstr(pm_error(), part) == NULL) {
        fail_msg("error \"%s\" does not name \"%s\"", pm_error(), part);
    }
}

// The coordinator and every node ended with `code`; the coordinator's error contains `part`.
void assert_all_failed(const cluster *c, pm_status code, const char *part) {
    assert_error(pm_lockstep_coordinator_result(c->coordinator), code, part);
    for (int i = 0; i < c->count; ++i) {
        if (c->node[i] != NULL) {
            assert_int_equal(pm_lockstep_node_result(c->node[i]), code);
        }
    }
}

pm_hub *cluster_hub(const pm_hub_faults *faults) {
    pm_hub *hub = NULL;
    assert_int_equal(pm_hub_open(&hub, faults), PM_OK);
    return hub;
}
