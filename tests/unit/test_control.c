// A coordinator that stays and its control over the memory transport, in virtual time: one run
// after another with the bits of the plain loop, holding, stepping, starting anew, and what clients
// are refused.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/rng.h"
#include "lockstep/control.h"
#include "tests/support/cluster_fixture.h"
#include "tests/support/unit.h"

#define SESSION 77
#define MOST_NZ 64

typedef struct stage {
    pm_hub *hub;
    cluster c;
    pm_control *control;
    const double *from; // [nz] where the next run starts
    int begun, ended;   // runs
    int reloads;
    bool alone;        // samples are not compared with the plain loop
    bool keeps;        // the service keeps its run in a file
    double dies_at;    // s, when the service is killed, and started again; 0: never
    const pm_key *key; // of the scene; NULL: none
    char folder[64], checkpoint[80];
    pm_status status; // of the last one
    char why[256];
} stage;

// A client, with the last reply to it.
typedef struct client {
    stage *t;
    pm_transport *transport;
    portmet_control_t request;
    portmet_control_reply_t reply;
    double z[MOST_NZ], other[8][MOST_NZ]; // the arrays of the reply
    char text[PM_TEXT_MAX + 1];
    int replies;
} client;

// --- the service ---

static pm_status count(void *context, const pm_sample *sample) {
    cluster *c = context;
    (void)sample;
    c->steps_seen += 1;
    return PM_OK;
}

static pm_status begin(void *context, const pm_control_run *run, pm_lockstep_observer *observer) {
    stage *t = context;
    cluster *c = &t->c;
    assert_true(run->number > 0);
    pm_monolithic_set_state(c->assembly, t->from);
    c->steps_seen = 0;
    t->begun += run->from < 0;
    *observer = (pm_lockstep_observer){.context = c, .step = t->alone ? count : cluster_compare};
    return PM_OK;
}

static pm_status end(void *context, const pm_control_run *run, int64_t step, pm_status status,
                     const char *message) {
    (void)run, (void)step;
    stage *t = context;
    t->ended += 1;
    t->status = status;
    snprintf(t->why, sizeof t->why, "%s", message);
    return status == PM_OK ? PM_OK : pm_fail(status, "%s", message);
}

static pm_status place(void *context, const char *name, const char *suffix, char *path,
                       size_t size) {
    const stage *t = context;
    snprintf(path, size, "%s/%s%s", t->folder, name, suffix);
    return PM_OK;
}

static pm_status reload(void *context) {
    stage *t = context;
    t->reloads += 1;
    return t->reloads > 1 ? PM_OK : pm_fail(PM_EUSAGE, "the file is bad");
}

static void open_control(stage *t) {
    snprintf(t->checkpoint, sizeof t->checkpoint, "%s/run", t->folder);
    const pm_control_service service = {.context = t,
                                        .description = "what is served",
                                        .path = t->alone ? place : NULL,
                                        .begin = begin,
                                        .end = end,
                                        .reload = reload,
                                        .checkpoint = t->keeps ? t->checkpoint : NULL,
                                        .name = "this one"};
    assert_int_equal(pm_control_open(&t->control, t->c.coordinator, &service), PM_OK);
}

static void turn(stage *t) {
    cluster_turn(&t->c);
    (void)pm_control_poll(t->control);
    if (t->dies_at > 0 && t->c.now >= t->dies_at) {
        t->dies_at = 0;
        pm_control_close(t->control);
        cluster_kill(&t->c, t->c.count);
        cluster_return(&t->c, t->c.count);
        open_control(t);
    }
}

static void turn_for(stage *t, double seconds) {
    for (const double until = t->c.now + seconds; t->c.now < until;) {
        turn(t);
    }
}

static void stage_open(stage *t, int nlink, const pm_hub_faults *faults) {
    *t = (stage){.hub = cluster_hub(faults), .alone = t->alone, .keeps = t->keeps, .key = t->key};
    cluster *c = &t->c;
    pm_hub_seal(t->hub, t->key);
    cluster_open(c, nlink, 2, t->hub, SESSION);
    cluster_kill(c, nlink);
    c->stays = true;
    cluster_return(c, nlink);
    t->from = c->f.z;
    if (t->keeps) {
        snprintf(t->folder, sizeof t->folder, "/tmp/test_control_XXXXXX");
        assert_non_null(mkdtemp(t->folder));
    }
    open_control(t);
    for (int i = 0; i < nlink; ++i) {
        cluster_add(c, i, c->f.system, SESSION);
    }
}

static void stage_close(stage *t) {
    pm_control_close(t->control);
    cluster_close(&t->c);
    pm_hub_close(t->hub);
}

// --- a client ---

