// Requests of clients: who asks, what is done, and what the reply says.
#include "lockstep/control.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lockstep/lookahead.h"
#include "store/snapshot.h"
#include "transport/channel.h"

#define CLIENTS 64      // that are remembered
#define NAME 64         // bytes of a client's name, and of a recording's, with the terminator
#define KEPT 8          // clients in the file of a run: those that asked last
#define PAGE_BYTES 1000 // of the description in a reply
#define MOST_NONCE (INT64_C(1) << 62)
#define UNANSWERED (-1)     // kind of a reply that is not due yet
#define SERVE_ASKS 3        // questions whether the scene is served already
#define SERVE_INTERVAL 0.05 // s from one to the next, and to the first request that is answered

typedef struct client {
    int64_t id;            // 0: free
    int64_t ticket, nonce; // of its last reply; of its last request
    int64_t used;          // requests of all clients when it last asked
    int64_t target;        // ADVANCE: steps when it is done
    int8_t kind;           // of its last request
    int8_t reply, code;    // of the reply to it
    bool waits;            // the request is not done
    char name[NAME];
    char text[PM_TEXT_MAX + 1];
} client;

struct pm_control {
    pm_arena arena;
    pm_lockstep_coordinator *coordinator;
    pm_control_service service;
    portmet_control_t request, largest; // being decoded; arrays and largest counts
    double *flux[4];     // [2 * nport] energy, entropy and both gross fluxes of a reply
    unsigned char *data; // [capacity] the encoded reply
    size_t capacity;
    char channel[PM_CHANNEL_SIZE]; // of replies
    pm_control_run run;            // the last one
    char owner[NAME], record[NAME];
    int64_t owner_id;      // the client that started it, which is not forgotten meanwhile
    double *numbers;       // those of a file, and before them a state and live inputs
    int64_t kept;          // step at which the file of the run was written; -1: it is to be written
    bool active, stopping; // a run is under way; it ends after the steps that are granted
    bool reloaded;         // the files are read again: the process that does so answers from now on
    int asks;              // questions left whether the scene is served already
    double ask_at;         // s, when the next one is due
    char requests[PM_CHANNEL_SIZE]; // channel of requests
    char other[NAME];               // the service that has answered; "": none
    int waiting;                    // clients that wait
    int64_t asked;                  // requests so far
    client client[CLIENTS];
};

// --- replies ---

// Publishes the reply `kind` to a request of the client. `pages` is not 0 for QUERY alone.
static void reply(pm_control *control, const client *to, int64_t nonce, int8_t kind, int8_t code,
                  const char *text, int pages) {
    const pm_lockstep_coordinator *c = control->coordinator;
    const pm_ledger *ledger = &c->ledger;
    const pm_physics *physics = &c->scene->physics;
    const int64_t step = c->completed < c->first ? c->first : c->completed;
    const bool with_state = pages == 0 && c->want_state && c->completed >= c->first &&
                            !pm_scene_may_report_sums(c->scene);
    const bool held = c->phase == PM_COORDINATOR_HELD;
    const int8_t phase = control->active
                             ? held ? PORTMET_CONTROL_REPLY_T_HELD : PORTMET_CONTROL_REPLY_T_RUNNING
                         : !held                   ? PORTMET_CONTROL_REPLY_T_GATHERING
                         : control->run.number > 0 ? PORTMET_CONTROL_REPLY_T_ENDED
                                                   : PORTMET_CONTROL_REPLY_T_IDLE;
    const portmet_control_reply_t message = {
        .client = to->id,
        .nonce = nonce,
        .ticket = to->ticket,
        .last = to->nonce,
        .kind = kind,
        .code = code,
        .phase = phase,
        .text = (char *)text,
        .pages = pages,
        .owner = control->owner,
        .session = c->endpoint.session,
        .run = control->run.number,
        .digest = (int64_t)c->endpoint.system->digest,
        .step = step,
        .steps = c->endpoint.steps == PM_STEPS_MAX ? 0 : c->endpoint.steps,
        .time = pm_scene_time(c->scene, (long)step),
        .dt = c->scene->physics.dt,
        .energy = ledger->energy,
        .entropy = ledger->entropy,
        .first_energy = ledger->first_energy,
        .first_entropy = ledger->first_entropy,
        .energy_drift = ledger->energy_drift,
        .entropy_fall = ledger->worst_entropy_fall,
        .outside_energy = ledger->outside_energy,
        .outside_entropy = ledger->outside_entropy,
        .energy_residual = ledger->worst_energy,
        .entropy_residual = ledger->worst_entropy,
        .violations = ledger->violations,
        .npart = with_state ? physics->nsubsystem : 0,
        .part_energy = c->last->energy,
        .part_entropy = c->last->entropy,
        .bulk_energy = c->last->bulk_energy,
        .bulk_entropy = c->last->bulk_entropy,
        .nend = with_state ? 2 * physics->nport : 0,
        .energy_flux = control->flux[0],
        .entropy_flux = control->flux[1],
        .energy_gross = control->flux[2],
        .entropy_gross = control->flux[3],
        .nz = with_state ? physics->nz : 0,
        .z = c->last->z,
    };
    for (int i = 0; i < message.nend; ++i) {
        const pm_flux *flux = &c->last->flux[i / 2][i % 2];
        message.energy_flux[i] = flux->energy;
        message.entropy_flux[i] = flux->entropy;
        message.energy_gross[i] = flux->energy_gross;
        message.entropy_gross[i] = flux->entropy_gross;
    }
    const size_t size = pm_control_reply_encode(&message, control->data, control->capacity);
    if (size > 0) { // a client that misses its reply asks again
        (void)pm_transport_publish(c->endpoint.transport, control->channel, control->data, size);
    }
}

