// The order of requests.
#include "net/asker.h"

bool pm_asker_hears(pm_asker *asker, const portmet_request_t *request, int64_t key) {
    const int64_t before[] = {asker->instance, asker->attempt, asker->key};
    const int64_t now[] = {request->instance, request->attempt, key};
    int i = 0;
    while (i < 2 && now[i] == before[i]) {
        ++i;
    }
    if (now[i] <= before[i]) {
        return false;
    }
    *asker = (pm_asker){request->instance, request->attempt, key};
    return true;
}
