// Which of many subsystems, ports or processes a text lists. Up to PM_MOST_LISTED are listed one by
// one; of more, the first of all that have the same model stands for the others.
#ifndef PM_APP_LISTED_H
#define PM_APP_LISTED_H

#include <stdbool.h>

#define PM_MOST_LISTED 64

// Returns true if component i of `count` is listed; owner [count] is that of scene/system.h.
static inline bool pm_stands_in_list(int count, const int *owner, int i) {
    return count <= PM_MOST_LISTED || owner[i] == i;
}

// Returns the number of components that component i stands for: itself, and the others if it is
// listed for them.
static inline int pm_listed_for(int count, const int *owner, int i) {
    int others = 0;
    for (int k = 0; k < count && count > PM_MOST_LISTED; ++k) {
        others += k != i && owner[k] == i;
    }
    return 1 + others;
}

#endif
