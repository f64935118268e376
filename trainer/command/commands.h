// The subcommands of portmet-train. Each one gets its own name as argv[0] and the arguments after
// it, prints its results on standard output, and describes a failure with pm_fail, which main
// prints. `stop` becomes non-zero on SIGINT, SIGTERM or SIGHUP. A long command then ends soon with
// PM_EINTERRUPTED and leaves no file half-written.
#ifndef PM_TRAINER_COMMAND_COMMANDS_H
#define PM_TRAINER_COMMAND_COMMANDS_H

#include <signal.h>

#include "base/status.h"

pm_status pm_command_truth(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_correct(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_contact(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_reconstruct(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_reduce(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_nodes(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_import(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_inspect(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_propose(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_fit(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_evaluate(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_solid(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_respond(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_picture(int argc, char **argv, const volatile sig_atomic_t *stop);

#endif
