// An LCM address: "udpm://GROUP:PORT" or "mpudpm://GROUP:PORT", or with options
// "?NAME=VALUE&NAME=VALUE". Only the shape: whether messages get through is for the transport to
// tell.
#ifndef PM_TRANSPORT_LCM_URL_H
#define PM_TRANSPORT_LCM_URL_H

#include <netinet/in.h>
#include <stdbool.h>

#include "base/status.h"

typedef struct pm_lcm_url {
    struct sockaddr_in group; // multicast group and port
    int receive_buffer;       // bytes asked of the kernel: recv_buf_size=N
    // receive=own (read by transport/receiver.h, the default of udpm) or receive=lcm (by liblcm).
    bool receives_itself;
    // spin=yes (the default): may wait without sleeping (transport/spin.h), where it receives
    // itself.
    bool spins;
} pm_lcm_url;

// PM_ECONFIG: another scheme, not a multicast group and a port, or one of the options above has a
// bad value. Other options are LCM's.
pm_status pm_lcm_url_parse(const char *url, pm_lcm_url *parsed);

#endif
