// The reasons for which received messages are dropped, and their counts. Drops are expected events:
// the network is best effort, and anyone may send on it.
#ifndef PM_TRANSPORT_DROPS_H
#define PM_TRANSPORT_DROPS_H

#include <stdbool.h>

typedef enum pm_drop {
    PM_KEEP = 0,         // the message is used
    PM_DROP_LENGTH,      // it ends before its last field, or goes on after it
    PM_DROP_TYPE,        // its fingerprint is that of another type or version
    PM_DROP_COUNT,       // an array has another size than the scene's
    PM_DROP_TEXT,        // a text is too long, not terminated, or has control characters
    PM_DROP_NUMBER,      // a number is not finite, or a boolean is neither 0 nor 1
    PM_DROP_SESSION,     // it belongs to another run
    PM_DROP_REPEATED,    // it is known already, or no longer needed
    PM_DROP_RANGE,       // its kind, step or round is impossible now
    PM_DROP_IMPLAUSIBLE, // no process of this run can have sent it
    PM_DROP_CONFLICT,    // it contradicts an earlier message, and one of the two is forged
    PM_DROP_DATAGRAM,    // the datagram is not in LCM's format
    PM_DROP_FRAGMENT,    // fragments of it were lost before the next message of its channel began
    PM_DROP_SEAL,        // no holder of the key sent it, or it was changed (seal.h)
    PM_DROP_REPLAY,      // a holder of the key sent it, but too long ago
    PM_DROP_CLOCK,       // a holder of the key sent it, but its clock is ahead
    PM_NDROP
} pm_drop;

// Returns the reason from a function that handles a message, unless the message is kept.
#define PM_TRY_KEEP(call)             \
    do {                              \
        const pm_drop drop_ = (call); \
        if (drop_ != PM_KEEP) {       \
            return drop_;             \
        }                             \
    } while (0)

// The number of messages for each reason. A transport counts only the messages that it drops
// itself. The state machine of the node or coordinator counts all others, and it counts the
// messages that it uses as PM_KEEP.
typedef struct pm_drops {
    long count[PM_NDROP];
} pm_drops;

// Returns true if only a stranger can cause drops for this reason, whatever the network does with
// the messages of a run.
bool pm_drop_is_strange(pm_drop drop);

// Returns the reason in one to three words, e.g. "not finite".
const char *pm_drop_name(pm_drop drop);

#endif