static void on_reply(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    client *k = context;
    portmet_control_reply_t r = {.npart = MOST_NZ,
                                 .part_energy = k->other[0],
                                 .part_entropy = k->other[1],
                                 .bulk_energy = k->other[2],
                                 .bulk_entropy = k->other[3],
                                 .nend = MOST_NZ,
                                 .energy_flux = k->other[4],
                                 .entropy_flux = k->other[5],
                                 .energy_gross = k->other[6],
                                 .entropy_gross = k->other[7],
                                 .nz = MOST_NZ,
                                 .z = k->z};
    assert_int_equal(pm_control_reply_decode(&r, data, size), PM_KEEP);
    if (r.client == k->request.client && r.nonce == k->request.nonce) {
        k->reply = r;
        snprintf(k->text, sizeof k->text, "%s", r.text);
        k->replies += 1;
    }
}

static void client_open(client *k, stage *t, int64_t id, const char *name) {
    *k = (client){.t = t, .request = {.client = id, .sender = (char *)name, .file = ""}};
    assert_int_equal(pm_hub_connect(t->hub, &k->transport), PM_OK);
    assert_int_equal(pm_transport_subscribe(k->transport, "chain_REPLY", on_reply, k), PM_OK);
}

static void publish(const client *k) {
    unsigned char data[1024];
    const size_t size = pm_control_encode(&k->request, data, sizeof data);
    assert_true(size > 0);
    assert_int_equal(pm_transport_publish(k->transport, "chain_CONTROL", data, size), PM_OK);
}

// Repeats the request of another kind until there is a reply: one that says DONE or REFUSED, or, if
// `whole` is false, any.
static int ask(client *k, int8_t kind, bool whole) {
    k->request.kind = kind;
    k->request.nonce += 1;
    for (double again = 0;;) {
        if (k->t->c.now >= again) {
            publish(k);
            again = k->t->c.now + 0.02;
        }
        const int before = k->replies;
        turn(k->t);
        assert_int_equal(pm_transport_wait(k->transport, 0, NULL), PM_OK);
        if (k->replies == before) {
            continue;
        }
        if (k->reply.kind == PORTMET_CONTROL_REPLY_T_AGAIN) {
            again = k->reply.ticket == k->request.ticket ? again : 0;
            k->request.ticket = k->reply.ticket;
            if (k->reply.last >= k->request.nonce) {
                k->request.nonce = k->reply.last + 1;
                again = 0;
            }
        } else if (k->reply.kind != PORTMET_CONTROL_REPLY_T_PENDING &&
                   (!whole || k->reply.kind != PORTMET_CONTROL_REPLY_T_ACCEPTED)) {
            return k->reply.kind;
        }
    }
}

#define DONE PORTMET_CONTROL_REPLY_T_DONE
#define ACCEPTED PORTMET_CONTROL_REPLY_T_ACCEPTED
#define ASK(client, kind) ask(client, PORTMET_CONTROL_T_##kind, true)

static void assert_refused(client *k, int8_t kind, const char *part) {
    assert_int_equal(ask(k, kind, true), PORTMET_CONTROL_REPLY_T_REFUSED);
    assert_int_equal(k->reply.code, PM_EUSAGE);
    if (strstr(k->text, part) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", k->text, part);
    }
}

// --- runs ---

// Many runs, at two starts in turn, each with the bits of the plain loop, while a network loses,
// repeats and delays messages. No process joins anew.
static void test_one_run_after_another(void **context) {
    (void)context;
    for (uint64_t seed = 0; seed < 4; ++seed) {
        const double part = seed == 0 ? 0 : 0.2;
        const pm_hub_faults faults = {
            .seed = seed, .drop = part, .duplicate = part, .delay = part, .max_delay = 12};
        stage t = {0};
        client k;
        stage_open(&t, 3, &faults);
        client_open(&k, &t, 5, "bench");
        const int nz = t.c.f.scene->physics.nz;
        double other[MOST_NZ];
        for (int i = 0; i < nz; ++i) {
            other[i] = t.c.f.z[i] * (1 + 1e-3 * (i + 1));
        }
        for (int run = 1; run <= 20; ++run) {
            const bool own = run % 2 == 0;
            t.from = own ? other : t.c.f.z;
            k.request.nz = own ? nz : 0;
            k.request.z = other;
            k.request.steps = 5 + run;
            assert_int_equal(ASK(&k, START), DONE);
            assert_string_equal(k.text, "");
            assert_int_equal(k.reply.code, PM_OK);
            assert_int_equal(k.reply.phase, PORTMET_CONTROL_REPLY_T_ENDED);
            assert_int_equal(k.reply.step, 5 + run);
            assert_int_equal(t.c.steps_seen, 6 + run);
            assert_memory_equal(k.z, pm_monolithic_sample(t.c.assembly)->z,
                                (size_t)nz * sizeof *k.z);
            assert_memory_equal(k.reply.part_energy, pm_monolithic_sample(t.c.assembly)->energy,
                                3 * sizeof *k.z);
            assert_true(k.reply.energy_flux[0] ==
                        pm_monolithic_sample(t.c.assembly)->flux[0][0].energy);
            assert_int_equal(k.reply.run, run);
            assert_int_equal(t.begun, run);
            assert_int_equal(t.ended, run);
        }
        pm_transport_close(k.transport);
        stage_close(&t);
    }
}

