// A classic BPF program by which the kernel drops datagrams on channels that nobody here wants,
// before they wake us.
#ifndef PM_TRANSPORT_CHANNEL_FILTER_H
#define PM_TRANSPORT_CHANNEL_FILTER_H

#include <linux/filter.h>

#include "base/status.h"

// Program for LCM datagrams that begin `start` bytes into what the filter sees (8 on a UDP socket).
// It passes messages on the channels `name` [count], which are sorted by strcmp and distinct, and
// all but the first fragments, which name no channel. The caller frees `program->filter`; it is
// NULL when no filter is possible (a name of less than three characters, too many names): then let
// everything through. PM_ENOMEM.
pm_status pm_channel_filter_build(struct sock_fprog *program, int count, const char *const *name,
                                  unsigned start);

#endif
