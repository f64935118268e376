// A listener and a client must take or drop any messages that a run or a service seems to send. In
// the input each message is preceded by its length (two bytes) and by a byte that chooses among the
// channels to which the observer listens. The very first byte chooses the observer. Messages are
// given the fingerprint of their type, and replies the number of the request that they answer,
// which random changes would hardly find.
#include <math.h>
#include <string.h>

#include "lockstep/listener.h"
#include "lockstep/remote.h"
#include "small_scene.h"
#include "tests/fuzz/target.h"
#include "transport/transport_table.h"

#define MOST_CHANNELS 8
#define REQUESTS 3 // of a client, after it has the description

// A transport on which the input arrives, one message at a time.
typedef struct source {
    const uint8_t *data;
    size_t size;
    int count;
    struct {
        char channel[PM_CHANNEL_SIZE];
        pm_message_handler *handler;
        void *context;
    } subscription[MOST_CHANNELS];
    uint8_t request[16];        // client and nonce of the last request that was published
    volatile sig_atomic_t over; // no message is left
} source;

static void source_close(void *state) {
    (void)state;
}

static pm_status source_subscribe(void *state, const char *channel, pm_message_handler *handler,
                                  void *context) {
    source *s = state;
    check(s->count < MOST_CHANNELS && strlen(channel) < PM_CHANNEL_SIZE);
    strcpy(s->subscription[s->count].channel, channel);
    s->subscription[s->count].handler = handler;
    s->subscription[s->count++].context = context;
    return PM_OK;
}

// A request begins with fingerprint, session, client and nonce.
static pm_status source_publish(void *state, const char *channel, const void *data, size_t size) {
    source *s = state;
    (void)channel;
    check(size >= 32);
    memcpy(s->request, (const uint8_t *)data + 16, sizeof s->request);
    return PM_OK;
}

// Returns the type of the messages on a channel, whose name ends with it, or with "_body" after it.
static const pm_wire_type *type_of(const char *channel) {
    static const struct {
        const char *end;
        const pm_wire_type *type;
    } types[] = {{"LEDGER", &pm_ledger_type},
                 {"HEALTH", &pm_health_type},
                 {"COMMAND", &pm_command_type},
                 {"REPLY", &pm_control_reply_type},
                 {"REPORT_body", &pm_report_type}};
    size_t i = 0;
    while (strstr(channel, types[i].end) == NULL) {
        check(++i < sizeof types / sizeof types[0]);
    }
    return types[i].type;
}

static pm_status source_wait(void *state, double seconds, int *handled) {
    source *s = state;
    (void)seconds;
    s->over = s->size < 3;
    if (handled != NULL) {
        *handled = !s->over;
    }
    if (s->over) {
        return PM_OK;
    }
    size_t size = (size_t)s->data[0] << 8 | s->data[1];
    const int to = s->data[2] % s->count;
    const bool unchanged = s->data[2] >= 0xf0;
    s->data += 3;
    s->size -= 3;
    size = size < s->size ? size : s->size;
    uint8_t *message = malloc(size + (size == 0));
    check(message != NULL);
    memcpy(message, s->data, size);
    const pm_wire_type *type = type_of(s->subscription[to].channel);
    for (size_t i = 0; i < 8 && i < size && !unchanged; ++i) {
        message[i] = (uint8_t)((uint64_t)type->fingerprint() >> (56 - 8 * i));
    }
    if (type == &pm_control_reply_type && size >= 24 && !unchanged) {
        memcpy(message + 8, s->request, sizeof s->request);
    }
    s->subscription[to].handler(s->subscription[to].context, s->subscription[to].channel, message,
                                size);
    free(message);
    s->data += size;
    s->size -= size;
    return PM_OK;
}

static int source_file(const void *state) {
    (void)state;
    return -1;
}

static void check_finite(double value) {
    check(isfinite(value));
}

// Checks that the numbers of a listener are finite, and have the counts of the scene.
static void try_listener(pm_transport *transport, source *s, const pm_scene *scene) {
    pm_listener *listener = NULL;
    check(pm_listener_open(&listener, transport, scene, 0) == PM_OK);
    do {
        check(pm_listener_read(listener) == PM_OK);
        const pm_sample *sample = pm_listener_sample(listener);
        const portmet_ledger_t *ledger = pm_listener_ledger(listener);
        const portmet_health_t *health = pm_listener_health(listener);
        for (int i = 0; sample != NULL && i < scene->physics.nsubsystem; ++i) {
            check_finite(sample->energy[i]);
            check_finite(sample->entropy[i]);
        }
        check_finite(ledger == NULL ? 0 : ledger->energy);
        for (int i = 0; health != NULL && i < scene->network.nprocess; ++i) {
            check_finite(health->silent[i]);
        }
    } while (!s->over);
    pm_listener_close(listener);
}

static void check_failure(pm_status status) {
    check(status == PM_OK || (pm_error()[0] != '\0' && strchr(pm_error(), '\n') == NULL));
}

static void try_client(pm_transport *transport, source *s) {
    pm_client *client = NULL;
    const pm_remote_options options = {
        .scene = "small", .sender = "fuzz", .patience = 5, .stop = &s->over};
    const pm_status status = pm_remote_open(&client, transport, &options);
    check_failure(status);
    if (status != PM_OK) {
        check(client == NULL);
        return;
    }
    const pm_served *served = pm_remote_served(client);
    size_t length = 0; // every text is there
    for (int i = 0; i < served->nz; ++i) {
        length += strlen(served->variable[i]) + strlen(served->unit[i]);
    }
    for (int i = 0; i < served->nport; ++i) {
        length += strlen(served->port[i]) + strlen(served->end_a[i]) + strlen(served->end_b[i]);
    }
    for (int i = 0; i < served->nlive; ++i) {
        length += strlen(served->live[i]) + strlen(served->live_unit[i]);
    }
    check(length < SIZE_MAX);
    for (int i = 0; i < REQUESTS; ++i) {
        check_failure(pm_remote_ask(
            client, &(portmet_control_t){.kind = PORTMET_CONTROL_T_ADVANCE, .steps = 1}, true));
        const portmet_control_reply_t *reply = pm_remote_reply(client);
        for (int k = 0; k < reply->nz; ++k) {
            check_finite(reply->z[k]);
        }
    }
    pm_remote_close(client);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const pm_transport_table table = {.close = source_close,
                                             .subscribe = source_subscribe,
                                             .publish = source_publish,
                                             .wait = source_wait,
                                             .file = source_file};
    static pm_scene *scene;
    if (scene == NULL) {
        check(pm_scene_parse(&scene, SMALL_SCENE, "small.yaml") == PM_OK);
    }
    if (size == 0) {
        return 0;
    }
    source s = {.data = data + 1, .size = size - 1};
    pm_transport *transport;
    check(pm_transport_make(&transport, &table, &s) == PM_OK);
    if (data[0] % 2 == 0) {
        try_listener(transport, &s, scene);
    } else {
        try_client(transport, &s);
    }
    pm_transport_close(transport);
    return 0;
}
