// Requests for the state of a run by the signal SIGUSR1.
#ifndef PM_APP_STATUS_REQUEST_H
#define PM_APP_STATUS_REQUEST_H

#include <stdbool.h>

// Installs a handler that notes SIGUSR1 instead of letting it end the process. To be called at the
// start. System calls that the signal interrupts are restarted where that is possible.
void pm_status_request_accept(void);

// Returns true if SIGUSR1 has come since the last call.
bool pm_status_request_take(void);

#endif
