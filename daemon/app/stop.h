// SIGINT and SIGTERM as a flag that loops look at, so that every process ends through its own
// clean-up.
#ifndef PM_APP_STOP_H
#define PM_APP_STOP_H

#include <signal.h>

// Set by the handlers; the program's only mutable global, since a signal handler can reach no
// other.
extern volatile sig_atomic_t pm_stop_requested;

// Installs both handlers; a blocking call then returns EINTR. SIGPIPE is ignored.
void pm_stop_install(void);

#endif
