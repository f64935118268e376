// Builds a classic BPF program with which the kernel drops datagrams on channels that this process
// has not subscribed to, before they wake it.
#ifndef PM_TRANSPORT_CHANNEL_FILTER_H
#define PM_TRANSPORT_CHANNEL_FILTER_H

#include <linux/filter.h>

#include "base/status.h"

// The program accepts messages on the channels `name` [count], which are distinct and sorted by
// strcmp, and all fragments after the first, which name no channel. `start` is the position of
// LCM's datagram in what the filter sees (8 on a UDP socket). The caller frees `program->filter`.
// It is NULL when no filter is possible, because a name has less than three characters or there are
// too many names; then the socket needs to accept everything. PM_ENOMEM.
pm_status pm_channel_filter_build(struct sock_fprog *program, int count, const char *const *name,
                                  unsigned start);

#endif
