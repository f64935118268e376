// Measures the cost of a seal per message: messages are published and received within one process,
// alternately plain and sealed.
//   run_bench_seal CSV CONFIGS
#include <stdio.h>
#include <stdlib.h>

#include "bench.h"
#include "tests/support/memory_hub.h"
#include "transport/transport.h"

#define LARGEST 65536
#define SIZES 4

typedef struct wire {
    pm_hub *hub;
    pm_transport *transport;
    size_t size; // bytes of a message
} wire;

static const unsigned char message[LARGEST];

static void take(void *context, const char *channel, const void *data, size_t size) {
    (void)context;
    (void)channel;
    (void)data;
    (void)size;
}

static void send_and_receive(void *context) {
    const wire *w = context;
    // Within one process neither can fail once the buffers are large enough.
    (void)pm_transport_publish(w->transport, "scene_FLUX_sender", message, w->size);
    (void)pm_transport_wait(w->transport, 0, NULL);
}

static pm_status wire_open(wire *w, size_t size, const pm_key *key) {
    w->size = size;
    PM_TRY(pm_hub_open(&w->hub, NULL));
    PM_TRY(pm_hub_connect(w->hub, &w->transport));
    if (key != NULL) {
        PM_TRY(pm_transport_seal(w->transport, key, "sender@host", NULL, NULL));
    }
    return pm_transport_subscribe(w->transport, "scene_FLUX_sender", take, w);
}

static pm_status measure(const char *csv) {
    static const size_t size[SIZES] = {72, 300, 1400, 65000};
    const pm_key key = {{1, 2, 3}};
    wire w[2 * SIZES] = {{0}};
    bench_work *work[2 * SIZES];
    void *context[2 * SIZES];
    bench_time time[2 * SIZES];
    bench_table *table = NULL;
    pm_status status;
    for (int i = 0; i < 2 * SIZES; ++i) {
        work[i] = send_and_receive;
        context[i] = &w[i];
        PM_TRY_DONE(wire_open(&w[i], size[i / 2], i % 2 == 0 ? NULL : &key));
    }
    bench_measure(2 * SIZES, work, context, time);
    PM_TRY_DONE(bench_table_open(&table, csv));
    for (int i = 0; i < 2 * SIZES; ++i) {
        char name[32];
        snprintf(name, sizeof name, "%zu bytes, %s", size[i / 2], i % 2 == 0 ? "plain" : "sealed");
        bench_table_add(table, name, time[i], 0, 0);
    }
done:
    bench_table_close(table);
    for (int i = 0; i < 2 * SIZES; ++i) {
        pm_transport_close(w[i].transport);
        pm_hub_close(w[i].hub);
    }
    return status;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: run_bench_seal CSV CONFIGS\n");
        return PM_EUSAGE;
    }
    const pm_status status = measure(argv[1]);
    if (status != PM_OK) {
        fprintf(stderr, "bench_seal: %s\n", pm_error());
    }
    return (int)status;
}
