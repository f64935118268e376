// portmetd: finds the subcommand, reads its options and executes it.
#include <limits.h>
#include <stdio.h>
#include <string.h>

#include "app/command.h"
#include "app/observer.h"
#include "base/linalg.h"
#include "base/options.h"
#include "base/subcommand.h"

static const pm_command *const commands[] = {
    &pm_command_run,     &pm_command_serve,   &pm_command_start,       &pm_command_pause,
    &pm_command_resume,  &pm_command_advance, &pm_command_set,         &pm_command_reset,
    &pm_command_stop,    &pm_command_query,   &pm_command_reload,      &pm_command_checkpoint,
    &pm_command_restore, &pm_command_node,    &pm_command_coordinator, &pm_command_status,
    &pm_command_view,    &pm_command_export,  &pm_command_emit,        &pm_command_check,
    &pm_command_test,    &pm_command_bench,   &pm_command_stress,
};
enum { NCOMMAND = sizeof commands / sizeof commands[0], MOST_OPTIONS = 47, MOST_PORT = 65535 };

// Whether a word is one of a list.
static bool is_word(const char *list, const char *word) {
    const size_t length = strlen(word);
    for (const char *at = list; (at = strstr(at, word)) != NULL; at += length) {
        if ((at == list || at[-1] == ' ') && (at[length] == ' ' || at[length] == '\0')) {
            return true;
        }
    }
    return false;
}

// Fills table [MOST_OPTIONS] with the accepted options; returns their number.
static int list_options(const char *accepts, pm_run_options *run, const char **form,
                        pm_option *table) {
    const pm_option row[] = {
        {"--steps", .word = "steps", .value = "N", .count = &run->steps, .least = 1,
         .most = INT_MAX, .help = "compute N steps instead of the scene's"},
        {"--record", .word = "record", .value = "FILE", .text = &run->record,
         .help = "write every state, flux and total to FILE (HDF5)"},
        {"--replay", .word = "replay", .value = "FILE", .text = &run->replay,
         .help = "take the values of live inputs from the recording FILE"},
        {"--overwrite", .word = "overwrite", .on = &run->overwrite,
         .help = "let --record replace a file that is not a recording"},
        {"--weights", .word = "weights", .value = "DIR", .text = &run->weights,
         .help = "take the weights files from DIR"},
        {"--compiled", .word = "compiled", .on = &run->compiled,
         .help = "compile the models to machine code, which is kept in ~/.cache/portmet"},
        {"--url", .word = "url", .value = "URL", .text = &run->url,
         .help = "LCM provider, or mpi://, instead of the scene's"},
        {"--in-process", .word = "in_process", .on = &run->in_process,
         .help = "all subsystems in this process, without LCM"},
        {"--in-process", .word = "together", .on = &run->in_process,
         .help = "all subsystems in this process: only what clients ask for crosses the network"},
        {"--copies", .word = "in_process", .value = "N", .count = &run->copies, .least = 1,
         .most = INT_MAX,
         .help = "run N copies of the scene in this process, and compare their ends"},
        {"--starts", .word = "in_process", .value = "FILE", .text = &run->starts,
         .help = "start each copy in the first state of a trajectory of FILE (HDF5)"},
        {"--session", .word = "session", .value = "NUMBER", .count = &run->session, .least = 1,
         .most = INT64_MAX,
         .help = "number of the run, where several of this scene share a network"},
        {"--checkpoint", .word = "checkpoint", .value = "DIR", .text = &run->checkpoint,
         .help = "keep checkpoints in DIR, and go on from those found there"},
        {"--c", .word = "c", .value = "DIR", .text = &run->c_folder,
         .help = "write a header and a source to DIR"},
        {"--output", .word = "output", .brief = "-o", .value = "FILE", .text = &run->output,
         .help = "write an FMU to FILE"},
        {"--fmi", .word = "output", .value = "VERSION", .text = &run->fmi,
         .help = "version of the FMU: 2 or 3; by default 3"},
        {"--author", .word = "output", .value = "NAME", .text = &run->author,
         .help = "author of the FMU's model"},
        {"--hosts", .word = "hosts", .value = "LIST", .text = &run->hosts,
         .help = "hosts of the processes, such as a,b or upper=a,lower=b,coordinator=a"},
        {"--output", .word = "files", .brief = "-o", .value = "PATH", .text = &run->output,
         .help = "write to the folder (systemd) or file (procman) PATH"},
        {"--log", .word = "log", .value = "FORM", .text = form,
         .help = "form of the lines on standard error: text, or json"},
        {"--quiet", .word = "quiet", .on = &run->quiet, .help = "print errors only"},
        {"--port", .word = "port", .value = "PORT", .count = &run->port, .least = 1,
         .most = MOST_PORT, .help = "serve the page on this port instead of 8080"},
        {"--bind", .word = "bind", .value = "ADDRESS", .text = &run->bind,
         .help = "serve the page on this address instead of 127.0.0.1"},
        {"--udp", .word = "udp", .value = "PORT", .count = &run->udp, .least = 1, .most = MOST_PORT,
         .help = "send all values as JSON to this UDP port of 127.0.0.1"},
        {"--serve", .word = "stays", .on = &run->stays,
         .help = "serve one run after another, as long as it takes"},
        {"--elsewhere", .word = "elsewhere", .on = &run->elsewhere,
         .help = "launch no nodes: they run elsewhere, with node --serve"},
        {"--record", .word = "folder", .value = "DIR", .text = &run->record,
         .help = "let clients record their runs in the folder DIR"},
        {"--endless", .word = "start", .on = &run->endless, .help = "run until the run is stopped"},
        {"--wait", .word = "start", .on = &run->wait, .help = "wait until the run has ended"},
        {"--pace", .word = "start", .value = "X", .text = &run->pace,
         .help = "simulate X s in each s; 0: as fast as it can be"},
        {"--record", .word = "start", .value = "NAME", .text = &run->record,
         .help = "record the run as NAME in the folder of the service"},
        {"--held", .word = "held", .on = &run->held, .help = "hold the run at its start"},
        {"--state", .word = "state", .value = "LIST", .text = &run->state,
         .help = "these numbers, in the order of query"},
        {"--trajectory", .word = "trajectory", .value = "K", .text = &run->trajectory,
         .help = "start at the first state of trajectory K, from 0, of the reference"},
        {"--data", .word = "trajectory", .value = "FILE", .text = &run->data,
         .help = "take the trajectory from FILE (HDF5) instead"},
        {"--inputs", .word = "inputs", .value = "LIST", .text = &run->inputs,
         .help = "values of the live inputs, in the order of query"},
        {"--recording", .word = "recording", .value = "FILE", .text = &run->recording,
         .help = "show this recording instead of a run"},
        {"--control", .word = "elsewhere", .value = "view", .text = &run->control,
         .help = "let `portmetd view` start, hold and step runs"},
        {"--here", .word = "test", .on = &run->here,
         .help = "use the network that is there, not a private one"},
        {"--other", .word = "test", .value = "DIR", .text = &run->other,
         .help = "let the last process take its weights from DIR, as on "
                 "another host"},
        {"--error", .word = "error", .value = "PERCENT", .positive = &run->error,
         .help = "give advice for this error instead of 0.01 %"},
        {"--processes", .word = "error", .on = &run->processes,
         .help = "measure cuts into processes, and windows, instead of integrators"},
        {"--budget", .word = "study", .value = "SECONDS", .positive = &run->budget,
         .help = "take at most this time, 60 s by default"},
        {"--seed", .word = "study", .value = "N", .count = &run->seed, .least = 1, .most = INT_MAX,
         .help = "take other random starts"},
        {"--write", .word = "study", .value = "FILE", .text = &run->write,
         .help = "write the scene that is advised, or that breaks", .is_output = true},
        {"--picture", .word = "study", .value = "NAME", .text = &run->picture,
         .help = "draw NAME.png and NAME.svg by gnuplot", .is_output = true},
        {"--json", .word = "json", .on = &run->json, .help = "print results as JSON"},
    };
    int count = 0;
    _Static_assert(sizeof row / sizeof *row <= MOST_OPTIONS, "the table has room for all options");
    for (size_t i = 0; i < sizeof row / sizeof *row; ++i) {
        if (is_word(accepts, row[i].word)) {
            table[count++] = row[i];
        }
    }
    return count;
}