static void test_steps_on_demand(void **context) {
    (void)context;
    stage t = {0};
    client k;
    stage_open(&t, 2, NULL);
    client_open(&k, &t, 5, "bench");
    cluster *c = &t.c;
    assert_refused(&k, PORTMET_CONTROL_T_ADVANCE, "no run");
    k.request.held = 1;
    assert_int_equal(ask(&k, PORTMET_CONTROL_T_START, false), ACCEPTED);
    assert_int_equal(k.reply.phase, PORTMET_CONTROL_REPLY_T_HELD);
    assert_int_equal(k.reply.steps, 0);
    for (int i = 1; i <= 5; ++i) {
        k.request.steps = i;
        assert_int_equal(ASK(&k, ADVANCE), DONE);
        assert_int_equal(k.reply.step, i * (i + 1) / 2);
        assert_memory_equal(k.z, pm_monolithic_sample(c->assembly)->z,
                            (size_t)c->f.scene->physics.nz * sizeof *k.z);
        // Fluxes and ledger are all there.
        const pm_flux *flux = &pm_monolithic_sample(c->assembly)->flux[0][1];
        assert_true(k.reply.energy_gross[1] == flux->energy_gross);
        assert_true(k.reply.entropy_gross[1] == flux->entropy_gross);
        assert_true(k.reply.first_energy == c->coordinator->ledger.first_energy);
        assert_true(k.reply.energy_drift == c->coordinator->ledger.energy_drift);
        // The same request again is answered again, and takes no step.
        publish(&k);
        turn_for(&t, 0.05);
        assert_int_equal(c->steps_seen, i * (i + 1) / 2 + 1);
        turn_for(&t, 3 * PATIENCE); // held for as long as it takes
    }
    // Who asks again while it is being done learns that it is.
    k.request.kind = PORTMET_CONTROL_T_ADVANCE;
    k.request.nonce += 1;
    k.request.steps = 2;
    publish(&k);
    turn(&t);
    publish(&k);
    const int before = k.replies;
    while (k.replies == before) {
        turn(&t);
        assert_int_equal(pm_transport_wait(k.transport, 0, NULL), PM_OK);
    }
    assert_int_equal(k.reply.kind, PORTMET_CONTROL_REPLY_T_PENDING);
    turn_for(&t, 0.1);
    publish(&k);
    turn_for(&t, 0.05);
    assert_int_equal(pm_transport_wait(k.transport, 0, NULL), PM_OK);
    assert_int_equal(k.reply.kind, DONE);
    assert_int_equal(k.reply.step, 17);
    // Somebody forges a later request of this client, which then numbers its own ones anew.
    k.request.nonce += 1000;
    k.request.steps = 0;
    publish(&k);
    k.request.nonce -= 1000;
    k.request.steps = 1;
    turn_for(&t, 0.05);
    assert_int_equal(ASK(&k, ADVANCE), DONE);
    assert_int_equal(k.reply.step, 18);
    assert_true(k.request.nonce > 1000);
    k.request.steps = 5;
    // An older request, or one with another ticket, does nothing.
    const portmet_control_t last = k.request;
    k.request.nonce -= 1;
    publish(&k);
    k.request = last;
    k.request.nonce += 1;
    k.request.ticket += 1;
    publish(&k);
    turn_for(&t, 0.05);
    assert_int_equal(c->steps_seen, 19);
    k.request = last;

    k.request.steps = 0;
    assert_int_equal(ASK(&k, RESUME), DONE);
    for (int i = 0; i < 200; ++i) { // no time passes while messages flow
        turn(&t);
    }
    assert_refused(&k, PORTMET_CONTROL_T_ADVANCE, "the run goes on");
    assert_int_equal(ASK(&k, PAUSE), DONE);
    assert_true(k.reply.step > 15);
    const long held_at = c->steps_seen;
    assert_int_equal(k.reply.step + 1, held_at);
    turn_for(&t, 1);
    assert_int_equal(c->steps_seen, held_at);
    // It goes on to a step, where it is held again.
    k.request.steps = held_at + 20;
    assert_int_equal(ASK(&k, RESUME), DONE);
    turn_for(&t, 1);
    assert_int_equal(c->steps_seen, held_at + 21);
    // The run begins anew.
    pm_monolithic_set_state(c->assembly, c->f.z);
    c->steps_seen = 0;
    assert_int_equal(ASK(&k, RESET), DONE);
    assert_int_equal(k.reply.step, 0);
    k.request.steps = 5;
    assert_int_equal(ASK(&k, ADVANCE), DONE);
    assert_int_equal(k.reply.step, 5);
    assert_int_equal(ASK(&k, STOP), DONE);
    assert_int_equal(k.reply.phase, PORTMET_CONTROL_REPLY_T_ENDED);
    assert_int_equal(t.ended, 1);
    assert_int_equal(ASK(&k, STOP), DONE);
    assert_int_equal(t.begun, 1);
    pm_transport_close(k.transport);
    stage_close(&t);
}

