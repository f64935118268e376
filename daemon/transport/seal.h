// Authenticates messages of a scene that has a `key_file`. Four fields follow the payload:
//   stamp   8 bytes, big-endian: ns of the sender's clock
//   sender  n bytes of text: NAME@HOST, a process and the host on which it runs
//   length  1 byte: n
//   tag    16 bytes: keyed BLAKE2b (RFC 7693) of the channel with its terminator and all before
// LCM's decoders ignore bytes after the fields they know, so lcm-spy and lcm-logger work as before.
//
// The seal protects against attackers who can read and send on the network but do not hold the key.
// Channel and payload name scene, session, step and sender. An attacker can therefore not forge,
// change or shorten a message, or move it to another channel, session or step. An attacker cannot
// replay a message that is older than PM_SEAL_AGE either, since each receiver compares the stamp
// with its own clock. A message whose stamp is more than PM_SEAL_AGE ahead comes from a host whose
// clock is wrong. It is dropped for the reason PM_DROP_CLOCK. The clock of one sender does not
// affect the messages of another.
//
// A message that is younger than that can be replayed. It then does not:
//   - let a node join, follow another coordinator, leave before its last step or take a refusal:
//     this takes an answer to a hello, and an answer repeats the nonce of the hello;
//   - end a run: a command counts for the nodes that follow its sender, and a report of a failure
//     for the coordinator that it names; a hello counts for the coordinator that it names;
//   - change a number: fluxes and reports of one session have the same bits whenever they are sent.
// What it can do, for PM_SEAL_AGE after it was sent: keep a process that has died looking alive, so
// that `patience` with it begins later; have a buffered message sent again; and, if it is a request
// that is repeated for half a second, make a process with checkpoints roll back and compute the
// same bits again, or, while a run without checkpoints pauses, end it (lockstep/request_filter.h).
//
// The seal does not protect against readers (nothing is encrypted), against holders of the key (any
// of them can speak for all), or against a flooded or cut network.
//
// Without a key nothing keeps an attacker from ending a run or from changing its numbers. Messages
// that no process of the run can have sent are dropped as implausible, and two messages that
// contradict each other end the run with an error that says so. A single forged message therefore
// does not make a run stand still (tests/fuzz/fuzz_pair.c); it changes numbers only if it takes the
// place of a message that is lost.
#ifndef PM_TRANSPORT_SEAL_H
#define PM_TRANSPORT_SEAL_H

#include <stddef.h>
#include <stdint.h>

#include "base/status.h"
#include "transport/drops.h"

#define PM_KEY_SIZE 32    // bytes
#define PM_SEAL_LEAST 25  // bytes of stamp, length and tag
#define PM_SEAL_SENDER 64 // bytes of the text of the longest sender, with a terminator
#define PM_SEAL_MOST (PM_SEAL_LEAST + PM_SEAL_SENDER)

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

// A seal holds the key, the name of its sender, and a clock. It belongs to one transport.
typedef struct pm_seal pm_seal;

// The origin of an authentic message, as the message states it.
typedef struct pm_seal_origin {
    char sender[PM_SEAL_SENDER];
    int64_t ahead; // ns by which the stamp is ahead of the receiver's clock
} pm_seal_origin;

// Makes a seal. `sender` is the text of the field `sender`; a longer text is cut. `now` is the time
// in ns since 1970 (pm_seal_clock of NULL). PM_ENOMEM.
pm_status pm_seal_open(pm_seal **seal, const pm_key *key, const char *sender, int64_t now);
void pm_seal_close(pm_seal *seal); // NULL is allowed

// Returns the time in ns since 1970, by a clock that does not jump while this process runs and that
// continues while the host is suspended: `now` of pm_seal_open plus the time elapsed since. With
// NULL, returns the system's time.
int64_t pm_seal_clock(const pm_seal *seal);

// Writes the four fields after the `size` bytes of the payload in `data`. Returns their number of
// bytes, at most PM_SEAL_MOST.
size_t pm_seal_write(const pm_seal *seal, const char *channel, void *data, size_t size,
                     int64_t stamp);

// Checks a message of `*size` bytes. PM_KEEP: it is authentic and of the present, and `*size`
// becomes the size of its payload. Otherwise PM_DROP_LENGTH, PM_DROP_SEAL, PM_DROP_REPLAY, or
// PM_DROP_CLOCK: it is ahead of this clock. Fills in `origin` (may be NULL) for PM_DROP_REPLAY and
// PM_DROP_CLOCK.
pm_drop pm_seal_check(const pm_seal *seal, const char *channel, const void *data, size_t *size,
                      pm_seal_origin *origin);

#endif
