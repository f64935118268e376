// portmetd: finds the subcommand, runs it, prints the error if there is one. The only file of the
// daemon that decides an exit code.
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "app/command.h"
#include "app/stop.h"
#include "base/linalg.h"

static const pm_command *const commands[] = {
    &pm_command_run,
    &pm_command_node,
    &pm_command_coordinator,
    &pm_command_check,
};
#define COMMANDS (sizeof commands / sizeof commands[0])

static void print_help(void) {
    printf(
        "Usage: portmetd COMMAND [arguments]\n\n"
        "Serves learned thermodynamic subsystems over LCM: one process per subsystem, energy and\n"
        "entropy fluxes between neighbours, both laws kept by construction.\n\nCommands:\n");
    for (size_t i = 0; i < COMMANDS; ++i) {
        printf("  %-12s %s\n", commands[i]->name, commands[i]->summary);
    }
    printf("\nportmetd COMMAND --help tells more; portmetd --version prints the version.\n\n"
           "Exit codes: 0 success, 2 command line, 3 scene, 4 file, 5 dataset, 6 weights,\n"
           "7 transport, 8 silent peer, 9 non-finite value, 10 law violated, 11 memory,\n"
           "12 interrupted.\n");
}

static const pm_command *find_command(const char *name) {
    for (size_t i = 0; i < COMMANDS; ++i) {
        if (strcmp(commands[i]->name, name) == 0) {
            return commands[i];
        }
    }
    return NULL;
}

static pm_status dispatch(int argc, char **argv) {
    if (argc < 2) {
        return pm_fail(PM_EUSAGE, "expected a command (portmetd --help)");
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        print_help();
        return PM_OK;
    }
    if (strcmp(argv[1], "--version") == 0) {
        printf("portmetd %s\n", PM_VERSION);
        return PM_OK;
    }
    const pm_command *command = find_command(argv[1]);
    if (command == NULL) {
        return pm_fail(PM_EUSAGE, "no command called \"%s\" (portmetd --help)", argv[1]);
    }
    pm_options options;
    bool help = false;
    PM_TRY(pm_options_parse(command, argc - 1, argv + 1, &options, &help));
    if (help) {
        pm_options_print_help(command);
        return PM_OK;
    }
    return command->execute(&options);
}

int main(int argc, char **argv) {
    pm_stop_install();
    pm_linalg_init();
    pm_status status = dispatch(argc, argv);
    if (fflush(stdout) != 0 && status == PM_OK) {
        status = pm_fail(PM_EFILE, "standard output: %s", strerror(errno));
    }
    if (status != PM_OK) {
        fprintf(stderr, "portmetd: %s\n", pm_error());
    }
    return (int)status;
}