static void reply_again(pm_control *control, const client *to) {
    const pm_lockstep_coordinator *c = control->coordinator;
    // A reply that something is done has a state, which is not known while processes come together.
    const bool pending = to->reply == UNANSWERED || (to->reply == PORTMET_CONTROL_REPLY_T_DONE &&
                                                     control->active && c->completed < c->first);
    // Steps that wait for a live input are held, as is a run whose steps are complete.
    const char *awaited = pending && control->active && c->phase == PM_COORDINATOR_HELD &&
                                  to->kind == PORTMET_CONTROL_T_ADVANCE
                              ? pm_live_inputs_awaited(&c->live)
                              : NULL;
    char text[PM_CHANNEL_SIZE + 80] = "";
    if (awaited != NULL) {
        snprintf(text, sizeof text, "the run waits after step %lld for a message on %s",
                 (long long)c->completed, awaited);
    }
    reply(control, to, to->nonce, pending ? PORTMET_CONTROL_REPLY_T_PENDING : to->reply, to->code,
          pending ? text : to->text, 0);
}

static void keep_run(pm_control *control);

// Ends the wait of a client.
static void settle(pm_control *control, client *to, int8_t kind, pm_status code, const char *text) {
    control->waiting -= to->waits;
    to->waits = false;
    to->reply = kind;
    to->code = (int8_t)code;
    snprintf(to->text, sizeof to->text, "%s", text);
    keep_run(control);
    reply_again(control, to);
}

static void wait_for(pm_control *control, client *to) {
    control->waiting += !to->waits;
    to->waits = true;
}

// --- what is asked ---

// Checks the name of a file in the folder of the service.
static pm_status check_name(const pm_control *control, const char *name) {
    // A name without slashes, which is not hidden, leads to no other folder.
    static const char allowed[] =
        "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
    const size_t length = strlen(name);
    if (length >= NAME || name[0] == '.' || strspn(name, allowed) != length) {
        return pm_fail(PM_EUSAGE, "a name: expected letters, digits and \"._-\", at most %d",
                       NAME - 1);
    }
    return control->service.path != NULL
               ? PM_OK
               : pm_fail(PM_EUSAGE,
                         "portmetd serve was given no folder for recordings and checkpoints "
                         "(--record DIR)");
}

