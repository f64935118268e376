// Tells new requests from old ones. Answering a request from a resend buffer costs little, but
// rolling back to a checkpoint costs steps. As a network may repeat or delay a request, and
// somebody may replay one, a process rolls back only for a request that is newer than all before it
// from the same sender, or that is repeated for so long that its sender must be waiting for it. The
// latter keeps a forged request, which looks newer than any real one, from hiding the real ones.
#ifndef PM_LOCKSTEP_REQUEST_FILTER_H
#define PM_LOCKSTEP_REQUEST_FILTER_H

#include "lockstep/codec.h"

// The time for which a request that is not new must be repeated, s. A process that waits repeats
// its request at least every 0.1 s (waiting.h).
#define PM_REQUEST_TIME 0.5

// The age of a request follows from all earlier requests of its sender. A process rolls back for a
// new or an insistent request, but not for an old one.
typedef enum pm_request_age {
    PM_REQUEST_OLD,
    PM_REQUEST_NEW, // from an instance that was started later, of a later attempt, or for a later
                    // key
    PM_REQUEST_INSISTENT // not new, but repeated for PM_REQUEST_TIME
} pm_request_age;

// The flux or report that one request asks for.
typedef struct pm_request_place {
    int64_t instance, attempt; // of the sender
    int64_t key;               // round (flux_link.h) or step that was requested
} pm_request_place;

// The requests of one sender. The caller initialises it with zeros.
typedef struct pm_request_filter {
    pm_request_place newest;   // the newest request so far
    pm_request_place repeated; // the last request that was not new
    double since;              // s, when `repeated` was first received
} pm_request_filter;

// Records a request for `key` at the time `now` (s), and returns its age.
pm_request_age pm_request_filter_accept(pm_request_filter *filter, const portmet_request_t *request,
                                        int64_t key, double now);

#endif