// --- states between steps ---

static double sum(const double *value, int count) {
    double total = 0;
    for (int i = 0; i < count; ++i) {
        total += value[i];
    }
    return total;
}

// A state that is set between two steps, and one that was kept and is restored, are where the run
// goes on, with the bits of the plain loop. What a state has more than the one before came from the
// outside, so that the totals stay.
static void test_states_between_steps(void **context) {
    (void)context;
    for (uint64_t seed = 0; seed < 3; ++seed) {
        const double part = seed == 0 ? 0 : 0.2;
        const pm_hub_faults faults = {
            .seed = seed, .drop = part, .duplicate = part, .delay = part, .max_delay = 12};
        stage t = {.alone = true};
        client k;
        stage_open(&t, 3, &faults);
        snprintf(t.folder, sizeof t.folder, "/tmp/test_control_XXXXXX");
        assert_non_null(mkdtemp(t.folder));
        client_open(&k, &t, 5, "bench");
        cluster *c = &t.c;
        const int nz = c->f.scene->physics.nz;
        const size_t bytes = (size_t)nz * sizeof(double);
        double z[MOST_NZ];
        k.request.held = 1;
        assert_int_equal(ask(&k, PORTMET_CONTROL_T_START, false), ACCEPTED);
        k.request.steps = 6;
        assert_int_equal(ASK(&k, ADVANCE), DONE);
        const portmet_control_reply_t before = k.reply;
        const double inside = sum(before.part_energy, 3);
        for (int i = 0; i < nz; ++i) {
            z[i] = k.z[i] * (1 + 0.1 * (i + 1));
        }
        k.request.z = z;
        k.request.nz = 1;
        assert_refused(&k, PORTMET_CONTROL_T_SET, "a state of 1 numbers");
        k.request.nz = nz;
        assert_int_equal(ASK(&k, SET), DONE);
        k.request.nz = 0;
        assert_int_equal(k.reply.phase, PORTMET_CONTROL_REPLY_T_HELD);
        assert_int_equal(k.reply.step, 6);
        assert_int_equal(k.reply.run, before.run);
        assert_memory_equal(k.z, z, bytes);
        assert_true(k.reply.energy == before.energy && k.reply.entropy == before.entropy);
        assert_true(fabs(k.reply.outside_energy - inside + sum(k.reply.part_energy, 3)) <
                    1e-12 * fabs(inside));
        assert_true(fabs(k.reply.outside_energy) > 1e-3 * fabs(inside));
        k.request.steps = 5;
        assert_int_equal(ASK(&k, ADVANCE), DONE);
        assert_int_equal(k.reply.step, 11);
        pm_monolithic_set_state(c->assembly, z);
        for (int i = 0; i < 5; ++i) {
            assert_int_equal(pm_monolithic_step(c->assembly), PM_OK);
        }
        assert_memory_equal(k.z, pm_monolithic_sample(c->assembly)->z, bytes);
        assert_int_equal(c->steps_seen, 12); // each step was observed once

        k.request.file = "a";
        assert_int_equal(ASK(&k, CHECKPOINT), DONE);
        memcpy(z, k.z, bytes);
        const portmet_control_reply_t kept = k.reply;
        assert_int_equal(ASK(&k, ADVANCE), DONE);
        double later[MOST_NZ];
        memcpy(later, k.z, bytes);
        const portmet_control_reply_t after = k.reply;
        for (int i = 0; i < 2; ++i) { // in this run, and in another one
            assert_int_equal(ASK(&k, RESTORE), DONE);
            assert_int_equal(k.reply.phase, PORTMET_CONTROL_REPLY_T_HELD);
            assert_int_equal(k.reply.step, 11);
            assert_memory_equal(k.z, z, bytes);
            assert_memory_equal(&k.reply.energy, &kept.energy, sizeof kept.energy);
            assert_int_equal(ASK(&k, ADVANCE), DONE);
            assert_int_equal(k.reply.step, 16);
            assert_memory_equal(k.z, later, bytes);
            assert_true(k.reply.energy == after.energy && k.reply.entropy == after.entropy &&
                        k.reply.energy_drift == after.energy_drift &&
                        k.reply.outside_energy == after.outside_energy &&
                        k.reply.violations == after.violations);
            assert_int_equal(ASK(&k, STOP), DONE);
            k.request.file = "";
            k.request.steps = 0;
            assert_int_equal(ask(&k, PORTMET_CONTROL_T_START, false), ACCEPTED);
            k.request.file = "a";
            k.request.steps = 5;
        }
        // What cannot be kept or restored.
        k.request.file = "../a";
        assert_refused(&k, PORTMET_CONTROL_T_CHECKPOINT, "letters, digits");
        k.request.file = "";
        assert_refused(&k, PORTMET_CONTROL_T_RESTORE, "letters, digits");
        k.request.file = "b";
        assert_int_equal(ASK(&k, RESTORE), PORTMET_CONTROL_REPLY_T_REFUSED);
        assert_non_null(strstr(k.text, "nothing is kept as b"));
        char path[128];
        (void)place(&t, "b", ".state", path, sizeof path);
        FILE *file = fopen(path, "w");
        assert_non_null(file);
        fputs("of somebody else", file);
        fclose(file);
        assert_int_equal(ASK(&k, CHECKPOINT), PORTMET_CONTROL_REPLY_T_REFUSED);
        unlink(path);
        k.request.file = "a";
        assert_int_equal(ASK(&k, RESUME), DONE);
        assert_refused(&k, PORTMET_CONTROL_T_CHECKPOINT, "the run goes on");
        k.request.nz = nz;
        assert_refused(&k, PORTMET_CONTROL_T_SET, "the run goes on");
        (void)place(&t, "a", ".state", path, sizeof path);
        assert_int_equal(unlink(path), 0);
        assert_int_equal(rmdir(t.folder), 0);
        pm_transport_close(k.transport);
        stage_close(&t);
    }
}