// Begins a run, or takes the present one to another state: to its start, or with `from` to the
// state r->z at that step. `set` tells that somebody has set this state.
static pm_status begin(pm_control *control, client *from_client, const portmet_control_t *r,
                       const pm_lockstep_point *from, bool set) {
    pm_lockstep_coordinator *c = control->coordinator;
    pm_control_run *run = &control->run;
    const bool starts = r->kind == PORTMET_CONTROL_T_START;
    pm_lockstep_observer observer = c->observer;
    if (starts && control->active) {
        return pm_fail(PM_EUSAGE, "run %lld of %s is under way, after step %lld: stop it first",
                       (long long)run->number, control->owner, (long long)c->completed);
    }
    if (!c->stays) {
        return pm_fail(PM_EUSAGE, "this run keeps its states: portmetd serve can change them");
    }
    if (r->nz != 0 && r->nz != c->scene->physics.nz) {
        return pm_fail(PM_EUSAGE, "a state of %d numbers, expected %d", r->nz,
                       c->scene->physics.nz);
    }
    if (r->nlive != 0 && r->nlive != c->scene->network.nlive) {
        return pm_fail(PM_EUSAGE, "%d live inputs, expected %d", r->nlive, c->scene->network.nlive);
    }
    if (r->steps < 0 || r->steps >= PM_STEPS_MAX) {
        return pm_fail(PM_EUSAGE, "%lld steps, at most %lld", (long long)r->steps,
                       (long long)PM_STEPS_MAX - 1);
    }
    if (starts && r->file[0] != 0) {
        PM_TRY(check_name(control, r->file));
    }
    if (!starts && !set && control->record[0] != 0) {
        return pm_fail(PM_EUSAGE,
                       "a run that is recorded cannot go back: stop it, and start another");
    }
    if (starts) {
        pm_control_run next = {
            .number = run->number + 1,
            .steps = r->steps,
            .pace = r->pace == 0 ? c->scene->run.pace : r->pace,
            .held = r->held != 0,
            .from_client = r->nz > 0,
            .from = -1,
            .owner = from_client->name,
            .record = r->file,
        };
        PM_TRY(control->service.begin(control->service.context, &next, &observer));
        control->owner_id = from_client->id;
        snprintf(control->owner, sizeof control->owner, "%s", next.owner);
        snprintf(control->record, sizeof control->record, "%s", next.record);
        next.owner = control->owner;
        next.record = control->record;
        *run = next;
    }
    const pm_lockstep_order order = {
        .steps = run->steps,
        .z = r->nz > 0 ? r->z : NULL,
        .from = from,
        .from_outside = set,
        .pace = run->pace,
        .want_state = run->record[0] != 0 || !pm_scene_may_report_sums(c->scene),
        .observer = observer,
    };
    // Inputs that are restored hold as they did: until the next step, if messages brought them.
    const bool kept =
        r->kind == PORTMET_CONTROL_T_RESTORE && r->nlive > 0 && !c->live.channel[0].set;
    pm_lockstep_coordinator_begin(c, &order);
    if (r->nlive > 0) {
        pm_live_inputs_set(&c->live, r->live, kept);
    }
    if (r->held || set) {
        pm_lockstep_coordinator_hold(c, c->first);
    }
    run->session = c->endpoint.session;
    control->active = true;
    control->stopping = false;
    control->kept = -1;
    wait_for(control, from_client);
    return PM_OK;
}

// --- states that are kept ---

// Lists the numbers of a file: where the run is, its ledger, its state z [nz] and the values of its
// live inputs [nlive].
static void list(pm_serializer *serializer, pm_lockstep_point *point, int nz, double *z, int nlive,
                 double *live) {
    long step = (long)point->step;
    pm_serializer_put_long(serializer, "step", &step);
    point->step = step;
    pm_serializer_put_int(serializer, "substeps", &point->substeps);
    pm_serializer_put(serializer, "expected error", &point->expected_error, 1);
    pm_ledger_record(&point->ledger, serializer);
    pm_serializer_put(serializer, "z", z, nz);
    pm_serializer_put(serializer, "live inputs", live, nlive);
}

static pm_lockstep_point present(const pm_lockstep_coordinator *c) {
    return (pm_lockstep_point){.step = c->completed,
                               .ledger = c->ledger,
                               .substeps = c->step_controller.substeps,
                               .expected_error = c->step_controller.expected};
}

