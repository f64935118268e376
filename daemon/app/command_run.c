// portmetd run: a whole scene with one command. Over LCM it launches one process per subsystem and
// is the coordinator itself; with --in-process all of them live in this thread.
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

#include "app/command.h"
#include "app/launch.h"
#include "app/observer.h"
#include "app/stop.h"
#include "net/lockstep.h"

#define WATCH_INTERVAL 0.05 // s between two looks at the children
#define END_GRACE 5.0       // s for the nodes to end by themselves after the last step
#define MAX_ARGUMENTS 12

// --- over LCM ---

static pm_status launch_nodes(pm_launch *launch, const pm_setup *setup, const pm_options *options,
                              int64_t session) {
    char number[24];
    snprintf(number, sizeof number, "%" PRId64, session);
    for (int i = 0; i < setup->scene->nsubsystem; ++i) {
        const char *name = setup->scene->subsystem[i].name;
        const char *argv[MAX_ARGUMENTS] = {"portmetd", "node",  "--session",
                                           number,     "--url", setup->scene->url};
        int count = 6;
        if (options->weights != NULL) {
            argv[count++] = "--weights";
            argv[count++] = options->weights;
        }
        argv[count++] = "--";
        argv[count++] = options->scene;
        argv[count++] = name;
        PM_TRY(pm_launch_start(launch, name, argv));
    }
    return PM_OK;
}

// The coordinator's loop, with an eye on the children and on the stop flag until the first failure.
static pm_status conduct(pm_lockstep_coordinator *coordinator, pm_launch *launch) {
    pm_transport *transport = pm_lockstep_coordinator_transport(coordinator);
    bool failed = false;
    double now = pm_clock(), looked = 0;
    while (!pm_lockstep_coordinator_finished(coordinator)) {
        if (!failed && now - looked > WATCH_INTERVAL) {
            looked = now;
            pm_status status = pm_launch_watch(launch);
            if (pm_stop_requested) {
                status = pm_fail(PM_EINTERRUPTED, "interrupted");
            }
            if (status != PM_OK) {
                pm_lockstep_coordinator_fail(coordinator, status, pm_error());
                failed = true;
            }
        }
        const double next = pm_lockstep_coordinator_poll(coordinator, now);
        const double wait = next - now < WATCH_INTERVAL ? next - now : WATCH_INTERVAL;
        PM_TRY(pm_transport_wait(transport, wait > 0 ? wait : 0, NULL));
        now = pm_clock();
    }
    return pm_lockstep_coordinator_result(coordinator);
}

static pm_status run_processes(const pm_setup *setup, const pm_options *options,
                               pm_observer *observer) {
    pm_transport *transport = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_launch *launch = NULL;
    pm_lockstep_coordinator_options coordinator_options = pm_observer_attach(observer, setup);
    coordinator_options.session = pm_lockstep_session();
    pm_status status;
    PM_TRY_DONE(pm_transport_open(&transport, setup->scene->url, NULL));
    PM_TRY_DONE(
        pm_lockstep_coordinator_open(&coordinator, setup->system, transport, &coordinator_options));
    PM_TRY_DONE(pm_launch_open(&launch, setup->scene->nsubsystem));
    PM_TRY_DONE(launch_nodes(launch, setup, options, coordinator_options.session));
    status = conduct(coordinator, launch);
    if (status == PM_OK) {
        status = pm_launch_wait(launch, END_GRACE);
    }
    status = pm_observer_finish(observer, status, pm_lockstep_coordinator_ledger(coordinator),
                                "a process each, over LCM");
done:
    pm_launch_close(launch);
    pm_lockstep_coordinator_close(coordinator);
    pm_transport_close(transport);
    return status;
}

// --- in this thread ---

// Everything that --in-process opens; zeroed members are not open.
typedef struct company {
    pm_hub *hub;
    int count;
    pm_transport **transport; // [count]
    pm_lockstep_node **node;  // [count]
    pm_transport *coordinator_transport;
    pm_lockstep_coordinator *coordinator;
} company;

static void dismiss(company *c) {
    pm_lockstep_coordinator_close(c->coordinator);
    pm_transport_close(c->coordinator_transport);
    for (int i = 0; i < c->count; ++i) {
        pm_lockstep_node_close(c->node[i]);
        pm_transport_close(c->transport[i]);
    }
    pm_hub_close(c->hub);
}

static pm_status gather(company *c, const pm_setup *setup, pm_observer *observer) {
    const char *url = "memory://";
    PM_TRY(pm_hub_open(&c->hub, NULL));
    for (int i = 0; i < c->count; ++i) {
        const pm_lockstep_node_options options = {
            .z = setup->initial + setup->scene->subsystem[i].first, .load = &setup->load};
        PM_TRY(pm_transport_open(&c->transport[i], url, c->hub));
        PM_TRY(pm_lockstep_node_open(&c->node[i], setup->system, i, c->transport[i], &options));
    }
    const pm_lockstep_coordinator_options options = pm_observer_attach(observer, setup);
    PM_TRY(pm_transport_open(&c->coordinator_transport, url, c->hub));
    return pm_lockstep_coordinator_open(&c->coordinator, setup->system, c->coordinator_transport,
                                        &options);
}

static pm_status run_together(const pm_setup *setup, pm_observer *observer) {
    pm_arena arena = {0};
    const size_t count = (size_t)setup->scene->nsubsystem;
    company c = {.transport = pm_arena_array(&arena, count, sizeof(pm_transport *)),
                 .node = pm_arena_array(&arena, count, sizeof(pm_lockstep_node *))};
    pm_status status = PM_OK;
    if (c.transport == NULL || c.node == NULL) {
        status = pm_fail(PM_ENOMEM, "run: out of memory");
        goto done;
    }
    c.count = (int)count;
    PM_TRY_DONE(gather(&c, setup, observer));
    status = pm_lockstep_run_together(c.coordinator, c.count, c.node, &pm_stop_requested);
    status = pm_observer_finish(observer, status, pm_lockstep_coordinator_ledger(c.coordinator),
                                "in one process");
done:
    dismiss(&c);
    pm_arena_free(&arena);
    return status;
}

static pm_status execute(const pm_options *options) {
    pm_setup setup;
    pm_observer observer = {0};
    pm_status status;
    PM_TRY_DONE(pm_setup_load(&setup, options, PM_TO_COORDINATE));
    PM_TRY_DONE(pm_observer_open(&observer, &setup, options));
    status = options->in_process ? run_together(&setup, &observer)
                                 : run_processes(&setup, options, &observer);
done:
    pm_observer_close(&observer);
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_run = {
    .name = "run",
    .arguments = "SCENE",
    .summary = "run a scene: one process per subsystem, and a coordinator",
    .help =
        "Launches `portmetd node` once per subsystem, coordinates them over LCM, and prints mean\n"
        "fluxes, errors against the scene's reference trajectory, the ledger of both laws, and "
        "the\n"
        "speed. It starts from each subsystem's `initial`, else from the reference's first state.\n"
        "Ctrl-C ends all processes and prints the tables of the steps done so far.\n",
    .accepts = PM_OPTION_STEPS | PM_OPTION_RECORD | PM_OPTION_WEIGHTS | PM_OPTION_URL |
               PM_OPTION_IN_PROCESS | PM_OPTION_QUIET,
    .execute = execute,
};
