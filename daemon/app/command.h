// The subcommands of portmetd, one file each. Each function gets the name of its subcommand as
// argv[0] and the arguments after it, and returns PM_EINTERRUPTED soon after `*stop` becomes
// non-zero (base/subcommand.h). A new subcommand needs a file, a line here and a line in main.c.
#ifndef PM_APP_COMMAND_H
#define PM_APP_COMMAND_H

#include <signal.h>

#include "app/options.h"

pm_status pm_command_run(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_node(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_coordinator(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_emit(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_export(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_status(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_view(int argc, char **argv, const volatile sig_atomic_t *stop);
pm_status pm_command_check(int argc, char **argv, const volatile sig_atomic_t *stop);

#endif
