// The server of a program that was built without libwebsockets: there is none.
#include "app/view_server.h"

pm_status pm_view_server_open(pm_view_server **server, const char *address, int port,
                              pm_view_next *next, void *context) {
    (void)server, (void)address, (void)next, (void)context;
    return pm_fail(PM_ENET,
                   "no page on port %d: this portmetd was built without libwebsockets "
                   "(libwebsockets-dev); --udp works without it",
                   port);
}

void pm_view_server_close(pm_view_server *server) {
    (void)server;
}

pm_status pm_view_server_serve(pm_view_server *server, double seconds,
                               const volatile sig_atomic_t *stop) {
    (void)server, (void)seconds, (void)stop;
    return PM_OK;
}

void pm_view_server_wake(pm_view_server *server) {
    (void)server;
}
