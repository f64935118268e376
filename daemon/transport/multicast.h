// Tests whether this host can send and receive multicast. The test comes before LCM is opened,
// because LCM prints a page of text to standard error if multicast fails.
#ifndef PM_TRANSPORT_MULTICAST_H
#define PM_TRANSPORT_MULTICAST_H

#include <netinet/in.h>

#include "base/status.h"

// The commands that enable multicast on one host, for error messages.
#define PM_MULTICAST_REMEDY \
    "run \"ip link set lo multicast on\" and \"ip route add 224.0.0.0/4 dev lo\""

// Joins the group at a free port and sends one datagram to itself, which never leaves the host.
// PM_ENET: there is no route, or the datagram does not come back; the error names `url` and the
// remedy.
pm_status pm_multicast_check(const char *url, struct in_addr group);

#endif
