// portmetd: the daemon's subcommands.
#include "app/command.h"
#include "app/status_request.h"
#include "base/linalg.h"
#include "base/stop.h"
#include "base/subcommand.h"

static const pm_subcommand commands[] = {
    {"run", "run a scene: its processes, and a coordinator", pm_command_run},
    {"node", "serve one process of a scene", pm_command_node},
    {"coordinator", "step the nodes of a scene that run elsewhere", pm_command_coordinator},
    {"status", "print how a run is doing", pm_command_status},
    {"view", "show a run or a recording in a browser", pm_command_view},
    {"export", "write a scene as C source or as an FMU", pm_command_export},
    {"emit", "write files with which systemd or procman starts a scene", pm_command_emit},
    {"check", "validate a scene and describe it", pm_command_check},
};

static const pm_subcommands program = {
    .program = "portmetd",
    .about =
        "Serves learned thermodynamic subsystems over LCM: one process per subsystem, energy and\n"
        "entropy fluxes between neighbours. By construction energy is conserved and entropy\n"
        "never falls.",
    .codes = "0 success, 2 command line, 3 scene, 4 file, 5 dataset, 6 weights,\n"
             "7 transport, 8 silent peer, 9 non-finite value, 10 law violated, 11 memory,\n"
             "12 interrupted.",
    .count = sizeof commands / sizeof commands[0],
    .command = commands,
};

int main(int argc, char **argv) {
    pm_linalg_init();
    pm_status_request_accept();
    return pm_subcommand_main(&program, argc, argv, pm_stop_install(PM_STOP_SECOND_IGNORED));
}