// CHECKPOINT keeps the state of a run that is held, and RESTORE takes the run to it.
static pm_status keep_or_restore(pm_control *control, client *from, const portmet_control_t *r) {
    pm_lockstep_coordinator *c = control->coordinator;
    pm_lockstep_point point = present(c);
    const int nz = c->scene->physics.nz, nlive = c->scene->network.nlive;
    double *live = control->numbers, *z = live + nlive, *number = z + nz;
    char path[1024];
    int64_t session = c->endpoint.session;
    bool found;
    PM_TRY(check_name(control, r->file[0] == 0 ? "/" : r->file));
    PM_TRY(control->service.path(control->service.context, r->file, ".state", path, sizeof path));
    if (!c->want_state) {
        return pm_fail(PM_EUSAGE, "scene %s is too large: its states are not known here",
                       c->scene->name);
    }
    memcpy(live, pm_live_inputs_values(&c->live, c->completed - 1), (size_t)nlive * sizeof *live);
    pm_serializer serializer = pm_serializer_save("control", number);
    list(&serializer, &point, nz, c->last->z, nlive, live);
    char owner[PM_SNAPSHOT_OWNER];
    snprintf(owner, sizeof owner, "clients of scene %s", c->scene->name);
    const pm_snapshot_key key = {c->endpoint.system->digest, serializer.layout, serializer.count,
                                 owner};
    if (r->kind == PORTMET_CONTROL_T_CHECKPOINT) {
        // Another kind of file is not replaced.
        PM_TRY(pm_snapshot_session(path, &key, &session, &found));
        return pm_snapshot_save(path, &key, c->endpoint.session, number);
    }
    PM_TRY(pm_snapshot_load(path, &key, &session, number, &found));
    if (!found) {
        return pm_fail(PM_EFILE, "nothing is kept as %s", r->file);
    }
    serializer = pm_serializer_restore("control", number);
    list(&serializer, &point, nz, z, nlive, live);
    if (point.step < 0 || point.step > c->endpoint.steps || point.step >= PM_STEPS_MAX) {
        return pm_fail(PM_EUSAGE, "%s is after step %lld, and the run has %lld", r->file,
                       (long long)point.step, (long long)c->endpoint.steps);
    }
    const portmet_control_t state = {
        .kind = r->kind, .held = r->held, .nz = nz, .z = z, .nlive = nlive, .live = live};
    return begin(control, from, &state, &point, false);
}

// --- a run that outlives its service ---

// Lists a number that a double may not hold.
static void list_id(pm_serializer *serializer, const char *name, int64_t *id) {
    double half[2] = {(double)(*id >> 32), (double)(*id & 0xffffffff)};
    pm_serializer_put(serializer, name, half, 2);
    *id = (int64_t)((uint64_t)(int64_t)half[0] << 32 | (uint64_t)half[1]);
}

static void list_text(pm_serializer *serializer, const char *name, char *text) {
    for (int i = 0; i < NAME; ++i) {
        int byte = (unsigned char)text[i];
        pm_serializer_put_int(serializer, name, &byte);
        text[i] = (char)byte;
    }
}

static void list_small(pm_serializer *serializer, const char *name, int8_t *value) {
    double number = *value;
    pm_serializer_put(serializer, name, &number, 1);
    *value = (int8_t)number;
}

// Lists the run, if there is one, and the requests and replies of the clients that asked last.
static void list_run(pm_control *control, pm_serializer *serializer, pm_lockstep_point *point) {
    pm_lockstep_coordinator *c = control->coordinator;
    const int nz = c->scene->physics.nz, nlive = c->scene->network.nlive;
    double *live = control->numbers, *z = live + nlive;
    int8_t active = control->active, stopping = control->stopping;
    client *order[CLIENTS];
    list(serializer, point, nz, z, nlive, live);
    list_small(serializer, "active", &active);
    list_small(serializer, "stopping", &stopping);
    control->active = active != 0;
    control->stopping = stopping != 0;
    list_id(serializer, "number", &control->run.number);
    list_id(serializer, "steps", &control->run.steps);
    list_id(serializer, "hold", &c->hold_at);
    pm_serializer_put(serializer, "pace", &control->run.pace, 1);
    list_id(serializer, "owner", &control->owner_id);
    list_text(serializer, "owner", control->owner);
    list_text(serializer, "record", control->record);
    for (int i = 0; i < CLIENTS; ++i) { // the latest first
        int k = i;
        for (; k > 0 && order[k - 1]->used < control->client[i].used; --k) {
            order[k] = order[k - 1];
        }
        order[k] = &control->client[i];
    }
    for (int i = 0; i < KEPT; ++i) {
        client *k = order[i];
        int8_t waits = k->waits;
        list_id(serializer, "client", &k->id);
        list_id(serializer, "ticket", &k->ticket);
        list_id(serializer, "nonce", &k->nonce);
        list_id(serializer, "target", &k->target);
        list_small(serializer, "kind", &k->kind);
        list_small(serializer, "reply", &k->reply);
        list_small(serializer, "code", &k->code);
        list_small(serializer, "waits", &waits);
        k->waits = waits != 0;
    }
}

static pm_snapshot_key key_of(const pm_control *control, const pm_serializer *serializer) {
    return (pm_snapshot_key){control->coordinator->endpoint.system->digest, serializer->layout,
                             serializer->count, "a service"};
}

