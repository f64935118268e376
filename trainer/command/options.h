// The options of the subcommands are those of every program (base/options.h).
#ifndef PM_TRAINER_COMMAND_OPTIONS_H
#define PM_TRAINER_COMMAND_OPTIONS_H

#include "base/options.h"

#endif
