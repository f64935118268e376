// The subcommands of portmet-train. Each one gets its own name as argv[0] and the arguments after
// it, prints its results on standard output, and describes a failure with pm_fail, which main
// prints. `stop` becomes non-zero on SIGINT, SIGTERM or SIGHUP. A long command then ends soon with
// PM_EINTERRUPTED and leaves no file half-written.
#ifndef PM_TRAINER_COMMAND_COMMANDS_H
#define PM_TRAINER_COMMAND_COMMANDS_H

#include <signal.h>

#include "base/status.h"
#include "truth/truth.h"

// `more` are the simulators beside those of the core, as pm_truth_load expects them.
pm_status pm_command_truth(const pm_truth_simulator *more, int argc, char **argv,
                           const volatile sig_atomic_t *stop);
pm_status pm_command_import(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_inspect(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_propose(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_fit(int argc, char **argv, const volatile sig_atomic_t *stop);
// Reads the option --budget, s, which may end in "s"; NULL leaves *seconds as it is. PM_EUSAGE.
pm_status pm_command_budget(const char *text, double *seconds);
pm_status pm_command_evaluate(int argc, char **argv, const volatile sig_atomic_t *stop);

#endif
