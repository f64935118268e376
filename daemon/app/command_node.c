// portmetd node: one process of a scene, with its subsystems.
#include <stdio.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/setup.h"
#include "app/stop.h"
#include "lockstep/lockstep.h"

static pm_status serve(pm_setup *setup, const pm_options *options, int process_id) {
    pm_transport *transport = NULL;
    pm_lockstep_node *node = NULL;
    pm_lockstep_node_options node_options = {
        .z = setup->initial,
        .session = options->session,
        .boundary_input = &setup->boundary_input,
    };
    pm_status status;
    PM_TRY_DONE(pm_setup_checkpoint(setup, options, setup->scene->process[process_id].name,
                                    &node_options.checkpoint));
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene));
    PM_TRY_DONE(pm_lockstep_node_open(&node, setup->system, process_id, transport, &node_options));
    status = pm_lockstep_run_node(node, &pm_stop_requested);
    pm_connect_warn(transport, pm_lockstep_node_drops(node));
done:
    pm_lockstep_node_close(node);
    pm_transport_close(transport);
    return status;
}

static pm_status fail_name(const pm_scene *scene, const char *name) {
    char list[256] = "";
    size_t used = 0;
    for (int i = 0; i < scene->nprocess && used < sizeof list; ++i) {
        const int length = snprintf(list + used, sizeof list - used, "%s%s", i == 0 ? "" : ", ",
                                    scene->process[i].name);
        used += length < 0 ? 0 : (size_t)length;
    }
    return pm_fail(PM_EUSAGE, "%s: no process called \"%s\"; there are: %s", scene->path, name,
                   list);
}

static pm_status execute(const pm_options *options) {
    pm_setup setup;
    pm_status status;
    PM_TRY_DONE(pm_setup_load(&setup, options, PM_TO_SERVE));
    const int process_id = pm_scene_find_process(setup.scene, options->name);
    status =
        process_id < 0 ? fail_name(setup.scene, options->name) : serve(&setup, options, process_id);
done:
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_node = {
    .name = "node",
    .arguments = "SCENE NAME",
    .summary = "serve one process of a scene",
    .help = "Serves the process NAME, one subsystem or those that the scene's `processes` list:\n"
            "publishes their energy and entropy fluxes through the ports that lead to others,\n"
            "listens to these, and steps when the coordinator grants it. Ends when the run does.\n"
            "Scene, weights and initial state must be the same on every host; a node that\n"
            "differs is refused. By hand, one in each terminal or on each host, in any order:\n\n"
            "  portmetd node SCENE NAME1\n"
            "  portmetd node SCENE NAME2\n"
            "  portmetd coordinator SCENE\n\n"
            "With --checkpoint, for all of them, one that was killed goes on when it is started\n"
            "again with the same command within the scene's `patience`.\n",
    .accepts = PM_OPTION_WEIGHTS | PM_OPTION_URL | PM_OPTION_SESSION | PM_OPTION_CHECKPOINT,
    .execute = execute,
};
