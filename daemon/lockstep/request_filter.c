// Compares requests by instance, then attempt, then key.
#include "lockstep/request_filter.h"

bool pm_request_filter_accept(pm_request_filter *filter, const portmet_request_t *request,
                              int64_t key) {
    const int64_t before[] = {filter->instance, filter->attempt, filter->key};
    const int64_t now[] = {request->instance, request->attempt, key};
    int i = 0;
    while (i < 2 && now[i] == before[i]) {
        ++i;
    }
    if (now[i] <= before[i]) {
        return false;
    }
    *filter = (pm_request_filter){request->instance, request->attempt, key};
    return true;
}
