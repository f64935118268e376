// Finds and runs a subcommand.
#include "base/subcommand.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

static void print_help(const pm_subcommands *commands) {
    printf("Usage: %s COMMAND [arguments]\n\n%s\n\nCommands:\n", commands->program,
           commands->about);
    for (int i = 0; i < commands->count; ++i) {
        printf("  %-12s %s\n", commands->command[i].name, commands->command[i].summary);
    }
    printf("\n%s COMMAND --help describes a command; %s --version prints the version.\n\n"
           "Exit codes: %s\n",
           commands->program, commands->program, commands->codes);
}

static pm_status dispatch(const pm_subcommands *commands, int argc, char **argv,
                          const volatile sig_atomic_t *stop) {
    if (argc < 2) {
        return pm_fail(PM_EUSAGE, "expected a command; %s --help lists them", commands->program);
    }
    if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        print_help(commands);
        return PM_OK;
    }
    if (strcmp(argv[1], "--version") == 0) {
        printf("%s %s\n", commands->program, PM_VERSION);
        return PM_OK;
    }
    for (int i = 0; i < commands->count; ++i) {
        if (strcmp(argv[1], commands->command[i].name) == 0) {
            return commands->command[i].run(argc - 1, argv + 1, stop);
        }
    }
    return pm_fail(PM_EUSAGE, "unknown command \"%s\"; %s --help lists them", argv[1],
                   commands->program);
}

int pm_subcommand_end(const char *program, pm_status status) {
    if (fflush(stdout) != 0 && status == PM_OK) {
        status = pm_fail(PM_EFILE, "standard output: %s", strerror(errno));
    }
    if (status != PM_OK && pm_error()[0] != 0) {
        fprintf(stderr, "%s: %s\n", program, pm_error());
    }
    return (int)status;
}

int pm_subcommand_main(const pm_subcommands *commands, int argc, char **argv,
                       const volatile sig_atomic_t *stop) {
    return pm_subcommand_end(commands->program, dispatch(commands, argc, argv, stop));
}
