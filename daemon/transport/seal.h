// Keyed authentication of messages, for a scene with a `key_file`. Behind the payload stand
//   stamp  8 bytes, big-endian: nanoseconds of the sender's clock
//   tag   16 bytes: keyed BLAKE2b (RFC 7693) of channel with terminator, payload and stamp
// LCM decoders do not look behind the fields they know, so lcm-spy and lcm-logger work as before.
//
// Against whom: anyone who can read and send on the network but does not hold the key. Channel and
// payload name scene, session, step and sender, so no message can be made, changed, cut, or moved
// to another channel, session or step. A message that is sent again is refused by its stamp if it
// is older than PM_SEAL_AGE before the newest one heard, or before the receiver began to listen;
// otherwise it is a repeated one, which the lock-step drops by session and step; a repeated request
// is answered, but nobody goes back to a checkpoint for it (request_filter.h). Not kept out:
// readers (nothing is encrypted), whoever holds the key (it speaks for everybody), and whoever
// drowns or cuts the network.
#ifndef PM_TRANSPORT_SEAL_H
#define PM_TRANSPORT_SEAL_H

#include <stddef.h>
#include <stdint.h>

#include "base/status.h"
#include "transport/drops.h"

#define PM_KEY_SIZE 32  // bytes
#define PM_SEAL_SIZE 24 // bytes behind the payload

// ns. The clocks of all hosts must agree to within this; a message may be on its way for as long.
#define PM_SEAL_AGE INT64_C(10000000000)

typedef struct pm_key {
    unsigned char byte[PM_KEY_SIZE];
} pm_key;

// The file holds exactly the key's 32 bytes, and nobody but its owner may have access to it.
// PM_EFILE. Whoever loads a key clears it when it is no longer needed.
pm_status pm_key_load(pm_key *key, const char *path);
void pm_key_clear(pm_key *key);

typedef struct pm_seal pm_seal;

// `now`: the start of listening, as pm_seal_clock tells it. PM_ENOMEM.
pm_status pm_seal_open(pm_seal **seal, const pm_key *key, int64_t now);
void pm_seal_close(pm_seal *seal); // NULL is allowed

// ns since 1970, by a clock that does not jump while this process runs: the system's time at
// `pm_seal_open` and what has passed since. Without a seal (NULL): the system's time.
int64_t pm_seal_clock(const pm_seal *seal);

// Writes the PM_SEAL_SIZE bytes behind the `size` bytes of a message.
void pm_seal_write(const pm_seal *seal, const char *channel, void *data, size_t size,
                   int64_t stamp);

// `size` becomes that of the payload if the message is good (PM_KEEP). PM_DROP_LENGTH, _SEAL,
// _REPLAY.
pm_drop pm_seal_check(pm_seal *seal, const char *channel, const void *data, size_t *size);

#endif