// Writes the file of the run, after its recording. A run whose file cannot be written goes on.
static void keep_run(pm_control *control) {
    pm_lockstep_coordinator *c = control->coordinator;
    pm_lockstep_point point = present(c);
    const int nz = c->scene->physics.nz, nlive = c->scene->network.nlive;
    double *z = control->numbers + nlive, *number = z + nz;
    if (control->service.checkpoint == NULL || !c->want_state ||
        (control->active && c->completed < c->first)) {
        return;
    }
    memcpy(z, c->last->z, (size_t)nz * sizeof *z);
    if (control->active && c->observer.flush != NULL) {
        (void)c->observer.flush(c->observer.context);
    }
    pm_serializer serializer = pm_serializer_save("service", number);
    list_run(control, &serializer, &point);
    const pm_snapshot_key key = key_of(control, &serializer);
    (void)pm_snapshot_save(control->service.checkpoint, &key, c->endpoint.session, number);
    control->kept = c->completed;
}

static bool needs_hold(const portmet_control_t *r) {
    return r->kind == PORTMET_CONTROL_T_ADVANCE || r->kind == PORTMET_CONTROL_T_CHECKPOINT ||
           (r->kind == PORTMET_CONTROL_T_SET && r->nz > 0);
}

// Takes the live inputs of a request.
static pm_status set_inputs(pm_lockstep_coordinator *c, const portmet_control_t *r) {
    if (r->nlive == 0 || r->nlive != c->scene->network.nlive) {
        return pm_fail(PM_EUSAGE, "%d live inputs, and the scene has %d", r->nlive,
                       c->scene->network.nlive);
    }
    pm_live_inputs_set(&c->live, r->live, false);
    return PM_OK;
}

// Does what a request asks for. The client then waits, or the request is done.
static pm_status execute(pm_control *control, client *from, const portmet_control_t *r) {
    pm_lockstep_coordinator *c = control->coordinator;
    if (r->kind == PORTMET_CONTROL_T_START) {
        return begin(control, from, r, NULL, false);
    }
    if (r->kind == PORTMET_CONTROL_T_RELOAD) {
        if (control->active) {
            return pm_fail(PM_EUSAGE, "run %lld of %s is under way: stop it first",
                           (long long)control->run.number, control->owner);
        }
        const pm_status status = control->service.reload(control->service.context);
        control->reloaded = status == PM_OK;
        return status;
    }
    if (!control->active) {
        return r->kind == PORTMET_CONTROL_T_STOP ? PM_OK
                                                 : pm_fail(PM_EUSAGE, "no run is under way");
    }
    if (needs_hold(r) && (c->phase != PM_COORDINATOR_HELD || c->hold_at > c->granted)) {
        return pm_fail(PM_EUSAGE, "the run goes on, after step %lld: pause it first",
                       (long long)c->completed);
    }
    switch (r->kind) {
    case PORTMET_CONTROL_T_STOP:
        control->stopping = true;
        // fall through
    case PORTMET_CONTROL_T_PAUSE:
        pm_lockstep_coordinator_hold(c, c->granted);
        wait_for(control, from);
        return PM_OK;
    case PORTMET_CONTROL_T_RESUME:
        control->stopping = false;
        pm_lockstep_coordinator_hold(c, r->steps > 0 ? r->steps : INT64_MAX);
        return PM_OK;
    case PORTMET_CONTROL_T_ADVANCE:
        if (r->steps < 1) {
            return pm_fail(PM_EUSAGE, "%lld steps, at least 1", (long long)r->steps);
        }
        PM_TRY(r->nlive == 0 ? PM_OK : set_inputs(c, r));
        from->target = c->endpoint.steps - c->completed > r->steps ? c->completed + r->steps
                                                                   : c->endpoint.steps;
        pm_lockstep_coordinator_hold(c, from->target);
        wait_for(control, from);
        return PM_OK;
    case PORTMET_CONTROL_T_SET:
        if (r->nz > 0) {
            const pm_lockstep_point point = present(c);
            portmet_control_t state = *r;
            state.steps = 0;
            return begin(control, from, &state, &point, true);
        }
        return set_inputs(c, r);
    case PORTMET_CONTROL_T_RESET:
        return begin(control, from, r, NULL, false);
    default:
        return keep_or_restore(control, from, r);
    }
}

// --- who asks ---