// A service that is killed at any moment and started again goes on with its run: each request is
// done once, with the bits of a run without kills, and every step is booked in the ledger.
static void test_service_dies(void **context) {
    (void)context;
    double z[MOST_NZ] = {0};
    portmet_control_reply_t plain = {0};
    for (uint64_t seed = 0; seed < 20; ++seed) {
        const double part = seed == 0 ? 0 : 0.1;
        const pm_hub_faults faults = {
            .seed = seed, .drop = part, .duplicate = part, .delay = part, .max_delay = 12};
        stage t = {.alone = true, .keeps = true};
        client k, starter;
        pm_rng rng;
        pm_rng_init(&rng, seed, 0);
        stage_open(&t, 2, &faults);
        client_open(&k, &t, 5, "bench");
        client_open(&starter, &t, 6, "starter");
        starter.request.held = 1;
        starter.request.steps = 60;
        assert_int_equal(ask(&starter, PORTMET_CONTROL_T_START, false), ACCEPTED);
        for (int i = 1; i <= 10; ++i) {
            k.request.steps = 3;
            t.dies_at = seed > 0 && i % 3 == 0 ? t.c.now + 0.03 * pm_rng_uniform(&rng) : 0;
            assert_int_equal(ASK(&k, ADVANCE), DONE);
            assert_int_equal(k.reply.step, 3 * i);
            assert_int_equal(k.reply.phase, PORTMET_CONTROL_REPLY_T_HELD);
        }
        t.dies_at = seed > 0 ? t.c.now + 0.03 * pm_rng_uniform(&rng) : 0;
        k.request.steps = 0;
        assert_int_equal(ASK(&k, RESUME), DONE);
        turn_for(&t, 4 * PATIENCE);
        assert_int_equal(ASK(&k, QUERY), DONE);
        assert_int_equal(k.reply.phase, PORTMET_CONTROL_REPLY_T_ENDED);
        starter.request.nonce -= 1; // the same request: it has waited for the end of its run
        assert_int_equal(ASK(&starter, START), DONE);
        assert_int_equal(starter.reply.code, PM_OK);
        assert_int_equal(starter.reply.step, 60);
        const size_t bytes = (size_t)t.c.f.scene->physics.nz * sizeof *z;
        if (seed == 0) {
            memcpy(z, starter.z, bytes);
            plain = starter.reply;
        }
        assert_memory_equal(starter.z, z, bytes);
        assert_true(starter.reply.energy == plain.energy &&
                    starter.reply.energy_drift == plain.energy_drift &&
                    starter.reply.energy_residual == plain.energy_residual &&
                    starter.reply.run == plain.run);
        assert_int_equal(t.begun, 1);
        assert_int_equal(unlink(t.checkpoint), 0);
        assert_int_equal(rmdir(t.folder), 0);
        pm_transport_close(starter.transport);
        pm_transport_close(k.transport);
        stage_close(&t);
    }
}

// --- refusals ---

