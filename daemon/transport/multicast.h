// Is there a way for multicast? Asked before LCM is, which prints a page to standard error if not.
#ifndef PM_TRANSPORT_MULTICAST_H
#define PM_TRANSPORT_MULTICAST_H

#include <netinet/in.h>

#include "base/status.h"

// What to do when there is none, for error messages.
#define PM_MULTICAST_REMEDY \
    "run \"ip link set lo multicast on\" and \"ip route add 224.0.0.0/4 dev lo\""

// Joins the group at a free port and sends one datagram to itself, which never leaves the host.
// PM_ENET: no route, or the datagram does not come back; the error names `url` and the remedy.
pm_status pm_multicast_check(const char *url, struct in_addr group);

#endif
