// Sends a datagram to a multicast group and waits for its return.
#include "transport/multicast.h"

#include <errno.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

// On one host a datagram takes microseconds, but a busy machine may wake this process late.
#define ECHO_TIMEOUT 500 // ms

static pm_status fail_route(const char *url, const char *what, const char *why) {
    return pm_fail(PM_ENET, "transport \"%s\": %s: %s; for this host only, " PM_MULTICAST_REMEDY,
                   url, what, why);
}

// Sends one datagram to the group at a free port, and reads it back.
static pm_status echo(int file, const char *url, struct in_addr group) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_ANY)}};
    socklen_t size = sizeof here;
    if (bind(file, (const struct sockaddr *)&here, size) != 0 ||
        getsockname(file, (struct sockaddr *)&here, &size) != 0) {
        return pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    }
    const struct ip_mreq membership = {.imr_multiaddr = group, .imr_interface = {INADDR_ANY}};
    if (setsockopt(file, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) != 0) {
        return fail_route(url, "cannot join the multicast group", strerror(errno));
    }
    const unsigned char ttl = 0;
    setsockopt(file, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
    const struct sockaddr_in there = {AF_INET, here.sin_port, group, {0}};
    if (sendto(file, "", 1, 0, (const struct sockaddr *)&there, sizeof there) != 1) {
        return fail_route(url, "cannot send to the multicast group", strerror(errno));
    }
    struct pollfd readable = {file, POLLIN, 0};
    if (poll(&readable, 1, ECHO_TIMEOUT) != 1) {
        return fail_route(url, "multicast messages do not come back",
                          "a firewall, or an interface without multicast");
    }
    return PM_OK;
}

pm_status pm_multicast_check(const char *url, struct in_addr group) {
    const int file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (file < 0) {
        return pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    }
    const pm_status status = echo(file, url, group);
    close(file);
    return status;
}
