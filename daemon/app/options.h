// The command line: how a subcommand describes itself, its help, and the options it was given.
#ifndef PM_APP_OPTIONS_H
#define PM_APP_OPTIONS_H

#include <stdbool.h>
#include <stdint.h>

#include "base/status.h"

// What a subcommand was given; text points into argv. Absent text is NULL.
typedef struct pm_options {
    const char *scene, *name; // positional
    const char *weights, *url, *record, *checkpoint, *gate;
    int64_t steps;   // 0: as the scene says
    int64_t session; // 0: any
    bool in_process, quiet;
} pm_options;

// Options a subcommand may accept, besides --help.
enum {
    PM_OPTION_STEPS = 1 << 0,
    PM_OPTION_RECORD = 1 << 1,
    PM_OPTION_WEIGHTS = 1 << 2,
    PM_OPTION_URL = 1 << 3,
    PM_OPTION_IN_PROCESS = 1 << 4,
    PM_OPTION_QUIET = 1 << 5,
    PM_OPTION_SESSION = 1 << 6,
    PM_OPTION_CHECKPOINT = 1 << 7,
    PM_OPTION_GATE = 1 << 8
};

typedef struct pm_command {
    const char *name;
    const char *arguments; // positional, "SCENE" or "SCENE NAME"
    const char *summary;   // half a line
    const char *help;      // paragraphs
    unsigned accepts;      // PM_OPTION_... combined
    pm_status (*execute)(const pm_options *options);
} pm_command;

// Parses what follows the subcommand's name (argv[0]). With --help, `help` becomes true and nothing
// else is checked. PM_EUSAGE.
pm_status pm_options_parse(const pm_command *command, int argc, char **argv, pm_options *options,
                           bool *help);

// Prints a subcommand's help to standard output.
void pm_options_print_help(const pm_command *command);

#endif
