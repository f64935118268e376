// portmet-train: the offline tools. Looks up the subcommand, runs it, prints its error once.
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "base/linalg.h"
#include "command/commands.h"

typedef struct command {
    const char *name, *summary;
    pm_status (*run)(int argc, char **argv, const volatile sig_atomic_t *stop);
} command;

static const command commands[] = {
    {"truth", "simulate ground truth into a dataset", pm_command_truth},
    {"correct", "correct a simulation by known fields", pm_command_correct},
    {"reduce", "find the modes of a body in its fields", pm_command_reduce},
    {"nodes", "write fields of a body as nodal values", pm_command_nodes},
    {"reconstruct", "turn modes or nodal values into fields of the body", pm_command_reconstruct},
    {"contact", "find where bodies face each other", pm_command_contact},
    {"fit", "train weights on a dataset", pm_command_fit},
    {"evaluate", "score rollouts of a scene against a dataset", pm_command_evaluate},
    {"picture", "draw bodies on a mesh, coloured by stress", pm_command_picture},
};
#define NCOMMAND (sizeof commands / sizeof *commands)

static volatile sig_atomic_t stop;

static void request_stop(int signal_number) {
    (void)signal_number;
    stop = 1;
}

// A second signal ends the program at once.
static void catch_signals(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = request_stop;
    action.sa_flags = (int)SA_RESETHAND;
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

static void print_help(void) {
    printf("Usage: portmet-train COMMAND [arguments]\n\nCommands:\n");
    for (size_t i = 0; i < NCOMMAND; ++i) {
        printf("  %-12s %s\n", commands[i].name, commands[i].summary);
    }
    printf("\nportmet-train COMMAND --help describes a command. --version prints the version.\n"
           "Exit codes: 0 success, 2 command line, 3 configuration, 4 file, 5 data, 6 weights,\n"
           "9 numerics, 10 a law violated, 11 memory, 12 interrupted.\n");
}

static pm_status run(int argc, char **argv) {
    const char *name = argc > 1 ? argv[1] : "";
    if (strcmp(name, "--help") == 0 || strcmp(name, "-h") == 0) {
        print_help();
        return PM_OK;
    }
    if (strcmp(name, "--version") == 0) {
        printf("portmet-train %s\n", PM_VERSION);
        return PM_OK;
    }
    for (size_t i = 0; i < NCOMMAND; ++i) {
        if (strcmp(name, commands[i].name) == 0) {
            return commands[i].run(argc - 1, argv + 1, &stop);
        }
    }
    return pm_fail(PM_EUSAGE, "unknown command \"%s\"; portmet-train --help lists them", name);
}

int main(int argc, char **argv) {
    pm_linalg_init();
    catch_signals();
    const pm_status status = run(argc, argv);
    if (status != PM_OK) {
        fprintf(stderr, "portmet-train: %s\n", pm_error());
    }
    return (int)status;
}
