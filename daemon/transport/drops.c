// The names of the reasons for which messages are dropped.
#include "transport/drops.h"

const char *pm_drop_name(pm_drop drop) {
    static const char *const name[PM_NDROP] = {
        "used",         "wrong length",  "foreign type",    "wrong size",
        "bad text",     "not finite",    "foreign session", "repeated",
        "out of range", "implausible",   "contradictory",   "not LCM's",
        "incomplete",   "not authentic", "replayed",        "ahead of the clock",
    };
    return drop >= 0 && drop < PM_NDROP ? name[drop] : "unknown";
}

bool pm_drop_is_strange(pm_drop drop) {
    return drop != PM_KEEP && drop != PM_DROP_SESSION && drop != PM_DROP_REPEATED &&
           drop != PM_DROP_RANGE;
}
