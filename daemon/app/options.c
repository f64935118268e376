// Each subcommand's table of options is the part of one common table that it accepts.
#include "app/options.h"

#include <limits.h>
#include <stdio.h>

#include "base/options.h"

// Options whose values are numbers arrive as text.
typedef struct given_options {
    pm_run_options run;
    const char *steps, *session, *log, *port, *udp;
} given_options;

typedef struct option_row {
    unsigned bit;
    pm_option option;
} option_row;

enum { MOST_OPTIONS = 16, MOST_PORT = 65535 };

static pm_option text_option(const char *name, const char *value, const char **text,
                             const char *help) {
    return (pm_option){.name = name, .value = value, .text = text, .help = help};
}

// Fills table [count] with the accepted options of row [count]; returns their number.
static int choose(unsigned accepts, const option_row *row, size_t count, pm_option *table) {
    int chosen = 0;
    for (size_t i = 0; i < count; ++i) {
        if ((accepts & row[i].bit) != 0) {
            table[chosen++] = row[i].option;
        }
    }
    return chosen;
}

// Fills table [MOST_OPTIONS] with the accepted options; returns their number.
static int list_options(unsigned accepts, given_options *given, pm_option *table) {
    pm_run_options *run = &given->run;
    const option_row rows[] = {
        {PM_OPTION_STEPS,
         text_option("--steps", "N", &given->steps, "compute N steps instead of the scene's")},
        {PM_OPTION_RECORD, text_option("--record", "FILE", &run->record,
                                       "write every state, flux and total to FILE (HDF5)")},
        {PM_OPTION_REPLAY, text_option("--replay", "FILE", &run->replay,
                                       "take the values of live inputs from the recording FILE")},
        {PM_OPTION_OVERWRITE,
         {.name = "--overwrite",
          .on = &run->overwrite,
          .help = "let --record replace a file that is not a recording"}},
        {PM_OPTION_WEIGHTS,
         text_option("--weights", "DIR", &run->weights, "take the weights files from DIR")},
        {PM_OPTION_URL,
         text_option("--url", "URL", &run->url, "LCM provider, or mpi://, instead of the scene's")},
        {PM_OPTION_IN_PROCESS,
         {.name = "--in-process",
          .on = &run->in_process,
          .help = "all subsystems in this process, without LCM"}},
        {PM_OPTION_SESSION,
         text_option("--session", "NUMBER", &given->session,
                     "number of the run, where several of this scene share a network")},
        {PM_OPTION_CHECKPOINT,
         text_option("--checkpoint", "DIR", &run->checkpoint,
                     "keep checkpoints in DIR, and go on from those found there")},
        {PM_OPTION_GATE,
         text_option("--gate", "FILE", &run->gate,
                     "hold the run after the number of steps in FILE until FILE has a larger one")},
        {PM_OPTION_C,
         text_option("--c", "DIR", &run->c_folder, "write a header and a source to DIR")},
        {PM_OPTION_OUTPUT,
         {.name = "--output",
          .brief = "-o",
          .value = "FILE",
          .text = &run->output,
          .help = "write an FMU to FILE"}},
        {PM_OPTION_HOSTS,
         text_option("--hosts", "LIST", &run->hosts,
                     "hosts of the processes, such as a,b or upper=a,lower=b,coordinator=a")},
        {PM_OPTION_FILES,
         {.name = "--output",
          .brief = "-o",
          .value = "PATH",
          .text = &run->output,
          .help = "write to the folder (systemd) or file (procman) PATH"}},
        {PM_OPTION_PROCESSES,
         text_option("--write-processes", "FILE", &run->processes,
                     "cut the scene by measured costs, and write its processes to FILE")},
        {PM_OPTION_LOG, text_option("--log", "FORM", &given->log,
                                    "form of the lines on standard error: text, or json")},
        {PM_OPTION_QUIET, {.name = "--quiet", .on = &run->quiet, .help = "print errors only"}},
    };
    return choose(accepts, rows, sizeof rows / sizeof rows[0], table);
}

// Does the same with the options of views.
static int list_view_options(unsigned accepts, given_options *given, pm_option *table) {
    const option_row rows[] = {
        {PM_OPTION_PORT, text_option("--port", "PORT", &given->port,
                                     "serve the page on this port instead of 8080")},
        {PM_OPTION_BIND, text_option("--bind", "ADDRESS", &given->run.bind,
                                     "serve the page on this address instead of 127.0.0.1")},
        {PM_OPTION_UDP, text_option("--udp", "PORT", &given->udp,
                                    "send all values as JSON to this UDP port of 127.0.0.1")},
        {PM_OPTION_RECORDING, text_option("--recording", "FILE", &given->run.recording,
                                          "show this recording instead of a run")},
    };
    return choose(accepts, rows, sizeof rows / sizeof rows[0], table);
}

// Turns the options whose values are whole numbers from text into numbers.
static pm_status read_counts(given_options *given) {
    pm_run_options *run = &given->run;
    const struct {
        const char *name, *text;
        int64_t most, *result;
    } counts[] = {{"--steps", given->steps, INT_MAX, &run->steps},
                  {"--session", given->session, INT64_MAX, &run->session},
                  {"--port", given->port, MOST_PORT, &run->port},
                  {"--udp", given->udp, MOST_PORT, &run->udp}};
    for (size_t i = 0; i < sizeof counts / sizeof counts[0]; ++i) {
        if (counts[i].text != NULL) {
            PM_TRY(
                pm_options_count(counts[i].name, counts[i].text, counts[i].most, counts[i].result));
        }
    }
    return PM_OK;
}

static pm_status read_options(const pm_command *command, int argc, char **argv,
                              given_options *given, bool *helped) {
    pm_option table[MOST_OPTIONS];
    const int common = list_options(command->accepts, given, table);
    const char *positional[2] = {NULL, NULL};
    char usage[64];
    snprintf(usage, sizeof usage, "portmetd %s %s [options]", argv[0], command->arguments);
    const pm_options options = {
        .usage = usage,
        .summary = command->help,
        .positional_name = command->arguments,
        .positional = positional,
        .count = common + list_view_options(command->accepts, given, table + common),
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv, helped));
    given->run.scene = positional[0];
    given->run.name = positional[1];
    given->run.log.part = positional[1] != NULL ? positional[1] : argv[0];
    PM_TRY(pm_journal_read_form(given->log, &given->run.log.json));
    return read_counts(given);
}

// Writes the error as JSON. The message that is left is empty, so that nobody prints it again.
static pm_status tell_error(const pm_journal *log, pm_status status) {
    const pm_journal_field code = {.name = "code", .number = (double)status};
    pm_journal_write(log, PM_JOURNAL_ERROR, 1, &code, "%s", pm_error());
    return pm_fail(status, "%s", "");
}

pm_status pm_command_execute(const pm_command *command, int argc, char **argv,
                             const volatile sig_atomic_t *stop) {
    given_options given = {.run = {.stop = stop, .log = {.program = "portmetd"}}};
    bool helped = false;
    PM_TRY(read_options(command, argc, argv, &given, &helped));
    const pm_status status = helped ? PM_OK : command->execute(&given.run);
    return status != PM_OK && given.run.log.json ? tell_error(&given.run.log, status) : status;
}