static void test_two_clients(void **context) {
    (void)context;
    stage t = {0};
    client a, b;
    stage_open(&t, 2, NULL);
    client_open(&a, &t, 5, "first");
    client_open(&b, &t, 6, "second");
    a.request.held = 1;
    assert_int_equal(ask(&a, PORTMET_CONTROL_T_START, false), ACCEPTED);
    assert_refused(&b, PORTMET_CONTROL_T_START, "run 1 of first is under way");
    assert_int_equal(ASK(&b, QUERY), DONE);
    assert_string_equal(b.text, "what is served");
    assert_int_equal(b.reply.pages, 1);
    // The first one dies while steps are taken. The run is held after them; the second takes over.
    a.request.kind = PORTMET_CONTROL_T_ADVANCE;
    a.request.nonce += 1;
    a.request.steps = 3;
    publish(&a);
    turn_for(&t, 1);
    assert_int_equal(ASK(&b, QUERY), DONE);
    assert_int_equal(b.reply.phase, PORTMET_CONTROL_REPLY_T_HELD);
    assert_int_equal(b.reply.step, 3);
    b.request.steps = 2;
    assert_int_equal(ASK(&b, ADVANCE), DONE);
    assert_int_equal(b.reply.step, 5);
    assert_int_equal(ASK(&b, STOP), DONE);
    // Steps are asked for before the processes of a run that begins held have come together.
    a.request.kind = PORTMET_CONTROL_T_START;
    a.request.nonce += 1;
    publish(&a);
    assert_int_equal(ASK(&b, ADVANCE), DONE);
    assert_int_equal(b.reply.step, 2);
    assert_int_equal(ASK(&b, STOP), DONE);
    pm_transport_close(a.transport);
    pm_transport_close(b.transport);
    stage_close(&t);
}

static void test_wrong_requests(void **context) {
    (void)context;
    static const char *const names[] = {"../a.h5", "a/b", ".a", "a b", "/etc/x", "a\\b", "ä"};
    stage t = {0};
    client k;
    double z[MOST_NZ] = {0};
    stage_open(&t, 2, NULL);
    client_open(&k, &t, 5, "bench");
    k.request.z = z;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; ++i) {
        k.request.file = (char *)names[i];
        assert_refused(&k, PORTMET_CONTROL_T_START, "letters, digits");
    }
    k.request.file = "run.h5";
    assert_refused(&k, PORTMET_CONTROL_T_START, "no folder");
    k.request.file = "";
    k.request.nz = 1;
    assert_refused(&k, PORTMET_CONTROL_T_START, "a state of 1 numbers");
    k.request.nz = 0;
    k.request.steps = -1;
    assert_refused(&k, PORTMET_CONTROL_T_START, "-1 steps");
    k.request.steps = INT64_MAX;
    assert_refused(&k, PORTMET_CONTROL_T_START, "steps, at most");
    k.request.steps = 4;
    assert_refused(&k, PORTMET_CONTROL_T_SET, "no run");
    const pm_drops *drops = pm_lockstep_coordinator_drops(t.c.coordinator);
    const long before = drops->count[PM_DROP_IMPLAUSIBLE];
    k.request.kind = 99;
    publish(&k);
    k.request.kind = -1;
    publish(&k);
    k.request.kind = 0;
    k.request.page = -1;
    publish(&k);
    turn_for(&t, 0.01);
    assert_int_equal(drops->count[PM_DROP_IMPLAUSIBLE], before + 3);
    k.request.page = 0;
    assert_int_equal(t.begun, 0);
    assert_int_equal(ASK(&k, START), DONE);
    assert_int_equal(t.begun, 1);
    assert_refused(&k, PORTMET_CONTROL_T_RELOAD, "the file is bad");
    k.request.held = 1;
    assert_int_equal(ask(&k, PORTMET_CONTROL_T_START, false), ACCEPTED);
    assert_refused(&k, PORTMET_CONTROL_T_RELOAD, "is under way");
    assert_int_equal(ASK(&k, STOP), DONE);
    // A service that begins anew answers nothing else: its successor does.
    assert_int_equal(ASK(&k, RELOAD), DONE);
    assert_int_equal(t.reloads, 2);
    k.request.kind = PORTMET_CONTROL_T_START;
    k.request.nonce += 1;
    const long unanswered = drops->count[PM_DROP_RANGE];
    publish(&k);
    turn_for(&t, 0.01);
    assert_int_equal(drops->count[PM_DROP_RANGE], unanswered + 1);
    assert_int_equal(t.begun, 2);
    pm_transport_close(k.transport);
    stage_close(&t);
}

// --- strangers ---

enum { KEPT = 64, LARGEST = 1024 };

static int messages = 5000; // that a stranger sends

// A stranger, who does not hear the replies, has heard some requests.
typedef struct stranger {
    pm_transport *transport;
    pm_rng rng;
    bool hears; // messages of others; it hears its own as well
    int nkept;
    size_t size[KEPT];
    unsigned char kept[KEPT][LARGEST];
} stranger;

static void on_request(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    stranger *s = context;
    if (size <= LARGEST && s->hears) {
        memcpy(s->kept[s->nkept % KEPT], data, size);
        s->size[s->nkept % KEPT] = size;
        s->nkept += 1;
    }
}

