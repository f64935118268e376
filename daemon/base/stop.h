// Turns SIGINT, SIGTERM and SIGHUP into a flag that loops read, so that every process ends through
// its own clean-up.
#ifndef PM_BASE_STOP_H
#define PM_BASE_STOP_H

#include <signal.h>
#include <stdbool.h>

// The effect of a second signal: it is ignored, or it ends the process at once.
typedef enum pm_stop_second { PM_STOP_SECOND_IGNORED, PM_STOP_SECOND_ENDS } pm_stop_second;

// Installs the handlers of SIGINT, SIGTERM and SIGHUP. SIGHUP stays ignored where it is ignored
// already, so that nohup has its effect. Ignores SIGPIPE and SIGXFSZ: their causes are reported as
// errors of the write that they belong to. Returns the flag, which exists as long as the process.
// Each of the three signals sets the flag to 1 for good. The system does not restart a blocking
// call that one of them interrupts: the call fails with EINTR.
const volatile sig_atomic_t *pm_stop_install(pm_stop_second second);

#endif
