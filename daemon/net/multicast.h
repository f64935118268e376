// Is there a way for multicast? Asked before LCM is, which prints a page to standard error if not.
#ifndef PM_NET_MULTICAST_H
#define PM_NET_MULTICAST_H

#include "base/status.h"

// What to do when there is none, for error messages.
#define PM_MULTICAST_REMEDY \
    "run \"ip link set lo multicast on\" and \"ip route add 224.0.0.0/4 dev lo\""

// Checks the address of "SCHEME://GROUP:PORT[?OPTIONS]". PM_ECONFIG: not a multicast group and a
// port.
pm_status pm_multicast_check_address(const char *url);

// The same, then joins the group at a free port and sends one datagram to itself, which never
// leaves the host. PM_ENET: no route, or the datagram does not come back; the error names the
// remedy.
pm_status pm_multicast_check(const char *url);

#endif
