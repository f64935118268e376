// Checks an LCM address and the way to its multicast group.
#include "net/multicast.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

// On one host a datagram takes microseconds; a busy machine may take its time to wake us.
#define ECHO_TIMEOUT 500 // ms

// ":PORT", then the end or options.
static bool is_port(const char *text) {
    if (*text != ':') {
        return false;
    }
    const size_t count = strspn(text + 1, "0123456789");
    const char *end = text + 1 + count;
    const long port = strtol(text + 1, NULL, 10);
    return count > 0 && port >= 1 && port <= 65535 && (*end == 0 || *end == '?');
}

// Reads the group, and checks that a port follows.
static pm_status parse(const char *url, struct in_addr *group) {
    const char *address = strstr(url, "://") + 3;
    const size_t host_size = strcspn(address, ":?");
    char host[INET_ADDRSTRLEN] = "";
    if (host_size < sizeof host) {
        memcpy(host, address, host_size);
    }
    if (inet_pton(AF_INET, host, group) != 1 || !IN_MULTICAST(ntohl(group->s_addr))) {
        return pm_fail(PM_ECONFIG,
                       "transport \"%s\": expected an IPv4 multicast group, 224.0.0.0 to "
                       "239.255.255.255",
                       url);
    }
    if (!is_port(address + host_size)) {
        return pm_fail(PM_ECONFIG,
                       "transport \"%s\": expected a port from 1 to 65535 after the group, as in "
                       "udpm://239.255.76.67:7667",
                       url);
    }
    return PM_OK;
}

pm_status pm_multicast_check_address(const char *url) {
    struct in_addr group;
    return parse(url, &group);
}

static pm_status no_way(const char *url, const char *what, const char *why) {
    return pm_fail(PM_ENET, "transport \"%s\": %s: %s; for this host only, " PM_MULTICAST_REMEDY,
                   url, what, why);
}

// Sends one datagram to the group at a port of our own, and reads it back.
static pm_status echo(int file, const char *url, struct in_addr group) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_ANY)}};
    socklen_t size = sizeof here;
    if (bind(file, (const struct sockaddr *)&here, size) != 0 ||
        getsockname(file, (struct sockaddr *)&here, &size) != 0) {
        return pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    }
    const struct ip_mreq membership = {.imr_multiaddr = group, .imr_interface = {INADDR_ANY}};
    if (setsockopt(file, IPPROTO_IP, IP_ADD_MEMBERSHIP, &membership, sizeof membership) != 0) {
        return no_way(url, "cannot join the multicast group", strerror(errno));
    }
    const unsigned char ttl = 0;
    setsockopt(file, IPPROTO_IP, IP_MULTICAST_TTL, &ttl, sizeof ttl);
    const struct sockaddr_in there = {AF_INET, here.sin_port, group, {0}};
    if (sendto(file, "", 1, 0, (const struct sockaddr *)&there, sizeof there) != 1) {
        return no_way(url, "cannot send to the multicast group", strerror(errno));
    }
    struct pollfd readable = {file, POLLIN, 0};
    if (poll(&readable, 1, ECHO_TIMEOUT) != 1) {
        return no_way(url, "multicast messages do not come back",
                      "a firewall, or an interface without multicast");
    }
    return PM_OK;
}

pm_status pm_multicast_check(const char *url) {
    struct in_addr group;
    PM_TRY(parse(url, &group));
    const int file = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (file < 0) {
        return pm_fail(PM_ENET, "transport \"%s\": no socket: %s", url, strerror(errno));
    }
    const pm_status status = echo(file, url, group);
    close(file);
    return status;
}
