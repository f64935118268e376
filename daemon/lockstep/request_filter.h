// Distinguishes new requests from old ones. Answering a request from a resend buffer costs little,
// but rolling back to a checkpoint means computing steps again. A network may repeat or delay a
// request, and an attacker may replay one. A process therefore rolls back only for a request that
// is newer than all earlier ones from the same sender.
#ifndef PM_LOCKSTEP_REQUEST_FILTER_H
#define PM_LOCKSTEP_REQUEST_FILTER_H

#include <stdbool.h>

#include "lockstep/codec.h"

// The newest request of one sender. The caller initialises it with zeros.
typedef struct pm_request_filter {
    int64_t instance, attempt; // of the sender
    int64_t key;               // round (flux_link.h) or step that was requested
} pm_request_filter;

// Records a request for `key`. Returns true if it is newer than all before: from an instance that
// was started later, of a later attempt, or for a later key.
bool pm_request_filter_accept(pm_request_filter *filter, const portmet_request_t *request,
                              int64_t key);

#endif
