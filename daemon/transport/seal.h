// Authenticates messages of a scene that has a `key_file`. Four fields follow the payload:
//   stamp   8 bytes, big-endian: ns of the sender's clock
//   sender  n bytes of text: NAME@HOST, a process and the host on which it runs
//   length  1 byte: n
//   tag    16 bytes: keyed BLAKE2b (RFC 7693) of the channel with its terminator, the payload and
//          the three fields above
// LCM's decoders ignore bytes after the fields they know, so lcm-spy and lcm-logger work as before.
//
// The seal protects against attackers who can read and send on the network but do not hold the key.
// Channel and payload name scene, session, step and sender. An attacker can therefore not forge,
// change or shorten a message, or move it to another channel, session or step. An attacker cannot
// replay a message that is older than PM_SEAL_AGE either, since each receiver compares the stamp
// with its own clock. A message whose stamp is more than PM_SEAL_AGE ahead comes from a host whose
// clock is wrong. The receiver drops this message for the reason PM_DROP_CLOCK. The clock of one
// sender does not affect the messages of another.
//
// A message younger than PM_SEAL_AGE can be replayed. Such a replay cannot:
//   - let a node join, follow another coordinator, leave before its last step, or accept a refusal:
//     each of these requires an answer to a hello, and an answer repeats the hello's nonce;
//   - end a run: a command counts only for the nodes that follow its sender, and a report of a
//     failure or a hello counts only for the coordinator that it names;
//   - change a number: fluxes and reports of one session have the same bits whenever they are sent.
// Until the message is older than PM_SEAL_AGE, its replay can:
//   - make a dead process look alive, so that the scene's `patience`, the time after which a silent
//     process ends the run, begins later;
//   - make a process send a buffered message again;
//   - if the message is a request, and is repeated for half a second, make a process with
//     checkpoints roll back and compute the same bits again (lockstep/node.h);
//   - if a request is repeated in this way, and its receiver, a node of a run without checkpoints,
//     itself waits for a long time, end that run.
//
// The seal does not protect against readers (nothing is encrypted), against holders of the key (any
// of them can speak for all), or against a flooded or cut network.
//
// Without a key nothing keeps an attacker from ending a run or from changing its numbers. Receivers
// drop a message as implausible if no process of the run can have sent it. Two messages that
// contradict each other end the run with an error that says so. A single forged message therefore
// does not make a run stand still (tests/fuzz/fuzz_pair.c). It changes numbers only if it takes the
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
// to within this age.
#define PM_SEAL_AGE INT64_C(10000000000)

typedef struct pm_key {
    unsigned char byte[PM_KEY_SIZE];
} pm_key;

// Loads a key from a file of exactly PM_KEY_SIZE bytes to which only its owner has access. The
// caller clears the key when it is no longer needed. PM_EFILE: the file cannot be read, has another
// size, or is accessible to others.
pm_status pm_key_load(pm_key *key, const char *path);
// Overwrites the key with zeros.
void pm_key_clear(pm_key *key);

// A seal holds the key, the name of its sender, and a clock. It belongs to one transport.
typedef struct pm_seal pm_seal;

// The origin of an authentic message, as the message states it.
typedef struct pm_seal_origin {
    char sender[PM_SEAL_SENDER];
    int64_t ahead; // ns by which the stamp is ahead of the receiver's clock
} pm_seal_origin;

// Makes a seal, which the caller closes. The seal keeps neither `key` nor `sender`. `sender` is the
// text of the field `sender`, cut after PM_SEAL_SENDER - 1 bytes. `now` is the time in ns since
// 1970, as pm_seal_clock(NULL) returns it. PM_ENOMEM.
pm_status pm_seal_open(pm_seal **seal, const pm_key *key, const char *sender, int64_t now);
void pm_seal_close(pm_seal *seal); // NULL is allowed

// Returns the time in ns since 1970: `now` of pm_seal_open plus the time elapsed since. This clock
// does not jump while the process runs, and it continues while the host is suspended. If `seal` is
// NULL, the function returns the system's time.
int64_t pm_seal_clock(const pm_seal *seal);

// Writes the four fields after the `size` bytes of the payload in `data`, which has room for
// PM_SEAL_MOST more bytes. `stamp` is the time of sending in ns, from pm_seal_clock. Returns the
// number of bytes of the four fields, at most PM_SEAL_MOST.
size_t pm_seal_write(const pm_seal *seal, const char *channel, void *data, size_t size,
                     int64_t stamp);

// Checks the message `data` of `*size` bytes. PM_KEEP: the message is authentic, and its stamp is
// within PM_SEAL_AGE of this seal's clock; `*size` becomes the size of the payload. Otherwise
// returns the reason for which the caller must drop the message: PM_DROP_LENGTH (the message is too
// short for the four fields), PM_DROP_SEAL (the tag is wrong), PM_DROP_REPLAY (the stamp is too
// old), or PM_DROP_CLOCK (the stamp is too far ahead). For PM_DROP_REPLAY and PM_DROP_CLOCK the
// function writes *origin, unless `origin` is NULL.
pm_drop pm_seal_check(const pm_seal *seal, const char *channel, const void *data, size_t *size,
                      pm_seal_origin *origin);

#endif
