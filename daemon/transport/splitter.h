// Publishes LCM messages that are larger than a packet of the network. liblcm would send up to 64
// kB as one datagram, which IP then cuts into fragments; some switches and firewalls drop these,
// and the kernel gives few of them room. A splitter sends LCM's own fragments (datagram.h), each of
// which is a packet, so that every LCM program can join them.
#ifndef PM_TRANSPORT_SPLITTER_H
#define PM_TRANSPORT_SPLITTER_H

#include <stdbool.h>
#include <stddef.h>

#include "transport/lcm_url.h"

typedef struct pm_splitter pm_splitter;

// Opens a socket to the group of `address`, and asks the kernel for the size of the packets on the
// way there. `url` names it in errors. PM_ENET, PM_ENOMEM.
pm_status pm_splitter_open(pm_splitter **splitter, const char *url, const pm_lcm_url *address);
void pm_splitter_close(pm_splitter *splitter); // NULL is allowed

// True if a message of `size` bytes on this channel does not fit into a packet, but into 65535 of
// them.
bool pm_splitter_is_needed(const pm_splitter *splitter, const char *channel, size_t size);

// Sends such a message. Returns 0, or -1 with errno set, as lcm_publish does.
int pm_splitter_publish(pm_splitter *splitter, const char *channel, const void *data, size_t size);

#endif
