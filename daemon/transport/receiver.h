// Receives LCM messages of one multicast group on a socket of this program. Compared with liblcm's
// receiving it saves a thread, a pipe, and a wake-up of every process for every message of the
// group: the kernel delivers only the channels that are subscribed to (channel_filter.h), several
// messages per call, and short waits poll instead of sleeping (spin.h). Publishing stays with
// liblcm.
#ifndef PM_TRANSPORT_RECEIVER_H
#define PM_TRANSPORT_RECEIVER_H

#include "transport/lcm_url.h"
#include "transport/transport.h"

typedef struct pm_receiver pm_receiver;

// Opens a socket and joins the group of `address`. `url` names it in errors. `drops`, which must
// outlive the receiver, counts datagrams that are not in LCM's format. PM_ENET, PM_ENOMEM.
pm_status pm_receiver_open(pm_receiver **receiver, const char *url, const pm_lcm_url *address,
                           pm_drops *drops);
void pm_receiver_close(pm_receiver *receiver); // NULL is allowed

// These functions do what pm_transport_subscribe, pm_transport_wait and pm_transport_file describe.
pm_status pm_receiver_subscribe(pm_receiver *receiver, const char *channel,
                                pm_message_handler *handler, void *context);
pm_status pm_receiver_wait(pm_receiver *receiver, double seconds, int *handled);
int pm_receiver_file(const pm_receiver *receiver);

#endif
