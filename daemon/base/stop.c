// The signal handlers.
#include "base/stop.h"

#include <string.h>

// The only mutable global: a signal handler can reach nothing else.
static volatile sig_atomic_t requested = 0;

static void request_stop(int signal_number) {
    (void)signal_number;
    requested = 1;
}

static bool is_ignored(int signal_number) {
    struct sigaction found;
    return sigaction(signal_number, NULL, &found) == 0 && found.sa_handler == SIG_IGN;
}

const volatile sig_atomic_t *pm_stop_install(pm_stop_second second) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    sigemptyset(&action.sa_mask);
    action.sa_handler = request_stop;
    action.sa_flags = second == PM_STOP_SECOND_ENDS ? (int)SA_RESETHAND : 0;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    if (!is_ignored(SIGHUP)) {
        sigaction(SIGHUP, &action, NULL);
    }
    action.sa_handler = SIG_IGN;
    action.sa_flags = 0;
    sigaction(SIGPIPE, &action, NULL);
    sigaction(SIGXFSZ, &action, NULL);
    return &requested;
}
