// Finds and runs a subcommand, and turns signals into a flag.
#include "base/subcommand.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

// The only mutable global: a signal handler can reach nothing else.
static volatile sig_atomic_t stop_requested = 0;

static void request_stop(int signal_number) {
    (void)signal_number;
    stop_requested = 1;
}

static pm_status dispatch(const pm_subcommands *commands, int argc, char **argv) {
    if (argc < 2) {
        return pm_fail(PM_EUSAGE, "expected a command; %s --help lists them", commands->program);
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        printf("Usage: %s COMMAND [arguments]\n\n%s\n\nCommands:\n", commands->program,
               commands->about);
        for (int i = 0; i < commands->count; ++i) {
            printf("  %-12s %s\n", commands->command[i].name, commands->command[i].summary);
        }
        printf("\n%s COMMAND --help describes a command; %s --version prints the version.\n\n"
               "Exit codes: %s\n",
               commands->program, commands->program, commands->codes);
        return PM_OK;
    }
    if (strcmp(argv[1], "--version") == 0) {
        printf("%s %s\n", commands->program, PM_VERSION);
        return PM_OK;
    }
    for (int i = 0; i < commands->count; ++i) {
        if (strcmp(argv[1], commands->command[i].name) == 0) {
            return commands->command[i].run(argc - 1, argv + 1, &stop_requested);
        }
    }
    return pm_fail(PM_EUSAGE, "unknown command \"%s\"; %s --help lists them", argv[1],
                   commands->program);
}

int pm_subcommand_end(const char *program, pm_status status) {
    status = status == PM_HELPED ? PM_OK : status;
    if (fflush(stdout) != 0 && status == PM_OK) {
        status = pm_fail(PM_EFILE, "standard output: %s", strerror(errno));
    }
    if (status != PM_OK && pm_error()[0] != 0) {
        fprintf(stderr, "%s: %s\n", program, pm_error());
    }
    return (int)status;
}

int pm_subcommand_main(const pm_subcommands *commands, int argc, char **argv) {
    struct sigaction action, found;
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = request_stop;
    action.sa_flags = commands->second_signal_ends ? (int)SA_RESETHAND : 0;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    if (sigaction(SIGHUP, NULL, &found) != 0 || found.sa_handler != SIG_IGN) {
        sigaction(SIGHUP, &action, NULL);
    }
    action.sa_handler = SIG_IGN;
    action.sa_flags = 0;
    sigaction(SIGPIPE, &action, NULL);
    sigaction(SIGXFSZ, &action, NULL);
    return pm_subcommand_end(commands->program, dispatch(commands, argc, argv));
}
