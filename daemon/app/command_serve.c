// portmetd node and portmetd coordinator: open the transport and the state machine of a process of
// a run, and drive it (lockstep/node.h, coordinator.h).
#include "app/serve.h"

#include <stdio.h>

#include "app/connect.h"
#include "app/notify.h"
#include "app/observer.h"
#include "app/prepare.h"
#include "lockstep/coordinator.h"
#include "lockstep/node.h"

static void tell_alive(void *context, int64_t step) {
    (void)context;
    pm_notify("WATCHDOG=1\nSTATUS=step %lld", (long long)step);
}

pm_status pm_serve_node(pm_setup *setup, const pm_run_options *options, int process_id) {
    const char *name = setup->scene->network.process[process_id].name;
    pm_transport *transport = NULL;
    pm_lockstep_node *node = NULL;
    pm_lockstep_node_options node_options = {
        .z = setup->initial,
        .session = options->session,
        .stays = options->stays,
        .alive = tell_alive,
        .boundary_input = &setup->boundary_input,
        .live = setup->live,
    };
    pm_status status;
    PM_TRY_DONE(pm_prepare_checkpoint(setup, options, name, &node_options.checkpoint));
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene,
                                pm_connect_url(setup->scene, options->url), name, &options->log));
    PM_TRY_DONE(pm_lockstep_node_open(&node, setup->system, process_id, transport, &node_options));
    pm_notify("READY=1");
    status = pm_lockstep_run_node(node, options->stop);
    pm_connect_warn(transport, pm_lockstep_node_drops(node), &options->log);
    if (options->coordinator_speaks && status != PM_OK && status != PM_ETIMEOUT) {
        status = pm_fail(status, "%s", "");
    }
done:
    pm_lockstep_node_close(node);
    pm_transport_close(transport);
    return status;
}

pm_status pm_serve_coordinator(pm_setup *setup, const pm_run_options *options) {
    const char *url = pm_connect_url(setup->scene, options->url);
    pm_observer observer = {0};
    pm_transport *transport = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_status status;
    PM_TRY_DONE(pm_observer_open(&observer, setup, options));
    pm_lockstep_coordinator_options own = pm_observer_attach(&observer, setup);
    PM_TRY_DONE(pm_prepare_checkpoint(setup, options, NULL, &own.checkpoint));
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene, url, "coordinator", &options->log));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&coordinator, setup->system, transport, &own));
    pm_notify("READY=1");
    status = pm_lockstep_run_coordinator(coordinator, options->stop);
    status = pm_observer_finish(&observer, status, pm_lockstep_coordinator_ledger(coordinator),
                                pm_lockstep_coordinator_pace(coordinator),
                                pm_transport_has_ranks(url) ? "a rank each, over MPI" : "over LCM");
    pm_connect_warn(transport, pm_lockstep_coordinator_drops(coordinator), &options->log);
done:
    pm_lockstep_coordinator_close(coordinator);
    pm_transport_close(transport);
    pm_observer_close(&observer);
    return status;
}

// --- the commands ---

// Prepares a process that the user starts. The ranks of an MPI run are started by mpirun alone.
static pm_status prepare(pm_setup *setup, const pm_run_options *options, pm_purpose purpose,
                         const char *command) {
    PM_TRY(pm_prepare(setup, options, purpose));
    const pm_scene *scene = setup->scene;
    const char *url = pm_connect_url(scene, options->url);
    return pm_transport_has_ranks(url)
               ? pm_fail(PM_EUSAGE,
                         "%s does not work at %s: mpirun starts all processes, by "
                         "\"mpirun -n %d portmetd run %s --url %s\"",
                         command, url, scene->network.nprocess + 1, scene->path, url)
               : PM_OK;
}

static pm_status execute_node(const pm_run_options *options) {
    pm_setup setup;
    pm_status status;
    PM_TRY_DONE(prepare(&setup, options, PM_TO_SERVE, "node"));
    const pm_scene *scene = setup.scene;
    const int process_id = pm_scene_find_process(scene, options->name);
    if (process_id >= 0) {
        status = pm_serve_node(&setup, options, process_id);
        goto done;
    }
    char list[256] = "";
    size_t used = 0;
    for (int i = 0; i < scene->network.nprocess && used < sizeof list; ++i) {
        const int length = snprintf(list + used, sizeof list - used, "%s%s", i == 0 ? "" : ", ",
                                    scene->network.process[i].name);
        used += length < 0 ? 0 : (size_t)length;
    }
    status = pm_fail(PM_EUSAGE, "%s: no process called \"%s\"; there are: %s", scene->path,
                     options->name, list);
done:
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_node = {
    .name = "node",
    .summary = "serve one process of a scene",
    .arguments = "SCENE NAME",
    .help = "Serves the process NAME: one subsystem, or those that the scene's `processes` list.\n"
            "It publishes their energy and entropy fluxes through the ports to other processes,\n"
            "listens to the fluxes of these, and steps when the coordinator grants a step. It\n"
            "ends when the run does. Scene, weights and initial state must be the same on every\n"
            "host; the coordinator refuses a node that differs. Start the processes by hand, one\n"
            "in each terminal or on each host, in any order:\n\n"
            "  portmetd node SCENE NAME1\n"
            "  portmetd node SCENE NAME2\n"
            "  portmetd coordinator SCENE\n\n"
            "With --serve it waits for one run after another, as long as it takes: beside\n"
            "`portmetd serve --elsewhere`.\n\n"
            "If all of them have --checkpoint, one that was killed goes on when the same command\n"
            "starts it again within the scene's `patience`.",
    .examples = "portmetd node configs/double_pendulum.yaml upper",
    .accepts = PM_OPTION_WEIGHTS | PM_OPTION_URL | PM_OPTION_SESSION | PM_OPTION_CHECKPOINT |
               PM_OPTION_LOG | PM_OPTION_STAYS | PM_OPTION_COMPILED,
    .execute = execute_node,
};

static pm_status execute_coordinator(const pm_run_options *options) {
    pm_setup setup;
    pm_status status;
    PM_TRY_DONE(prepare(&setup, options, PM_TO_COORDINATE, "coordinator"));
    status = pm_serve_coordinator(&setup, options);
done:
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_coordinator = {
    .name = "coordinator",
    .summary = "step the nodes of a scene that run elsewhere",
    .arguments = "SCENE",
    .help =
        "Waits for one `portmetd node` per process, on this or any other host of the network,\n"
        "then steps them together, keeps the ledger of energy and entropy, records, and prints\n"
        "the same tables as `portmetd run`. Nodes with another scene, other weights or another "
        "initial\n"
        "state are refused by name. With --checkpoint it continues after a kill; remove\n"
        "the files in the folder when all processes have ended well.",
    .examples = "portmetd coordinator configs/double_pendulum.yaml --record run.h5",
    .accepts = PM_OPTION_STEPS | PM_OPTION_RECORD | PM_OPTION_REPLAY | PM_OPTION_OVERWRITE |
               PM_OPTION_WEIGHTS | PM_OPTION_URL | PM_OPTION_SESSION | PM_OPTION_CHECKPOINT |
               PM_OPTION_GATE | PM_OPTION_LOG | PM_OPTION_QUIET,
    .execute = execute_coordinator,
};