// Publishes a message as a stranger does: one of the client's, changed, cut, or again; or one of
// its own, whose numbers are random.
static void forge(stranger *s, const client *k) {
    unsigned char data[LARGEST];
    pm_rng *rng = &s->rng;
    const uint64_t bits = pm_rng_bits(rng);
    const int which = (int)(bits % 4);
    size_t count = 0;
    if (which == 0 || s->nkept == 0) {
        double z[4] = {0.5, 1e300, -1, 0};
        portmet_control_t own = k->request;
        own.client = bits % 3 == 0 ? k->request.client : (int64_t)pm_rng_bits(rng);
        own.nonce = (int64_t)(pm_rng_bits(rng) >> (pm_rng_bits(rng) % 64));
        own.ticket = (int64_t)pm_rng_bits(rng);
        own.kind = (int8_t)(pm_rng_bits(rng) % 13);
        own.steps = (int64_t)pm_rng_bits(rng) >> (pm_rng_bits(rng) % 64);
        own.held = (int8_t)(bits >> 8 & 1);
        own.page = (int32_t)(pm_rng_bits(rng) >> 40);
        own.nz = (int32_t)(bits >> 16 & 3);
        own.z = z;
        own.file = (char *)((bits >> 20 & 1) != 0 ? "../../etc/passwd" : "a");
        count = pm_control_encode(&own, data, sizeof data);
    } else {
        const int i = (int)((bits >> 8) % (uint64_t)(s->nkept < KEPT ? s->nkept : KEPT));
        count = s->size[i];
        memcpy(data, s->kept[i], count);
        if (which == 1) {
            // A later number, with the ticket that anybody can hear, would be a request.
            const size_t at = (bits >> 32) % count;
            data[at / 8 == 3 ? at - 8 : at] ^= (unsigned char)(1 << (bits >> 24 & 7));
        } else if (which == 2) {
            count = (bits >> 32) % (count + 1);
        }
    }
    assert_int_equal(pm_transport_publish(s->transport, "chain_CONTROL", data, count), PM_OK);
}

// Whatever a stranger sends who does not hear the replies, the client's runs have their bits, and
// every request of the client is answered. With a key the stranger has none.
static void test_strangers(void **context) {
    (void)context;
    static const pm_key key = {{1, 2, 3}};
    for (int sealed = 0; sealed < 2; ++sealed) {
        static stranger s;
        stage t = {.key = sealed ? &key : NULL};
        client k;
        int sent = 0;
        s = (stranger){0};
        pm_rng_init(&s.rng, 7, 0);
        stage_open(&t, 2, NULL);
        client_open(&k, &t, 5, "bench");
        pm_hub_seal(t.hub, NULL);
        assert_int_equal(pm_hub_connect(t.hub, &s.transport), PM_OK);
        assert_int_equal(pm_transport_subscribe(s.transport, "chain_CONTROL", on_request, &s),
                         PM_OK);
        const pm_drops *below = pm_transport_drops(t.c.coordinator_transport);
        for (int run = 1; sent < messages; ++run) {
            k.request.held = 1;
            k.request.steps = 0;
            assert_int_equal(ask(&k, PORTMET_CONTROL_T_START, false), ACCEPTED);
            for (int i = 1; i <= 20; ++i) {
                k.request.steps = 1 + i % 3;
                for (int m = 0; m < 30; ++m, ++sent) {
                    forge(&s, &k);
                    if (m % 5 == 0) {
                        turn(&t);
                    }
                }
                const int64_t before = k.reply.step;
                s.hears = false;
                assert_int_equal(pm_transport_wait(s.transport, 0, NULL), PM_OK);
                assert_int_equal(ASK(&k, ADVANCE), DONE);
                assert_int_equal(k.reply.step, before + k.request.steps);
                s.hears = true;
                assert_int_equal(pm_transport_wait(s.transport, 0, NULL), PM_OK);
                assert_memory_equal(k.z, pm_monolithic_sample(t.c.assembly)->z,
                                    (size_t)t.c.f.scene->physics.nz * sizeof *k.z);
            }
            assert_int_equal(ASK(&k, STOP), DONE);
            assert_int_equal(t.begun, run);
            assert_int_equal(t.status, PM_OK);
        }
        assert_true(!sealed || below->count[PM_DROP_SEAL] > messages / 2);
        assert_int_equal(t.reloads, 0);
        pm_transport_close(s.transport);
        pm_transport_close(k.transport);
        stage_close(&t);
    }
}