// Reads the options of the command argv[0] and executes it, or prints its help.
static pm_status execute(int argc, char **argv, const volatile sig_atomic_t *stop) {
    pm_run_options given = {.stop = stop, .log = {.program = "portmetd"}}, *run = &given;
    const char *form = NULL;
    const pm_command *const *found = commands;
    while (strcmp((*found)->name, argv[0]) != 0) {
        ++found;
    }
    const pm_command *command = *found;
    pm_option table[MOST_OPTIONS];
    const char *positional[2] = {NULL, NULL};
    char usage[64];
    snprintf(usage, sizeof usage, "portmetd %s %s [options]", argv[0], command->arguments);
    const pm_options options = {
        .usage = usage,
        .summary = command->help,
        .examples = command->examples,
        .positional_name = command->arguments,
        .positional = positional,
        .count = list_options(command->accepts, run, &form, table),
        .option = table,
    };
    PM_TRY(pm_options_read(&options, argc, argv));
    run->scene = positional[0];
    run->name = positional[1];
    run->log.part = positional[1] != NULL ? positional[1] : argv[0];
    PM_TRY(pm_journal_read_form(form, &run->log.json));
    run->address = run->session;
    const pm_status status = command->execute(run);
    if (status != PM_OK && run->log.json) {
        const pm_journal_field code = {.name = "code", .number = (double)status};
        pm_journal_write(&run->log, PM_JOURNAL_ERROR, 1, &code, "%s", pm_error());
        return pm_fail(status, "%s", ""); // so that nobody prints the message again
    }
    return status;
}

int main(int argc, char **argv) {
    pm_subcommand list[NCOMMAND];
    for (int i = 0; i < NCOMMAND; ++i) {
        list[i] = (pm_subcommand){commands[i]->name, commands[i]->summary, execute};
    }
    const pm_subcommands program = {
        .program = "portmetd",
        .about = "Serves learned thermodynamic subsystems over LCM: one process per subsystem, "
                 "energy and\nentropy fluxes between neighbours. Models of the default form "
                 "conserve energy, and\ntheir entropy never falls, whatever their weights are.",
        .codes = "0 success, 2 command line, 3 scene, 4 file, 5 dataset, 6 weights,\n"
                 "7 transport, 8 silent peer, 9 non-finite value, 10 law violated, 11 memory,\n"
                 "12 interrupted, 14 a scene under study has not held.",
        .count = NCOMMAND,
        .command = list,
    };
    pm_status_install();
    pm_linalg_init();
    return pm_subcommand_main(&program, argc, argv);
}
