// Chooses the subsystems, ports or processes that a text lists. Up to PM_MOST_LISTED of them are
// listed one by one. If there are more, the text lists only the first of those that share a model.
#ifndef PM_APP_LISTED_H
#define PM_APP_LISTED_H

#include <stdbool.h>

#include "scene/scene.h"

#define PM_MOST_LISTED PM_SCENE_LISTED

// Returns true if component i of `count` is listed. owner [count] gives, for each component, the
// first component with the same model (part_owner and port_owner in scene/system.h).
static inline bool pm_stands_in_list(int count, const int *owner, int i) {
    return count <= PM_MOST_LISTED || owner[i] == i;
}

// Returns the number of components that the listed component i stands for, itself included.
static inline int pm_listed_for(int count, const int *owner, int i) {
    int others = 0;
    for (int k = 0; k < count && count > PM_MOST_LISTED; ++k) {
        others += k != i && owner[k] == i;
    }
    return 1 + others;
}

#endif
