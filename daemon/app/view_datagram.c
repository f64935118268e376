// A connected UDP socket.
#include "app/view_datagram.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

pm_status pm_view_datagram_open(int *file, int port) {
    const struct sockaddr_in to = {.sin_family = AF_INET,
                                   .sin_port = htons((uint16_t)port),
                                   .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    const int opened = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (opened < 0 || connect(opened, (const struct sockaddr *)&to, sizeof to) != 0) {
        const pm_status status = pm_fail(PM_ENET, "--udp %d: no socket: %s", port, strerror(errno));
        if (opened >= 0) {
            close(opened);
        }
        return status;
    }
    *file = opened;
    return PM_OK;
}

void pm_view_datagram_send(void *context, const char *text, size_t size) {
    const int *file = context;
    (void)send(*file, text, size, 0);
}
