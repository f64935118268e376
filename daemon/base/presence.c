// Sums up the parts of long intervals between two looks that do not count.
#include "base/presence.h"

double pm_presence_look(pm_presence *presence, double now) {
    const double passed = presence->last > 0 ? now - presence->last : 0;
    presence->absent += passed > PM_PRESENCE_LONGEST ? passed - PM_PRESENCE_LONGEST : 0;
    presence->last = now;
    return now - presence->absent;
}
