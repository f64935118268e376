// Parses an LCM URL: "udpm://GROUP:PORT" or "mpudpm://GROUP:PORT", perhaps with options
// "?NAME=VALUE&NAME=VALUE". Only its form is checked; opening a transport shows whether messages
// get through.
#ifndef PM_TRANSPORT_LCM_URL_H
#define PM_TRANSPORT_LCM_URL_H

#include <netinet/in.h>
#include <stdbool.h>

#include "base/status.h"

typedef struct pm_lcm_url {
    struct sockaddr_in group; // multicast group and port
    int receive_buffer;       // recv_buf_size=N: bytes of the kernel's buffer
    int ttl;                  // ttl=N: hops of a multicast packet; 0, the default: this host alone
    bool receives_itself;     // receive=own (receiver.h; the default of udpm) or receive=lcm
    bool spins;               // spin=yes (spin.h; the default) or spin=no, with receive=own
} pm_lcm_url;

// Ignores options that are LCM's own. PM_ECONFIG: the scheme is another one, the address is not a
// multicast group and a port, or an option above has a bad value.
pm_status pm_lcm_url_parse(const char *url, pm_lcm_url *parsed);

#endif
