// Receives LCM messages on a socket of our own, for what liblcm's receiving costs: a thread, a pipe
// and a wake-up of every process for every message of the group. Here the kernel hands over only
// the wanted channels (channel_filter.h), several messages per call, and waits begin without sleep
// where that pays (spin.h). Publishing stays with liblcm.
#ifndef PM_TRANSPORT_RECEIVER_H
#define PM_TRANSPORT_RECEIVER_H

#include "transport/lcm_url.h"
#include "transport/transport.h"

typedef struct pm_receiver pm_receiver;

// Joins the group. `url` stands for it in errors; `drops` counts datagrams that are not LCM's.
// PM_ENET, PM_ENOMEM.
pm_status pm_receiver_open(pm_receiver **receiver, const char *url, const pm_lcm_url *address,
                           pm_drops *drops);
void pm_receiver_close(pm_receiver *receiver); // NULL is allowed

// As the functions of transport.h.
pm_status pm_receiver_subscribe(pm_receiver *receiver, const char *channel,
                                pm_message_handler *handler, void *context);
pm_status pm_receiver_wait(pm_receiver *receiver, double seconds, int *handled);
int pm_receiver_file(const pm_receiver *receiver);

#endif
