// A transport in front of another one: it publishes messages on chosen channels over LCM as well,
// so that LCM programs see a run whose processes talk in another way.
#include <fnmatch.h>
#include <stdlib.h>
#include <string.h>

#include "transport/transport_table.h"

typedef struct tapped {
    const pm_transport_table *table; // of the transport beneath
    void *beneath;
    void *lcm; // the state of an LCM transport
    pm_tap tap;
} tapped;

pm_status pm_transport_tapped_open(void **state, const pm_transport_table *table, void *beneath,
                                   const pm_tap *tap, pm_drops *drops) {
    tapped *t = calloc(1, sizeof *t);
    if (t == NULL) {
        return pm_fail(PM_ENOMEM, "tap: out of memory");
    }
    *t = (tapped){.table = table, .beneath = beneath, .tap = *tap};
    const pm_status status = pm_transport_lcm.open(&t->lcm, tap->url, NULL, drops);
    if (status != PM_OK) {
        free(t);
        return status;
    }
    *state = t;
    return PM_OK;
}

static void tapped_close(void *state) {
    tapped *t = state;
    t->table->close(t->beneath);
    pm_transport_lcm.close(t->lcm);
    free(t);
}

static bool is_tapped(const pm_tap *tap, const char *channel) {
    const size_t length = strlen(tap->scene);
    if (strncmp(channel, tap->scene, length) != 0 || channel[length] != '_') {
        return false;
    }
    for (int i = 0; i < tap->count; ++i) {
        if (fnmatch(tap->pattern[i], channel + length + 1, 0) == 0) {
            return true;
        }
    }
    return false;
}

static pm_status tapped_publish(void *state, const char *channel, const void *data, size_t size) {
    const tapped *t = state;
    if (is_tapped(&t->tap, channel)) {
        // Nobody in the run waits for this message.
        (void)pm_transport_lcm.publish(t->lcm, channel, data, size);
    }
    return t->table->publish(t->beneath, channel, data, size);
}

static pm_status tapped_subscribe(void *state, const char *channel, pm_message_handler *handler,
                                  void *context) {
    const tapped *t = state;
    return t->table->subscribe(t->beneath, channel, handler, context);
}

static pm_status tapped_wait(void *state, double seconds, int *handled) {
    const tapped *t = state;
    return t->table->wait(t->beneath, seconds, handled);
}

static int tapped_file(const void *state) {
    const tapped *t = state;
    return t->table->file(t->beneath);
}

const pm_transport_table pm_transport_tapped = {
    .close = tapped_close,
    .subscribe = tapped_subscribe,
    .publish = tapped_publish,
    .wait = tapped_wait,
    .file = tapped_file,
};
