// portmetd node: serves one process of a scene, with its subsystems.
#include <stdio.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/prepare.h"
#include "app/serve.h"

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

static pm_status execute(const pm_run_options *options) {
    pm_setup setup;
    pm_status status;
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_SERVE));
    PM_TRY_DONE(pm_connect_refuse_ranks(setup.scene, "node"));
    const int process_id = pm_scene_find_process(setup.scene, options->name);
    status = process_id < 0 ? fail_name(setup.scene, options->name)
                            : pm_serve_node(&setup, options, process_id);
done:
    pm_setup_free(&setup);
    return status;
}

static const pm_command command = {
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
            "If all of them have --checkpoint, one that was killed goes on when the same command\n"
            "starts it again within the scene's `patience`.",
    .accepts = PM_OPTION_WEIGHTS | PM_OPTION_URL | PM_OPTION_SESSION | PM_OPTION_CHECKPOINT |
               PM_OPTION_LOG,
    .execute = execute,
};

pm_status pm_command_node(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
