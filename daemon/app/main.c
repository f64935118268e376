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

static pm_option text_option(const char *name, const char *value, const char **text,
                             const char *help) {
    return (pm_option){.name = name, .value = value, .text = text, .help = help};
}

static pm_option count_option(const char *name, const char *value, int64_t most, int64_t *count,
                              const char *help) {
    return (pm_option){
        .name = name, .value = value, .count = count, .least = 1, .most = most, .help = help};
}

static pm_option number_option(const char *name, const char *value, double *number,
                               const char *help) {
    return (pm_option){.name = name, .value = value, .positive = number, .help = help};
}

static pm_option switch_option(const char *name, bool *on, const char *help) {
    return (pm_option){.name = name, .on = on, .help = help};
}

static pm_option output_option(const char *name, const char *brief, const char *value,
                               const char **path, bool is_file, const char *help) {
    return (pm_option){.name = name,
                       .brief = brief,
                       .value = value,
                       .text = path,
                       .help = help,
                       .is_output = is_file};
}

// Fills table [MOST_OPTIONS] with the accepted options; returns their number.
static int list_options(unsigned accepts, pm_run_options *run, const char **form,
                        pm_option *table) {
    const struct {
        unsigned any; // of these bits
        pm_option option;
    } row[MOST_OPTIONS] = {
        {PM_OPTION_STEPS, count_option("--steps", "N", INT_MAX, &run->steps,
                                       "compute N steps instead of the scene's")},
        {PM_OPTION_RECORD, text_option("--record", "FILE", &run->record,
                                       "write every state, flux and total to FILE (HDF5)")},
        {PM_OPTION_REPLAY, text_option("--replay", "FILE", &run->replay,
                                       "take the values of live inputs from the recording FILE")},
        {PM_OPTION_OVERWRITE, switch_option("--overwrite", &run->overwrite,
                                            "let --record replace a file that is not a recording")},
        {PM_OPTION_WEIGHTS,
         text_option("--weights", "DIR", &run->weights, "take the weights files from DIR")},
        {PM_OPTION_COMPILED,
         switch_option("--compiled", &run->compiled,
                       "compile the models to machine code, which is kept in ~/.cache/portmet")},
        {PM_OPTION_URL,
         text_option("--url", "URL", &run->url, "LCM provider, or mpi://, instead of the scene's")},
        {PM_OPTION_IN_PROCESS, switch_option("--in-process", &run->in_process,
                                             "all subsystems in this process, without LCM")},
        {PM_OPTION_TOGETHER,
         switch_option(
             "--in-process", &run->in_process,
             "all subsystems in this process: only what clients ask for crosses the network")},
        {PM_OPTION_IN_PROCESS,
         count_option("--copies", "N", INT_MAX, &run->copies,
                      "run N copies of the scene in this process, and compare their ends")},
        {PM_OPTION_IN_PROCESS,
         text_option("--starts", "FILE", &run->starts,
                     "start each copy in the first state of a trajectory of FILE (HDF5)")},
        {PM_OPTION_SESSION,
         count_option("--session", "NUMBER", INT64_MAX, &run->session,
                      "number of the run, where several of this scene share a network")},
        {PM_OPTION_CHECKPOINT,
         text_option("--checkpoint", "DIR", &run->checkpoint,
                     "keep checkpoints in DIR, and go on from those found there")},
        {PM_OPTION_C,
         text_option("--c", "DIR", &run->c_folder, "write a header and a source to DIR")},
        {PM_OPTION_OUTPUT,
         output_option("--output", "-o", "FILE", &run->output, false, "write an FMU to FILE")},
        {PM_OPTION_OUTPUT,
         text_option("--fmi", "VERSION", &run->fmi, "version of the FMU: 2 or 3; by default 3")},
        {PM_OPTION_OUTPUT,
         text_option("--author", "NAME", &run->author, "author of the FMU's model")},
        {PM_OPTION_HOSTS,
         text_option("--hosts", "LIST", &run->hosts,
                     "hosts of the processes, such as a,b or upper=a,lower=b,coordinator=a")},
        {PM_OPTION_FILES, output_option("--output", "-o", "PATH", &run->output, false,
                                        "write to the folder (systemd) or file (procman) PATH")},
        {PM_OPTION_LOG,
         text_option("--log", "FORM", form, "form of the lines on standard error: text, or json")},
        {PM_OPTION_QUIET, switch_option("--quiet", &run->quiet, "print errors only")},
        {PM_OPTION_PORT, count_option("--port", "PORT", MOST_PORT, &run->port,
                                      "serve the page on this port instead of 8080")},
        {PM_OPTION_BIND, text_option("--bind", "ADDRESS", &run->bind,
                                     "serve the page on this address instead of 127.0.0.1")},
        {PM_OPTION_UDP, count_option("--udp", "PORT", MOST_PORT, &run->udp,
                                     "send all values as JSON to this UDP port of 127.0.0.1")},
        {PM_OPTION_STAYS,
         switch_option("--serve", &run->stays, "serve one run after another, as long as it takes")},
        {PM_OPTION_ELSEWHERE,
         switch_option("--elsewhere", &run->elsewhere,
                       "launch no nodes: they run elsewhere, with node --serve")},
        {PM_OPTION_FOLDER, text_option("--record", "DIR", &run->record,
                                       "let clients record their runs in the folder DIR")},
        {PM_OPTION_START,
         switch_option("--endless", &run->endless, "run until the run is stopped")},
        {PM_OPTION_START, switch_option("--wait", &run->wait, "wait until the run has ended")},
        {PM_OPTION_START,
         text_option("--pace", "X", &run->pace, "simulate X s in each s; 0: as fast as it can be")},
        {PM_OPTION_START, text_option("--record", "NAME", &run->record,
                                      "record the run as NAME in the folder of the service")},
        {PM_OPTION_HELD, switch_option("--held", &run->held, "hold the run at its start")},
        {PM_OPTION_STATE,
         text_option("--state", "LIST", &run->state, "these numbers, in the order of query")},
        {PM_OPTION_TRAJECTORY,
         text_option("--trajectory", "K", &run->trajectory,
                     "start at the first state of trajectory K, from 0, of the reference")},
        {PM_OPTION_TRAJECTORY,
         text_option("--data", "FILE", &run->data, "take the trajectory from FILE (HDF5) instead")},
        {PM_OPTION_INPUTS, text_option("--inputs", "LIST", &run->inputs,
                                       "values of the live inputs, in the order of query")},
        {PM_OPTION_RECORDING, text_option("--recording", "FILE", &run->recording,
                                          "show this recording instead of a run")},
        {PM_OPTION_ELSEWHERE, text_option("--control", "view", &run->control,
                                          "let `portmetd view` start, hold and step runs")},
        {PM_OPTION_TEST,
         switch_option("--here", &run->here, "use the network that is there, not a private one")},
        {PM_OPTION_TEST, text_option("--other", "DIR", &run->other,
                                     "let the last process take its weights from DIR, as on "
                                     "another host")},
        {PM_OPTION_ERROR, number_option("--error", "PERCENT", &run->error,
                                        "give advice for this error instead of 0.01 %")},
        {PM_OPTION_ERROR,
         switch_option("--processes", &run->processes,
                       "measure cuts into processes, and windows, instead of integrators")},
        {PM_OPTION_STUDY, number_option("--budget", "SECONDS", &run->budget,
                                        "take at most this time, 60 s by default")},
        {PM_OPTION_STUDY,
         count_option("--seed", "N", INT_MAX, &run->seed, "take other random starts")},
        {PM_OPTION_STUDY, output_option("--write", NULL, "FILE", &run->write, true,
                                        "write the scene that is advised, or that breaks")},
        {PM_OPTION_STUDY, output_option("--picture", NULL, "NAME", &run->picture, true,
                                        "draw NAME.png and NAME.svg by gnuplot")},
        {PM_OPTION_TEST | PM_OPTION_STUDY,
         switch_option("--json", &run->json, "print results as JSON")},
    };
    int count = 0;
    for (int i = 0; i < MOST_OPTIONS; ++i) {
        if ((accepts & row[i].any) != 0) {
            table[count++] = row[i].option;
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
