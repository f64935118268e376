// The subcommands, one file each; main.c lists them. A new one is a file and a line there.
#ifndef PM_APP_COMMAND_H
#define PM_APP_COMMAND_H

#include "app/options.h"

extern const pm_command pm_command_run;
extern const pm_command pm_command_node;
extern const pm_command pm_command_coordinator;
extern const pm_command pm_command_check;

#endif