// Publishes SERVE or SERVED: between services of the same scene.
static void tell_service(pm_control *control, int8_t kind, int64_t to, int64_t nonce) {
    const portmet_control_t message = {.kind = kind,
                                       .session = control->service.session,
                                       .client = to,
                                       .nonce = nonce,
                                       .sender = (char *)control->service.name,
                                       .file = ""};
    const size_t size = pm_control_encode(&message, control->data, control->capacity);
    if (size > 0) {
        (void)pm_transport_publish(control->coordinator->endpoint.transport, control->requests,
                                   control->data, size);
    }
}

// Returns the number of this service's question, which nobody can guess.
static int64_t own_nonce(const pm_control *control) {
    return (control->coordinator->endpoint.identity.hello.nonce & (MOST_NONCE - 1)) | 1;
}

static pm_drop on_control(void *context, const void *data, size_t size) {
    pm_control *control = context;
    const pm_lockstep_coordinator *c = control->coordinator;
    portmet_control_t *r = &control->request;
    *r = control->largest;
    PM_TRY_KEEP(pm_control_decode(r, data, size));
    if (r->client == 0 || r->nonce < 1 || r->nonce > MOST_NONCE ||
        r->kind < PORTMET_CONTROL_T_QUERY || r->kind > PORTMET_CONTROL_T_SERVED || r->page < 0) {
        return PM_DROP_IMPLAUSIBLE;
    }
    if (r->session != control->service.session) {
        return PM_DROP_SESSION; // to another service of this scene
    }
    // Services ask, and the one that is older answers.
    const int64_t own = c->endpoint.identity.hello.instance;
    if (r->kind == PORTMET_CONTROL_T_SERVED) {
        if (r->client == own && r->nonce == own_nonce(control) &&
            control->run.number <= !c->stays) {
            snprintf(control->other, sizeof control->other, "%s",
                     r->sender[0] == 0 ? "another" : r->sender);
        }
        return PM_KEEP;
    }
    if (r->kind == PORTMET_CONTROL_T_SERVE) {
        if (r->client != own && (control->asks == 0 || r->client > own) && control->other[0] == 0) {
            tell_service(control, PORTMET_CONTROL_T_SERVED, r->client, r->nonce);
        }
        return PM_KEEP;
    }
    // Clients are not answered, and ask again, until no other service of the scene can be there.
    if (control->asks > 0 || control->other[0] != 0) {
        return PM_DROP_RANGE;
    }
    // The client takes the place of the one that has been silent for longest and does not wait.
    client *from = NULL;
    for (client *k = control->client; k < control->client + CLIENTS; ++k) {
        const bool known = from != NULL && from->id == r->client;
        const bool kept = k->waits || (control->active && k->id == control->owner_id);
        if (k->id == r->client || (!known && !kept && (from == NULL || k->used < from->used))) {
            from = k;
        }
    }
    if (from == NULL) {
        return PM_DROP_RANGE;
    }
    if (from->id != r->client) {
        *from = (client){.id = r->client, .ticket = pm_lockstep_session(), .reply = UNANSWERED};
    }
    from->used = ++control->asked;
    if (control->reloaded && r->nonce != from->nonce) {
        return PM_DROP_RANGE;
    }
    if (r->kind == PORTMET_CONTROL_T_QUERY) {
        const char *text = control->service.description;
        const size_t length = strlen(text), at = (size_t)r->page * PAGE_BYTES;
        char page[PAGE_BYTES + 1];
        snprintf(page, sizeof page, "%s", at < length ? text + at : "");
        reply(control, from, r->nonce, PORTMET_CONTROL_REPLY_T_DONE, 0, page,
              (int)(length / PAGE_BYTES) + 1);
        return PM_KEEP;
    }
    if (r->nonce == from->nonce) {
        reply_again(control, from);
        return PM_DROP_REPEATED;
    }
    // An older request is a repeated one, unless somebody forged a newer one meanwhile. Its client,
    // if it still waits, asks again.
    if (r->nonce < from->nonce || r->ticket != from->ticket) {
        reply(control, from, r->nonce, PORTMET_CONTROL_REPLY_T_AGAIN, 0, "", 0);
        return r->ticket != from->ticket ? PM_DROP_SESSION : PM_DROP_REPEATED;
    }
    // While the processes come together nothing can begin, no run of a service that died goes on,
    // and none is held yet. The client asks again.
    const bool apart = c->completed < c->first && needs_hold(r);
    if ((!control->active || c->waits || apart) && c->phase != PM_COORDINATOR_HELD) {
        return PM_DROP_RANGE;
    }
    control->waiting -= from->waits;
    from->waits = false;
    from->reply = UNANSWERED;
    from->code = PM_OK; // that of an earlier request may be another one
    from->nonce = r->nonce;
    from->kind = r->kind;
    snprintf(from->name, sizeof from->name, "%s", r->sender);
    const pm_status status =
        strcmp(r->sender, "view") == 0 && !control->service.views
            ? pm_fail(PM_EUSAGE, "the service was started without --control view")
            : execute(control, from, r);
    if (status != PM_OK) {
        settle(control, from, PORTMET_CONTROL_REPLY_T_REFUSED, status, pm_error());
    } else if (!from->waits) {
        settle(control, from, PORTMET_CONTROL_REPLY_T_DONE, PM_OK, "");
    } else {
        keep_run(control);
    }
    return PM_KEEP;
}

