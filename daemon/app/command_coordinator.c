// portmetd coordinator: coordinates nodes that are started by hand, here or on other hosts, records
// their samples and prints the tables.
#include <stddef.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/observer.h"
#include "app/prepare.h"
#include "lockstep/lockstep.h"

static pm_status conduct(pm_setup *setup, pm_observer *observer) {
    pm_transport *transport = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_lockstep_coordinator_options options = pm_observer_attach(observer, setup);
    pm_status status;
    PM_TRY_DONE(pm_prepare_checkpoint(setup, observer->options, NULL, &options.checkpoint));
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene, "coordinator"));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&coordinator, setup->system, transport, &options));
    status = pm_lockstep_run_coordinator(coordinator, observer->options->stop);
    status = pm_observer_finish(observer, status, pm_lockstep_coordinator_ledger(coordinator),
                                "over LCM");
    pm_connect_warn(transport, pm_lockstep_coordinator_drops(coordinator));
done:
    pm_lockstep_coordinator_close(coordinator);
    pm_transport_close(transport);
    return status;
}

static pm_status execute(const pm_run_options *options) {
    pm_setup setup;
    pm_observer observer = {0};
    pm_status status;
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_COORDINATE));
    PM_TRY_DONE(pm_observer_open(&observer, &setup, options));
    status = conduct(&setup, &observer);
done:
    pm_observer_close(&observer);
    pm_setup_free(&setup);
    return status;
}

static const pm_command command = {
    .arguments = "SCENE",
    .help =
        "Waits for one `portmetd node` per process, on this or any other host of the network,\n"
        "then steps them together, keeps the ledger of energy and entropy, records, and prints\n"
        "the same tables as `portmetd run`. Nodes with another scene, other weights or another "
        "initial\n"
        "state are refused by name. With --checkpoint it continues after a kill; remove\n"
        "the files in the folder when all processes have ended well.",
    .accepts = PM_OPTION_STEPS | PM_OPTION_RECORD | PM_OPTION_OVERWRITE | PM_OPTION_WEIGHTS |
               PM_OPTION_URL | PM_OPTION_SESSION | PM_OPTION_CHECKPOINT | PM_OPTION_GATE |
               PM_OPTION_QUIET,
    .execute = execute,
};

pm_status pm_command_coordinator(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
