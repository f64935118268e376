// Checks that the steps of a run over LCM allocate nothing in this program's code, with checkpoints
// and seals. Coordinator and nodes run in one thread, each with its own endpoint, on liblcm's
// receiver and on this program's. Allocations by this program and by stdio count; those of liblcm
// do not. Runs in a private network, with a folder for the checkpoints.
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "lockstep/coordinator.h"
#include "lockstep/node.h"
#include "tests/support/allocations.h"
#include "tests/support/fixture.h"
#include "tests/support/together.h"

#define COUNT 3
#define STEPS 40
#define FIRST 10 // steps by which everything has been made

static void require(pm_status status) {
    if (status != PM_OK) {
        fprintf(stderr, "steps_allocate_nothing: %s\n", pm_error());
        exit(1);
    }
}

// Allocations by the end of step FIRST, and by the last one's.
static pm_status observe(void *context, const pm_sample *sample) {
    long *count = context;
    if (sample->step == FIRST || sample->step == STEPS) {
        count[sample->step == STEPS] = allocations;
    }
    return PM_OK;
}

// With checkpoints in `folder` and sealed messages, or, if that is NULL, without both.
static int check_run(const char *url, int window, const char *folder) {
    const pm_key key = {{1, 2, 3}};
    char path[COUNT + 1][256];
    long count[2] = {0, -1};
    fixture f = {0};
    pm_transport *transport[COUNT + 1];
    pm_lockstep_node *node[COUNT];
    pm_lockstep_coordinator *coordinator = NULL;
    fixture_open(&f, COUNT, 1);
    f.scene->network.window = window;
    f.scene->network.checkpoint = 5;
    for (int i = 0; i <= COUNT; ++i) {
        require(pm_transport_open(&transport[i], url));
        if (folder != NULL) {
            require(pm_transport_seal(transport[i], &key, "sender@host", NULL, NULL));
            snprintf(path[i], sizeof path[i], "%s/%d", folder, i);
        }
    }
    for (int i = 0; i < COUNT; ++i) {
        const pm_lockstep_node_options of_node = {.z = f.z,
                                                  .checkpoint = folder == NULL ? NULL : path[i]};
        require(pm_lockstep_node_open(&node[i], f.system, i, transport[i], &of_node));
    }
    const pm_lockstep_coordinator_options options = {
        .steps = STEPS,
        .want_state = true,
        .observer = {.context = count, .step = observe},
        .checkpoint = folder == NULL ? NULL : path[COUNT]};
    require(pm_lockstep_coordinator_open(&coordinator, f.system, transport[COUNT], &options));
    require(run_together(coordinator, COUNT, node, NULL));
    pm_lockstep_coordinator_close(coordinator);
    for (int i = 0; i < COUNT; ++i) {
        pm_lockstep_node_close(node[i]);
    }
    for (int i = 0; i <= COUNT; ++i) {
        pm_transport_close(transport[i]);
        if (folder != NULL) {
            unlink(path[i]);
        }
    }
    fixture_close(&f);
    if (count[0] <= 0 || count[1] != count[0]) {
        fprintf(stderr, "%s, window %d, %s: %ld allocations by step %d, %ld by step %d\n", url,
                window, folder == NULL ? "plain" : "with checkpoints and seals", count[0], FIRST,
                count[1], STEPS);
        return 1;
    }
    return 0;
}

int main(int argc, char **argv) {
    const char *const folders[] = {NULL, argc > 1 ? argv[1] : "."};
    int failed = 0;
    for (int window = 1; window <= 5; window += 4) {
        for (int i = 0; i < 2; ++i) {
            failed += check_run("udpm://239.255.76.67:7667?ttl=0", window, folders[i]);
            failed += check_run("udpm://239.255.76.67:7667?ttl=0&receive=lcm", window, folders[i]);
        }
    }
    return failed == 0 ? 0 : 1;
}
