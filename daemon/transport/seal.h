// Authenticates messages of a scene that has a `key_file`. Two fields follow the payload:
//   stamp  8 bytes, big-endian: ns of the sender's clock
//   tag   16 bytes: keyed BLAKE2b (RFC 7693) of the channel with its terminator, payload and stamp
// LCM's decoders ignore bytes after the fields they know, so lcm-spy and lcm-logger work as before.
//
// The seal protects against anyone who can read and send on the network but does not hold the key.
// Channel and payload name scene, session, step and sender, so nobody else can forge, change or
// shorten a message, or move it to another channel, session or step. A replayed message is dropped
// by its stamp if it is older than PM_SEAL_AGE before the newest one received, or before the
// receiver began to listen. A younger one counts as repeated, and the lock-step drops it by session
// and step; a replayed request is answered, but nobody rolls back to a checkpoint for it
// (lockstep/request_filter.h). The seal does not protect against readers (nothing is encrypted),
// against holders of the key (any of them can speak for all), or against a flooded or cut network.
#ifndef PM_TRANSPORT_SEAL_H
#define PM_TRANSPORT_SEAL_H

#include <stddef.h>
#include <stdint.h>

#include "base/status.h"
#include "transport/drops.h"

#define PM_KEY_SIZE 32  // bytes
#define PM_SEAL_SIZE 24 // bytes of stamp and tag

// The age of a message, in ns, from which it counts as replayed. The clocks of all hosts must agree
// to within this.
#define PM_SEAL_AGE INT64_C(10000000000)

typedef struct pm_key {
    unsigned char byte[PM_KEY_SIZE];
} pm_key;

// Loads a key from a file of exactly 32 bytes to which only its owner has access. PM_EFILE. The
// caller clears the key when it is no longer needed.
pm_status pm_key_load(pm_key *key, const char *path);
void pm_key_clear(pm_key *key);

// The key and the newest stamp received. One seal serves one transport.
typedef struct pm_seal pm_seal;

// `now` is the time at which listening begins, ns since 1970 (pm_seal_clock of NULL). PM_ENOMEM.
pm_status pm_seal_open(pm_seal **seal, const pm_key *key, int64_t now);
void pm_seal_close(pm_seal *seal); // NULL is allowed

// The time in ns since 1970, by a clock that does not jump while this process runs: `now` of
// pm_seal_open plus the time that has passed since. With NULL, the system's time.
int64_t pm_seal_clock(const pm_seal *seal);

// Writes stamp and tag, PM_SEAL_SIZE bytes, after the `size` bytes of the payload in `data`.
void pm_seal_write(const pm_seal *seal, const char *channel, void *data, size_t size,
                   int64_t stamp);

// Checks a message of `*size` bytes. PM_KEEP: it is authentic, and `*size` becomes the size of its
// payload. Otherwise PM_DROP_LENGTH, PM_DROP_SEAL or PM_DROP_REPLAY.
pm_drop pm_seal_check(pm_seal *seal, const char *channel, const void *data, size_t *size);

#endif
