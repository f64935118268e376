// The table of transports by URL scheme, and the calls through it.
#include "transport/transport.h"

#include <assert.h>
#include <fnmatch.h>
#include <stdlib.h>
#include <string.h>

#include "base/plugin.h"
#include "transport/transport_table.h"

struct pm_transport {
    const pm_transport_table *table;
    void *state;
    pm_drops drops;
    bool stays_here;
};

static const struct {
    const char *scheme;
    const pm_transport_table *table; // NULL: it is loaded when it is needed
} schemes[] = {
    {"udpm://", &pm_transport_lcm},
    {"mpudpm://", &pm_transport_lcm},
    {"mpi://", NULL},
};

static pm_status find(const char *url, const pm_transport_table **table) {
    for (size_t i = 0; i < sizeof schemes / sizeof schemes[0]; ++i) {
        if (strncmp(url, schemes[i].scheme, strlen(schemes[i].scheme)) == 0) {
            const void *loaded = schemes[i].table;
            PM_TRY(loaded != NULL ? PM_OK
                                  : pm_plugin_find("portmet-mpi.so", "pm_transport_mpi", &loaded));
            *table = loaded;
            return PM_OK;
        }
    }
    return pm_fail(
        PM_ECONFIG,
        "transport \"%s\": expected udpm://ADDRESS:PORT, mpudpm://ADDRESS:PORT or mpi://", url);
}

pm_status pm_transport_check(const char *url) {
    const pm_transport_table *table = NULL;
    PM_TRY(find(url, &table));
    PM_TRY(pm_transport_faulty_open(url, &table, NULL));
    return table->check(url);
}

bool pm_transport_has_ranks(const char *url) {
    return strncmp(url, "mpi://", strlen("mpi://")) == 0;
}

pm_status pm_transport_place(const char *url, int *rank, int *count) {
    const pm_transport_table *table = NULL;
    PM_TRY(find(url, &table));
    PM_TRY(table->check(url));
    return table->place(rank, count);
}

pm_status pm_transport_make(pm_transport **transport, const pm_transport_table *table,
                            void *state) {
    pm_transport *made = NULL;
    PM_TRY(PM_NEW(made, "a transport"));
    made->table = table;
    made->state = state;
    *transport = made;
    return PM_OK;
}

pm_status pm_transport_open(pm_transport **transport, const char *url) {
    const pm_transport_table *table = NULL;
    pm_transport *made = NULL;
    PM_TRY(find(url, &table));
    PM_TRY(pm_transport_make(&made, table, NULL));
    pm_status status = table->open(&made->state, url, &made->drops);
    if (status == PM_OK) {
        status = pm_transport_faulty_open(url, &made->table, &made->state);
        if (status != PM_OK) {
            table->close(made->state);
        }
    }
    if (status != PM_OK) {
        free(made);
        return status;
    }
    const char *ttl = strstr(url, "ttl=");
    made->stays_here = !pm_transport_has_ranks(url) && (ttl == NULL || ttl[4] == '0');
    *transport = made;
    return PM_OK;
}

const char *pm_transport_reach(const pm_transport *transport) {
    return transport->stays_here ? " (with ttl=0 in the URL no message leaves this host)" : "";
}

void pm_transport_close(pm_transport *transport) {
    if (transport != NULL) {
        transport->table->close(transport->state);
        free(transport);
    }
}

// --- a tap ---
//
// A transport in front of another one: it publishes messages on chosen channels over LCM as well,
// so that LCM programs see a run whose processes talk in another way.

typedef struct tapped {
    pm_transport_front front;
    void *lcm; // the state of an LCM transport
    pm_tap tap;
} tapped;

static void tapped_close(void *state) {
    tapped *t = state;
    t->front.table->close(t->front.beneath);
    pm_transport_lcm.close(t->lcm);
    free(t);
}

static pm_status tapped_publish(void *state, const char *channel, const void *data, size_t size) {
    const tapped *t = state;
    const size_t length = strlen(t->tap.scene);
    bool chosen = false;
    if (strncmp(channel, t->tap.scene, length) == 0 && channel[length] == '_') {
        for (int i = 0; i < t->tap.count && !chosen; ++i) {
            chosen = fnmatch(t->tap.pattern[i], channel + length + 1, 0) == 0;
        }
    }
    if (chosen) {
        // Nobody in the run waits for this message.
        (void)pm_transport_lcm.publish(t->lcm, channel, data, size);
    }
    return pm_front_publish(state, channel, data, size);
}

static const pm_transport_table tapped_table = {
    .close = tapped_close,
    .subscribe = pm_front_subscribe,
    .publish = tapped_publish,
    .wait = pm_front_wait,
    .file = pm_front_file,
};

pm_status pm_transport_tap(pm_transport *transport, const pm_tap *tap) {
    tapped *t = NULL;
    PM_TRY(PM_NEW(t, "a tap"));
    *t = (tapped){.front = {transport->table, transport->state}, .tap = *tap};
    const pm_status status = pm_transport_lcm.open(&t->lcm, tap->url, &transport->drops);
    if (status != PM_OK) {
        free(t);
        return status;
    }
    transport->table = &tapped_table;
    transport->state = t;
    return PM_OK;
}

// --- calls through the table ---

pm_status pm_transport_seal(pm_transport *transport, const pm_key *key, const char *sender,
                            pm_clock_handler *on_clock, const void *context) {
    void *state;
    PM_TRY(pm_transport_sealed_open(&state, transport->table, transport->state, key, sender,
                                    on_clock, context, &transport->drops));
    transport->table = &pm_transport_sealed;
    transport->state = state;
    return PM_OK;
}

pm_status pm_transport_subscribe(pm_transport *transport, const char *channel,
                                 pm_message_handler *handler, void *context) {
    assert(strlen(channel) < PM_CHANNEL_SIZE);
    return transport->table->subscribe(transport->state, channel, handler, context);
}

pm_status pm_transport_publish(pm_transport *transport, const char *channel, const void *data,
                               size_t size) {
    assert(strlen(channel) < PM_CHANNEL_SIZE);
    return transport->table->publish(transport->state, channel, data, size);
}

pm_status pm_transport_wait(pm_transport *transport, double seconds, int *handled) {
    int count = 0;
    const pm_status status = transport->table->wait(transport->state, seconds, &count);
    if (handled != NULL) {
        *handled = count;
    }
    return status;
}

int pm_transport_file(const pm_transport *transport) {
    return transport->table->file(transport->state);
}

const pm_drops *pm_transport_drops(const pm_transport *transport) {
    return &transport->drops;
}