// Of two services of a scene the later one is refused, and of two that begin at once as well. With
// other sessions both stay, and requests reach the one that they name.
static void test_two_services(void **context) {
    (void)context;
    for (int at_once = 0; at_once < 2; ++at_once) {
        stage t = {0};
        client k;
        stage_open(&t, 2, NULL);
        cluster *c = &t.c;
        for (int64_t session = at_once == 1 ? 0 : 8; session >= 0; session -= 8) {
            pm_transport *transport;
            pm_lockstep_coordinator *later;
            pm_control *control;
            const pm_control_service service = {.context = &t,
                                                .description = "",
                                                .begin = begin,
                                                .end = end,
                                                .reload = reload,
                                                .session = session,
                                                .name = "a later one"};
            if (at_once == 0) {
                turn_for(&t, 1);
            }
            assert_int_equal(pm_hub_connect(t.hub, &transport), PM_OK);
            assert_int_equal(pm_lockstep_coordinator_open(
                                 &later, c->f.system, transport,
                                 &(pm_lockstep_coordinator_options){.stays = true, .session = 9}),
                             PM_OK);
            assert_int_equal(pm_control_open(&control, later, &service), PM_OK);
            pm_status status = PM_OK;
            for (const double until = c->now + 1; c->now < until && status == PM_OK;) {
                int count;
                assert_int_equal(pm_transport_wait(transport, 0, &count), PM_OK);
                (void)pm_lockstep_coordinator_poll(later, c->now);
                status = pm_control_poll(control);
                turn(&t);
                assert_int_equal(pm_control_poll(t.control), PM_OK);
            }
            assert_int_equal(status, session == 0 ? PM_ENET : PM_OK);
            assert_true(session != 0 || strstr(pm_error(), "served already, by this one") != NULL);
            pm_control_close(control);
            pm_lockstep_coordinator_close(later);
            pm_transport_close(transport);
        }
        client_open(&k, &t, 5, "bench");
        k.request.session = 8;
        k.request.kind = PORTMET_CONTROL_T_QUERY;
        k.request.nonce = 1;
        publish(&k);
        turn_for(&t, 0.1);
        assert_int_equal(k.replies, 0);
        k.request.session = 0;
        assert_int_equal(ASK(&k, QUERY), DONE);
        pm_transport_close(k.transport);
        stage_close(&t);
    }
}

// --- death, and rest ---

// A process that dies ends the run, and the one that takes its place serves the next run.
static void test_next_run_after_a_death(void **context) {
    (void)context;
    stage t = {0};
    client k;
    stage_open(&t, 3, NULL);
    client_open(&k, &t, 5, "bench");
    assert_int_equal(ask(&k, PORTMET_CONTROL_T_START, false), ACCEPTED);
    for (int i = 0; i < 200; ++i) {
        turn(&t);
    }
    cluster_kill(&t.c, 1);
    turn_for(&t, 1);
    cluster_return(&t.c, 1);
    assert_int_equal(t.ended, 0);
    turn_for(&t, 3 * PATIENCE);
    assert_int_equal(t.ended, 1);
    assert_true(t.status == PM_ENET || t.status == PM_ETIMEOUT);
    assert_non_null(strstr(t.why, "link2"));
    k.request.steps = 8;
    assert_int_equal(ASK(&k, START), DONE);
    assert_int_equal(k.reply.code, PM_OK);
    assert_int_equal(t.c.steps_seen, 9);
    // A coordinator that dies: the processes wait for the next one.
    pm_control_close(t.control);
    cluster_kill(&t.c, 3);
    for (const double until = t.c.now + 3 * PATIENCE; t.c.now < until;) {
        cluster_turn(&t.c);
    }
    pm_monolithic_set_state(t.c.assembly, t.c.f.z); // the fixture's observer sees the state at rest
    t.c.steps_seen = 0;
    cluster_return(&t.c, 3);
    open_control(&t);
    assert_int_equal(ASK(&k, START), DONE);
    assert_int_equal(t.c.steps_seen, 9);
    pm_transport_close(k.transport);
    stage_close(&t);
}

static void count_message(void *context, const char *channel, const void *data, size_t size) {
    (void)channel, (void)data, (void)size;
    *(int *)context += 1;
}

static void test_rest_is_quiet(void **context) {
    (void)context;
    static const char *const channel[] = {
        "chain_TICK",    "chain_REQUEST_TICK",  "chain_HELLO",      "chain_HELLO_link1",
        "chain_REQUEST", "chain_REQUEST_link1", "chain_FLUX_link1", "chain_REPORT_link1"};
    stage t = {0};
    pm_transport *listener;
    int count = 0;
    stage_open(&t, 3, NULL);
    turn_for(&t, 1);
    assert_int_equal(pm_hub_connect(t.hub, &listener), PM_OK);
    for (size_t i = 0; i < sizeof channel / sizeof channel[0]; ++i) {
        assert_int_equal(pm_transport_subscribe(listener, channel[i], count_message, &count),
                         PM_OK);
    }
    turn_for(&t, 10);
    assert_int_equal(pm_transport_wait(listener, 0, NULL), PM_OK);
    assert_in_range(count, 9, 11); // ticks
    pm_transport_close(listener);
    stage_close(&t);
}

// test_control [MESSAGES]: the number of messages that a stranger sends.
int main(int argc, char **argv) {
    messages = argc > 1 ? atoi(argv[1]) : messages;
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_one_run_after_another), cmocka_unit_test(test_steps_on_demand),
        cmocka_unit_test(test_two_clients),           cmocka_unit_test(test_states_between_steps),
        cmocka_unit_test(test_wrong_requests),        cmocka_unit_test(test_strangers),
        cmocka_unit_test(test_two_services),          cmocka_unit_test(test_next_run_after_a_death),
        cmocka_unit_test(test_rest_is_quiet),         cmocka_unit_test(test_service_dies),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
