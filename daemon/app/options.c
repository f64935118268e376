// One table of options serves every subcommand: it is what getopt_long reads and what help prints.
#include "app/options.h"

#include <errno.h>
#include <getopt.h>
#include <inttypes.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct option_row {
    const char *name, *argument, *help; // argument NULL: a flag
    unsigned bit;                       // 0: accepted by all
} option_row;

static const option_row rows[] = {
    {"steps", "N", "compute N steps instead of the scene's", PM_OPTION_STEPS},
    {"record", "FILE", "write every state, flux and total to FILE (HDF5)", PM_OPTION_RECORD},
    {"weights", "DIR", "take the weights files from DIR", PM_OPTION_WEIGHTS},
    {"url", "URL", "LCM provider instead of the scene's", PM_OPTION_URL},
    {"in-process", NULL, "all subsystems in this process, without LCM", PM_OPTION_IN_PROCESS},
    {"session", "NUMBER", "the run to join or to open, where several share a network",
     PM_OPTION_SESSION},
    {"checkpoint", "DIR", "keep in DIR what is needed to go on after a death, and go on from it",
     PM_OPTION_CHECKPOINT},
    {"gate", "FILE", "hold the run after as many steps as FILE says, until it says more",
     PM_OPTION_GATE},
    {"quiet", NULL, "print errors only", PM_OPTION_QUIET},
    {"help", NULL, "show this help", 0},
};
#define ROWS ((int)(sizeof rows / sizeof rows[0]))

static bool accepted(const pm_command *command, const option_row *row) {
    return row->bit == 0 || (command->accepts & row->bit) != 0;
}

static pm_status parse_count(const char *option, const char *text, int64_t high, int64_t *count) {
    char *end;
    errno = 0;
    const long long value = strtoll(text, &end, 10);
    if (errno != 0 || end == text || *end != 0 || value < 1 || value > high) {
        return pm_fail(PM_EUSAGE, "%s: expected a whole number from 1 to %" PRId64 ", found \"%s\"",
                       option, high, text);
    }
    *count = value;
    return PM_OK;
}

static pm_status store(unsigned bit, const char *argument, pm_options *options) {
    switch (bit) {
    case PM_OPTION_STEPS:
        return parse_count("--steps", argument, INT_MAX, &options->steps);
    case PM_OPTION_SESSION:
        return parse_count("--session", argument, INT64_MAX, &options->session);
    case PM_OPTION_RECORD:
        options->record = argument;
        break;
    case PM_OPTION_CHECKPOINT:
        options->checkpoint = argument;
        break;
    case PM_OPTION_GATE:
        options->gate = argument;
        break;
    case PM_OPTION_WEIGHTS:
        options->weights = argument;
        break;
    case PM_OPTION_URL:
        options->url = argument;
        break;
    case PM_OPTION_IN_PROCESS:
        options->in_process = true;
        break;
    case PM_OPTION_QUIET:
        options->quiet = true;
        break;
    }
    return PM_OK;
}

// The table as getopt_long wants it; `val` is the row's number plus one.
static void fill_getopt(const pm_command *command, struct option *table) {
    int count = 0;
    for (int i = 0; i < ROWS; ++i) {
        if (accepted(command, &rows[i])) {
            const int takes = rows[i].argument == NULL ? no_argument : required_argument;
            table[count++] = (struct option){rows[i].name, takes, NULL, i + 1};
        }
    }
    table[count] = (struct option){NULL, 0, NULL, 0};
}

static pm_status fail_option(const pm_command *command, bool unknown, const char *word) {
    // A short option leaves its letter in optopt, and may stand anywhere in its word.
    const char letter[] = {'-', (char)optopt, 0};
    return pm_fail(PM_EUSAGE, "%s: %s %s (portmetd %s --help)", command->name,
                   unknown ? "does not know" : "an argument must follow",
                   optopt > ROWS ? letter : word, command->name);
}

static pm_status parse_positional(const pm_command *command, int count, char **argument,
                                  pm_options *options) {
    const int expected = strchr(command->arguments, ' ') == NULL ? 1 : 2;
    if (count != expected) {
        return pm_fail(PM_EUSAGE, "%s: expected %s, found %d argument%s (portmetd %s --help)",
                       command->name, command->arguments, count, count == 1 ? "" : "s",
                       command->name);
    }
    options->scene = argument[0];
    options->name = expected == 2 ? argument[1] : NULL;
    return PM_OK;
}

pm_status pm_options_parse(const pm_command *command, int argc, char **argv, pm_options *options,
                           bool *help) {
    struct option table[ROWS + 1];
    fill_getopt(command, table);
    pm_options parsed = {0};
    opterr = 0;
    optind = 1;
    int value;
    while ((value = getopt_long(argc, argv, ":h", table, NULL)) != -1) {
        if (value == '?' || value == ':') {
            return fail_option(command, value == '?', argv[optind - 1]);
        }
        if (value == 'h' || rows[value - 1].bit == 0) {
            *help = true;
            return PM_OK;
        }
        PM_TRY(store(rows[value - 1].bit, optarg, &parsed));
    }
    PM_TRY(parse_positional(command, argc - optind, argv + optind, &parsed));
    *options = parsed;
    return PM_OK;
}

void pm_options_print_help(const pm_command *command) {
    printf("Usage: portmetd %s %s [options]\n\n%s\nOptions:\n", command->name, command->arguments,
           command->help);
    for (int i = 0; i < ROWS; ++i) {
        if (accepted(command, &rows[i])) {
            char left[32];
            snprintf(left, sizeof left, "--%s %s", rows[i].name,
                     rows[i].argument == NULL ? "" : rows[i].argument);
            printf("  %-16s %s\n", left, rows[i].help);
        }
    }
}
