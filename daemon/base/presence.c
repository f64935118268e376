// Sums up the parts of long intervals between two looks that do not count.
#include "base/presence.h"

double pm_presence_look(pm_presence *presence, double now) {
    const double passed = presence->last > 0 ? now - presence->last : 0;
    const double most =
        presence->planned > PM_PRESENCE_LONGEST ? presence->planned : PM_PRESENCE_LONGEST;
    presence->absent += passed > most ? passed - most : 0;
    presence->planned = 0;
    presence->last = now;
    return now - presence->absent;
}
