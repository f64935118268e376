// Why received messages were not used, counted. Drops are expected events: the wire is best effort
// and open to anyone.
#ifndef PM_TRANSPORT_DROPS_H
#define PM_TRANSPORT_DROPS_H

typedef enum pm_drop {
    PM_KEEP = 0,      // the message is good
    PM_DROP_LENGTH,   // ends before its last field, or goes on after it
    PM_DROP_TYPE,     // another type or version of it (fingerprint)
    PM_DROP_COUNT,    // an array of another size than the scene's
    PM_DROP_TEXT,     // text too long, not terminated, or with control characters
    PM_DROP_NUMBER,   // a number that is not finite, a boolean that is neither 0 nor 1
    PM_DROP_SESSION,  // of another run
    PM_DROP_REPEATED, // known already, or no longer needed
    PM_DROP_RANGE,    // a kind, step or round that makes no sense now
    PM_DROP_DATAGRAM, // not LCM's
    PM_DROP_SEAL,     // not by a holder of the key, or changed (seal.h)
    PM_DROP_REPLAY,   // by a holder of the key, but old
    PM_NDROP
} pm_drop;

typedef struct pm_drops {
    long count[PM_NDROP]; // count[PM_KEEP]: messages used, by who uses them; 0 of a transport
} pm_drops;

// Two words for a report, e.g. "not finite".
const char *pm_drop_name(pm_drop drop);

#endif
