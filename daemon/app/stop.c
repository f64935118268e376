// The signal handlers.
#include "app/stop.h"

#include <string.h>

// The only mutable global: a signal handler can reach nothing else.
static volatile sig_atomic_t requested = 0;

static void request_stop(int signal_number) {
    (void)signal_number;
    requested = 1;
}

const volatile sig_atomic_t *pm_stop_install(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = request_stop;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    action.sa_handler = SIG_IGN;
    sigaction(SIGPIPE, &action, NULL);
    return &requested;
}
