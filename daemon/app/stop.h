// Turns SIGINT and SIGTERM into a flag that loops read, so that every process ends through its
// own clean-up.
#ifndef PM_APP_STOP_H
#define PM_APP_STOP_H

#include <signal.h>

// Installs the handlers of SIGINT and SIGTERM, and ignores SIGPIPE. Returns the flag, which exists
// as long as the process. Either signal sets the flag to 1 for good. The system does not restart a
// blocking call that one of these signals interrupts: the call fails with EINTR.
const volatile sig_atomic_t *pm_stop_install(void);

#endif
