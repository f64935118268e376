// Turns SIGINT and SIGTERM into a flag that loops read, so that every process ends through its
// own clean-up.
#ifndef PM_APP_STOP_H
#define PM_APP_STOP_H

#include <signal.h>

// Installs the handlers and ignores SIGPIPE. Returns the flag, which the handlers make non-zero. A
// blocking system call then returns EINTR.
const volatile sig_atomic_t *pm_stop_install(void);

#endif
