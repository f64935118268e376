// The handler of SIGUSR1. The signal cannot be blocked and taken instead: a thread of OpenBLAS,
// which exists before main does, would receive it.
#include "app/status_request.h"

#include <signal.h>
#include <string.h>

// A mutable global, since a signal handler can reach nothing else.
static volatile sig_atomic_t requested = 0;

static void request(int signal_number) {
    (void)signal_number;
    requested = 1;
}

void pm_status_request_accept(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = request;
    action.sa_flags = SA_RESTART;
    sigaction(SIGUSR1, &action, NULL);
}

bool pm_status_request_take(void) {
    const bool taken = requested != 0;
    requested = 0;
    return taken;
}
