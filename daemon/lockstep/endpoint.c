// Hellos, answers to hellos and refusals; the intervals between requests (exponential back-off, a
// running median of waiting times, and a token bucket); the messages that all processes receive.
#include "lockstep/endpoint.h"

#include <stdio.h>
#include <string.h>
#include <sys/random.h>
#include <time.h>

#include "lockstep/lookahead.h"
#include "transport/channel.h"

// Another thread (LCM's) may receive the signal, which then does not wake this one.
#define STOP_INTERVAL 0.1 // s between two readings of the stop flag, at most
#define LONGEST_WAIT 30.0 // s between them while nothing is to be done for a long time
#define LONG_WAIT 2.0     // s, a long time

// --- identity ---

// A random number that is not 0. The time is good enough if the system has no better one.
static int64_t draw(void) {
    uint64_t bits;
    if (getrandom(&bits, sizeof bits, GRND_NONBLOCK) != (ssize_t)sizeof bits) {
        struct timespec now;
        clock_gettime(CLOCK_REALTIME, &now);
        bits = (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
    }
    return (int64_t)(bits | 1);
}

// Makes the hello and the channel names of an instance.
static pm_status make_identity(pm_identity *identity, const pm_system *system, const char *name,
                               int64_t session, bool keeps_checkpoints, pm_transport *transport) {
    struct timespec now;
    int64_t protocol = 0; // the sum of the fingerprints of all message types except hello_t
    clock_gettime(CLOCK_REALTIME, &now);
    for (int i = 0; pm_wire_types[i] != NULL; ++i) {
        const int64_t fingerprint = pm_wire_types[i]->fingerprint();
        protocol = (int64_t)((uint64_t)protocol +
                             (pm_wire_types[i] == &pm_hello_type ? 0 : (uint64_t)fingerprint));
    }
    identity->transport = transport;
    identity->hello = (portmet_hello_t){
        .protocol = protocol,
        .session = session,
        .instance = (int64_t)now.tv_sec * 1000000000 + now.tv_nsec,
        .nonce = draw(),
        .digest = (int64_t)system->digest,
        .checkpoint = keeps_checkpoints ? pm_checkpoint_interval(system->scene) : 0,
        .sender = (char *)name,
    };
    PM_TRY(pm_channel_hello(identity->hello_channel, system->scene, name));
    return pm_channel_scene(identity->command_channel, system->scene->name, "COMMAND");
}

pm_status pm_identity_publish_hello(const pm_identity *identity) {
    unsigned char data[96 + PM_CHANNEL_SIZE];
    const size_t size = pm_hello_encode(&identity->hello, data, sizeof data);
    return pm_transport_publish(identity->transport, identity->hello_channel, data, size);
}

void pm_identity_renew(pm_identity *identity) {
    identity->answered = identity->hello.nonce;
    identity->hello.nonce = draw();
}

bool pm_identity_is_rival(const pm_identity *identity, const portmet_hello_t *hello) {
    const portmet_hello_t *own = &identity->hello;
    return strcmp(own->sender, hello->sender) == 0 && own->session == hello->session &&
           own->instance != hello->instance;
}

bool pm_identity_is_older(const pm_identity *identity, int64_t instance) {
    return identity->hello.instance < instance;
}

pm_status pm_identity_publish_command(const pm_identity *identity, portmet_command_t command) {
    unsigned char data[96 + PM_TEXT_MAX];
    command.instance = identity->hello.instance;
    const size_t size = pm_command_encode(&command, data, sizeof data);
    return pm_transport_publish(identity->transport, identity->command_channel, data, size);
}

bool pm_identity_is_proven(const pm_identity *identity, const portmet_command_t *command) {
    return command->addressee == identity->hello.instance && command->answer != 0 &&
           (command->answer == identity->hello.nonce || command->answer == identity->answered);
}

// --- waiting ---

// With every wait the median estimate rises or falls by this fraction of itself, independent of the
// length of the wait. A few long waits for lost messages therefore hardly move it.
#define RATE 0.0625

static double clamp(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

void pm_waiting_init(pm_waiting *waiting, int processes, int alike) {
    const double n = processes, longer = PM_WAITING_EACH * n + PM_WAITING_PAIR * n * n;
    const double first = clamp(longer, PM_WAITING_FIRST, PM_WAITING_MOST);
    *waiting = (pm_waiting){.first = first,
                            .last = clamp(2 * first, PM_WAITING_LAST, 2 * PM_WAITING_MOST),
                            .refill = PM_WAITING_REFILL * alike,
                            .credit = 1};
}

void pm_waiting_start(pm_waiting *waiting, double now) {
    const double high = waiting->first / PM_WAITING_FACTOR;
    const double moved =
        waiting->usual * (now - waiting->since > waiting->usual ? 1 + RATE : 1 - RATE);
    waiting->usual = waiting->usual == 0
                         ? high // none was measured
                         : clamp(moved, PM_WAITING_SOONEST / PM_WAITING_FACTOR, high);
    waiting->since = now;
    waiting->interval =
        waiting->cautious_waits > 0 ? PM_WAITING_FACTOR * waiting->usual : waiting->first;
    waiting->cautious_waits -= waiting->cautious_waits > 0;
    waiting->next = now + waiting->interval;
}

void pm_waiting_note_used(pm_waiting *waiting) {
    waiting->credit = clamp(waiting->credit + PM_WAITING_SHARE, waiting->credit, PM_WAITING_CREDIT);
}

bool pm_waiting_request_due(pm_waiting *waiting, double now) {
    if (now < waiting->next) {
        return false;
    }
    // The credit grows with time.
    const double more = waiting->credited > 0 ? (now - waiting->credited) / waiting->refill : 0;
    waiting->credit = clamp(waiting->credit + more, waiting->credit, PM_WAITING_CREDIT);
    waiting->credited = now;
    if (waiting->credit < 1) {
        waiting->next = now + (1 - waiting->credit) * waiting->refill + PM_WAITING_SOONEST;
        return false;
    }
    waiting->interval *= 2;
    if (waiting->interval > waiting->last) {
        waiting->interval = waiting->last;
    }
    waiting->next = now + waiting->interval;
    waiting->cautious_waits = PM_WAITING_LATELY;
    return true;
}

void pm_waiting_note_requests(pm_waiting *waiting, int count) {
    waiting->credit -= count;
}

bool pm_waiting_is_over(const pm_waiting *waiting, double heard, double patience, double now) {
    return now - waiting->since > patience && now - heard > patience;
}

// --- the endpoint ---

void pm_endpoint_look(pm_endpoint *endpoint, double clock) {
    endpoint->now = pm_presence_look(&endpoint->presence, clock);
}

double pm_endpoint_clock(const pm_endpoint *endpoint, double time) {
    return time + endpoint->presence.absent;
}

// A channel and its handler.
typedef struct subscription {
    pm_endpoint *endpoint;
    pm_endpoint_handler *handler;
    void *context;
} subscription;

static void deliver(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    const subscription *s = context;
    s->endpoint->drops.count[s->handler(s->context, data, size)] += 1;
}

pm_status pm_endpoint_subscribe(pm_endpoint *endpoint, const char *channel,
                                pm_endpoint_handler *handler, void *context) {
    subscription *s = pm_arena_alloc(endpoint->arena, sizeof *s);
    PM_TRY(pm_arena_status(endpoint->arena, "channel %s", channel));
    *s = (subscription){endpoint, handler, context};
    return pm_transport_subscribe(endpoint->transport, channel, deliver, s);
}

pm_status pm_endpoint_open(pm_endpoint *endpoint, const pm_handlers *handlers, void *context,
                           const char *name, int64_t asked, bool keeps_checkpoints) {
    const pm_scene *scene = endpoint->system->scene;
    pm_transport *transport = endpoint->transport;
    char own_address[PM_CHANNEL_SIZE], coordinators[PM_CHANNEL_SIZE];
    pm_waiting_init(&endpoint->waiting, scene->network.nprocess,
                    name[0] == 0 ? 1 : scene->network.nprocess);
    PM_TRY(make_identity(&endpoint->identity, endpoint->system, name, asked, keeps_checkpoints,
                         transport));
    PM_TRY(pm_channel_scene(endpoint->tick_channel, scene->name, "TICK"));
    PM_TRY(pm_channel_scene(endpoint->request_channel, scene->name, "REQUEST"));
    PM_TRY(pm_channel_request(endpoint->coordinator_address, scene, ""));
    PM_TRY(pm_channel_request(own_address, scene, name));
    PM_TRY(pm_channel_hello(coordinators, scene, ""));
    PM_TRY(pm_endpoint_subscribe(endpoint, coordinators, handlers->hello, context));
    if (name[0] != 0) { // rivals
        PM_TRY(pm_endpoint_subscribe(endpoint, endpoint->identity.hello_channel, handlers->hello,
                                     context));
    }
    PM_TRY(pm_endpoint_subscribe(endpoint, endpoint->identity.command_channel, handlers->command,
                                 context));
    PM_TRY(pm_endpoint_subscribe(endpoint, own_address, handlers->request, context));
    return pm_endpoint_subscribe(endpoint, endpoint->request_channel, handlers->request, context);
}

pm_status pm_endpoint_request(pm_endpoint *endpoint, const char *address, const char *channel,
                              int64_t step, int round) {
    const portmet_request_t message = {
        .session = endpoint->session,
        .sender = endpoint->identity.hello.sender,
        .instance = endpoint->identity.hello.instance,
        .attempt = endpoint->attempt,
        .channel = (char *)channel,
        .step = step,
        .round = round,
    };
    const double pause = PM_ENDPOINT_ALL_ASKED * endpoint->system->scene->network.nprocess;
    // Names of processes are shorter than the channels that contain them.
    unsigned char data[96 + 2 * PM_CHANNEL_SIZE];
    const size_t size = pm_request_encode(&message, data, sizeof data);
    const bool all =
        pm_waiting_is_long(&endpoint->waiting) && endpoint->now >= endpoint->all_asked_at + pause;
    const char *to = all ? endpoint->request_channel : address;
    endpoint->all_asked_at = all ? endpoint->now : endpoint->all_asked_at;
    pm_waiting_note_requests(&endpoint->waiting, 1);
    return pm_transport_publish(endpoint->transport, to, data, size);
}

// --- the end ---

void pm_endpoint_end(pm_endpoint *endpoint, pm_status status, const char *message) {
    endpoint->status = status;
    snprintf(endpoint->message, sizeof endpoint->message, "%s", message);
}

pm_status pm_endpoint_result(const pm_endpoint *endpoint) {
    return endpoint->status == PM_OK ? PM_OK : pm_fail(endpoint->status, "%s", endpoint->message);
}

pm_status pm_endpoint_code(int8_t code) {
    const bool known = code >= PM_EUSAGE && code <= PM_EINTERRUPTED;
    return known ? (pm_status)code : PM_ENET;
}

pm_status pm_endpoint_wait(pm_endpoint *endpoint, double until, double now,
                           const volatile sig_atomic_t *stop) {
    const double left = until - now, most = left < LONG_WAIT ? STOP_INTERVAL : LONGEST_WAIT;
    const double wait = clamp(left, 0, most);
    endpoint->presence.planned = wait;
    PM_TRY(pm_transport_wait(endpoint->transport, wait, NULL));
    return stop != NULL && *stop != 0 ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK;
}
