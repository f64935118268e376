// The skeleton of a program with subcommands: it finds the subcommand, runs it, and prints the
// error if there is one. The calling main adds only its table.
#ifndef PM_BASE_SUBCOMMAND_H
#define PM_BASE_SUBCOMMAND_H

#include <signal.h>
#include <stdbool.h>

#include "base/status.h"

typedef struct pm_subcommand {
    const char *name;
    const char *summary; // half a line
    // Gets its own name as argv[0] and the arguments after it. Prints its results on standard
    // output and describes a failure with pm_fail. `stop` becomes non-zero when the user interrupts
    // the program; the command then ends soon with PM_EINTERRUPTED and leaves nothing half-written.
    pm_status (*run)(int argc, char **argv, const volatile sig_atomic_t *stop);
} pm_subcommand;

typedef struct pm_subcommands {
    const char *program;     // such as "portmetd"
    const char *about;       // a paragraph for the help
    const char *codes;       // the exit codes, for the help
    bool second_signal_ends; // a second signal of a kind ends the process at once
    int count;
    const pm_subcommand *command; // [count]
} pm_subcommands;

// Runs the subcommand that argv[1] names, or answers --help or --version. Prints one line on
// standard error if that fails. Returns the exit code of the program, a pm_status.
//
// SIGINT, SIGTERM and SIGHUP set the flag `stop` of the subcommand to 1 for good, so that every
// process ends through its own clean-up. SIGHUP stays ignored where it is ignored already, so that
// nohup has its effect. SIGPIPE and SIGXFSZ are ignored: their causes are reported as errors of the
// write that they belong to. The system does not restart a blocking call that one of the three
// signals interrupts: the call fails with EINTR.
int pm_subcommand_main(const pm_subcommands *commands, int argc, char **argv);

// Ends what `program` does with `status`: writes what is left of standard output, and prints one
// line on standard error if that or the program failed, unless the message is empty because it was
// written before (base/journal.h). Returns the exit code, a pm_status.
int pm_subcommand_end(const char *program, pm_status status);

#endif
