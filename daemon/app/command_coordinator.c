// portmetd coordinator: coordinates nodes that are started by hand, here or on other hosts, records
// their samples and prints the tables.
#include "app/command.h"
#include "app/connect.h"
#include "app/prepare.h"
#include "app/serve.h"

static pm_status execute(const pm_run_options *options) {
    pm_setup setup;
    pm_status status = pm_prepare(&setup, options, PM_TO_COORDINATE);
    if (status == PM_OK) {
        status = pm_connect_refuse_ranks(setup.scene, "coordinator");
    }
    if (status == PM_OK) {
        status = pm_serve_coordinator(&setup, options);
    }
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
    .accepts = PM_OPTION_STEPS | PM_OPTION_RECORD | PM_OPTION_REPLAY | PM_OPTION_OVERWRITE |
               PM_OPTION_WEIGHTS | PM_OPTION_URL | PM_OPTION_SESSION | PM_OPTION_CHECKPOINT |
               PM_OPTION_GATE | PM_OPTION_LOG | PM_OPTION_QUIET,
    .execute = execute,
};

pm_status pm_command_coordinator(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
