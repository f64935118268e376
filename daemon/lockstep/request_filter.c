// Compares requests by instance, then attempt, then key.
#include "lockstep/request_filter.h"

#include <stdbool.h>

static bool is_later(const pm_request_place *a, const pm_request_place *b) {
    if (a->instance != b->instance) {
        return a->instance > b->instance;
    }
    return a->attempt != b->attempt ? a->attempt > b->attempt : a->key > b->key;
}

static bool is_same(const pm_request_place *a, const pm_request_place *b) {
    return a->instance == b->instance && a->attempt == b->attempt && a->key == b->key;
}

pm_request_age pm_request_filter_accept(pm_request_filter *filter, const portmet_request_t *request,
                                        int64_t key, double now) {
    const pm_request_place place = {request->instance, request->attempt, key};
    if (is_later(&place, &filter->newest)) {
        filter->newest = place;
        filter->since = now;
        return PM_REQUEST_NEW;
    }
    if (!is_same(&place, &filter->repeated)) {
        filter->repeated = place;
        filter->since = now;
    }
    if (now - filter->since < PM_REQUEST_TIME) {
        return PM_REQUEST_OLD;
    }
    filter->since = now; // one answer for each such time
    return PM_REQUEST_INSISTENT;
}
