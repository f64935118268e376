// Builds a classic BPF program with which the kernel drops datagrams on channels that this process
// has not subscribed to, before they wake it.
#ifndef PM_TRANSPORT_CHANNEL_FILTER_H
#define PM_TRANSPORT_CHANNEL_FILTER_H

#include <linux/filter.h>

#include "base/status.h"

// Builds a program that accepts the messages on the channels `name` [count] and drops those on all
// others. It also accepts every fragment of a message after the first one, because such a fragment
// does not name its channel. The names must be distinct and sorted by strcmp. Without names (count
// = 0) the program drops all other datagrams. `start` is the position of LCM's datagram in the
// bytes that the filter sees: 8 on a UDP socket. The caller frees `program->filter`.
//
// No program can be built if a name has fewer than three characters, or if the program would have
// more than BPF_MAXINSNS (4096) instructions. The function then returns PM_OK with
// `program->filter` NULL, and the socket must accept everything. PM_ENOMEM.
pm_status pm_channel_filter_build(struct sock_fprog *program, int count, const char *const *name,
                                  unsigned start);

#endif