// --- what is done ---

// Everybody who waits learns how the run ended.
static void tell_all(pm_control *control, pm_status status, const char *text) {
    for (int i = 0; i < CLIENTS; ++i) {
        if (control->client[i].waits) {
            settle(control, &control->client[i], PORTMET_CONTROL_REPLY_T_DONE, status, text);
        }
    }
}

static void end_run(pm_control *control, pm_status status, const char *message) {
    pm_lockstep_coordinator *c = control->coordinator;
    char text[PM_TEXT_MAX + 1];
    control->active = false;
    snprintf(text, sizeof text, "%s", message);
    if (c->stays) {
        c->observer = (pm_lockstep_observer){0}; // it is gone after this call
        status = control->service.end(control->service.context, &control->run, c->completed, status,
                                      message);
        snprintf(text, sizeof text, "%s", status == PM_OK ? "" : pm_error());
    }
    tell_all(control, status, text);
    keep_run(control);
}

// Goes on with the run that the file keeps, if there is one of the same scene and weights.
static void go_on(pm_control *control) {
    pm_lockstep_coordinator *c = control->coordinator;
    pm_lockstep_point point = present(c);
    const int nz = c->scene->physics.nz, nlive = c->scene->network.nlive;
    double *z = control->numbers + nlive, *number = z + nz;
    const char *path = control->service.checkpoint;
    int64_t session;
    bool found = false;
    pm_serializer serializer = pm_serializer_count("service");
    list_run(control, &serializer, &point);
    const pm_snapshot_key key = key_of(control, &serializer);
    if (path == NULL || pm_snapshot_load(path, &key, &session, number, &found) != PM_OK || !found) {
        return; // a file of another scene will be replaced
    }
    const int64_t idle = c->hold_at;
    serializer = pm_serializer_restore("service", number);
    list_run(control, &serializer, &point);
    const int64_t hold = c->hold_at;
    c->hold_at = idle;
    for (int i = 0; i < CLIENTS; ++i) {
        control->waiting += control->client[i].waits;
    }
    if (!control->active) {
        return;
    }
    pm_control_run *run = &control->run;
    run->from = point.step;
    run->owner = control->owner;
    run->record = control->record;
    pm_lockstep_order order = {.steps = run->steps,
                               .z = z,
                               .from = &point,
                               .pace = run->pace,
                               .want_state = true,
                               .observer = c->observer};
    pm_status status = control->service.begin(control->service.context, run, &order.observer);
    if (status != PM_OK) {
        control->active = false;
        tell_all(control, status, pm_error());
        return;
    }
    pm_lockstep_coordinator_begin(c, &order);
    c->hold_at = hold;
    c->waits = true; // the processes still belong to the service that died
    run->session = c->endpoint.session;
    if (order.observer.resume != NULL) {
        status = order.observer.resume(order.observer.context, (long)point.step);
    }
    if (status != PM_OK) {
        end_run(control, status, pm_error());
    }
}

