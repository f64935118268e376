// What one process has asked another for. Going back to a checkpoint because of a request costs
// steps, and a network may deliver a request twice, or late, or somebody may send an old one again:
// so it is done only for a request that can be new.
#ifndef PM_LOCKSTEP_REQUEST_FILTER_H
#define PM_LOCKSTEP_REQUEST_FILTER_H

#include <stdbool.h>

#include "lockstep/codec.h"

// The newest request heard from one sender. Storage the caller owns; zero-initialise.
typedef struct pm_request_filter {
    int64_t instance, attempt; // of the sender
    int64_t key;               // what was asked for, counted from the start of the run
} pm_request_filter;

// Takes in a request for `key`. True if it is newer than all before: of an instance that was
// started later, of a later attempt, or for a later key.
bool pm_request_filter_hears(pm_request_filter *filter, const portmet_request_t *request,
                             int64_t key);

#endif