pm_status pm_control_poll(pm_control *control) {
    pm_lockstep_coordinator *c = control->coordinator;
    if (control->other[0] != 0) {
        return c->stays || c->was_held
                   ? pm_fail(PM_ENET,
                             "scene %s is served already, by %s: give this one another --session",
                             c->scene->name, control->other)
                   : PM_OK;
    }
    if (control->asks > 0 && c->endpoint.now >= control->ask_at) {
        control->ask_at = c->endpoint.now + SERVE_INTERVAL;
        control->asks -= 1;
        tell_service(control, PORTMET_CONTROL_T_SERVE, c->endpoint.identity.hello.instance,
                     own_nonce(control));
        if (control->asks == 0 && c->stays) {
            go_on(control);
        }
    }
    const bool held = c->phase == PM_COORDINATOR_HELD;
    if (control->active && c->phase >= PM_COORDINATOR_CLOSING) {
        end_run(control, c->endpoint.status, c->endpoint.message);
    } else if (control->active && held &&
               (c->completed >= c->endpoint.steps || control->stopping)) {
        end_run(control, PM_OK, "");
        if (!c->stays) {
            pm_lockstep_coordinator_fail(c, PM_OK, "");
        }
    }
    if (control->active && c->completed >= c->first) {
        c->waits = false;
        if (control->kept < 0 || c->completed - control->kept >= pm_checkpoint_interval(c->scene)) {
            keep_run(control);
        }
    }
    for (int i = 0; i < CLIENTS && control->waiting > 0; ++i) {
        client *k = &control->client[i];
        if (!k->waits || c->completed < c->first) {
            continue;
        }
        const bool starts = k->kind == PORTMET_CONTROL_T_START;
        const bool advances = k->kind == PORTMET_CONTROL_T_ADVANCE;
        if (starts && k->reply == UNANSWERED) {
            k->reply = PORTMET_CONTROL_REPLY_T_ACCEPTED;
            reply_again(control, k);
        } else if (k->kind == PORTMET_CONTROL_T_RESET || k->kind == PORTMET_CONTROL_T_RESTORE ||
                   (advances ? c->completed >= k->target : held && !starts)) {
            settle(control, k, PORTMET_CONTROL_REPLY_T_DONE, PM_OK, "");
        }
    }
    return PM_OK;
}

// --- opening ---

pm_status pm_control_open(pm_control **control, pm_lockstep_coordinator *coordinator,
                          const pm_control_service *service) {
    const pm_scene *scene = coordinator->scene;
    pm_status status;
    pm_control *made = NULL;
    PM_TRY(PM_NEW(made, "control"));
    made->coordinator = coordinator;
    made->service = *service;
    made->asks = SERVE_ASKS + 1; // the last one ends the wait for an answer
    made->kept = -1;
    made->active = !coordinator->stays;
    if (made->active) {      // a run that has started itself
        made->owner_id = -1; // no client: 0 is one that is free
        made->run = (pm_control_run){.number = 1, .session = coordinator->endpoint.session};
        snprintf(made->owner, sizeof made->owner, "%s", service->name);
    }
    made->largest = (portmet_control_t){.nz = scene->physics.nz, .nlive = scene->network.nlive};
    const portmet_control_reply_t longest = {.npart = scene->physics.nsubsystem,
                                             .nend = 2 * scene->physics.nport,
                                             .nz = scene->physics.nz,
                                             .text = "",
                                             .owner = ""};
    for (int i = 0; i < 4; ++i) {
        made->flux[i] = pm_arena_array(&made->arena, (size_t)longest.nend, sizeof(double));
    }
    pm_serializer serializer = pm_serializer_count("control");
    made->numbers = pm_arena_array(&made->arena, // for the arrays that are listed
                                   (size_t)scene->physics.nz + (size_t)scene->network.nlive,
                                   sizeof *made->numbers);
    list_run(made, &serializer, &(pm_lockstep_point){0});
    made->numbers = pm_arena_array(&made->arena,
                                   (size_t)scene->physics.nz + (size_t)scene->network.nlive +
                                       (size_t)serializer.count,
                                   sizeof *made->numbers);
    made->capacity = pm_control_reply_size(&longest) + PM_TEXT_MAX + NAME;
    made->data = pm_arena_alloc(&made->arena, made->capacity);
    PM_TRY_DONE(pm_arena_status(&made->arena, "control"));
    PM_TRY_DONE(pm_control_alloc(&made->largest, &made->arena));
    PM_TRY_DONE(pm_channel_scene(made->channel, scene->name, "REPLY"));
    PM_TRY_DONE(pm_channel_scene(made->requests, scene->name, "CONTROL"));
    PM_TRY_DONE(pm_endpoint_subscribe(&coordinator->endpoint, made->requests, on_control, made));
    *control = made;
    return PM_OK;
done:
    pm_control_close(made);
    return status;
}

void pm_control_close(pm_control *control) {
    if (control != NULL) {
        pm_arena_free(&control->arena);
        free(control);
    }
}
