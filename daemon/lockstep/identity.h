// The identity of a node or coordinator: the hello with which it announces itself and asks for an
// answer, and the refusal of others that do not fit or that claim the same place. An instance is
// identified by the time at which it was started (ns since 1970), so the older of two rivals is the
// one with the smaller number.
//
// A hello has a nonce, a random number. What repeats the nonce was sent after the hello, by
// somebody who received it: neither a message that was recorded before nor a blind guess can do
// that.
#ifndef PM_LOCKSTEP_IDENTITY_H
#define PM_LOCKSTEP_IDENTITY_H

#include <stdbool.h>

#include "lockstep/codec.h"
#include "scene/system.h"
#include "transport/transport.h"

// The caller owns this storage.
typedef struct pm_identity {
    pm_transport *transport;
    char hello_channel[PM_CHANNEL_SIZE]; // of its own hellos
    char command_channel[PM_CHANNEL_SIZE];
    portmet_hello_t hello; // what this one says of itself, with the present nonce
    int64_t answered;      // the nonce before, to which an answer came; 0: none
} pm_identity;

// Makes the hello and the channel names of an instance. `name` is the name of the process, or ""
// for a coordinator, and must outlive the identity. `session` is the session that the instance was
// started for, or 0. PM_ECONFIG: the name of a channel is too long.
pm_status pm_identity_init(pm_identity *identity, const pm_system *system, const char *name,
                           int64_t session, bool keeps_checkpoints, pm_transport *transport);

// Publishes the hello. PM_ENET.
pm_status pm_identity_publish_hello(const pm_identity *identity);

// True if one of the nonces `answer` [count] is that of the present hello.
bool pm_identity_is_answer(const pm_identity *identity, const int64_t *answer, int count);

// Draws another nonce, since the present one has been answered.
void pm_identity_renew(pm_identity *identity);

// True if a hello comes from another instance of the same process of the same run.
bool pm_identity_is_rival(const pm_identity *identity, const portmet_hello_t *hello);

// Returns true if this instance was started before `instance`.
bool pm_identity_is_older(const pm_identity *identity, int64_t instance);

// Compares protocol, digest and checkpoint interval with those of a hello. Returns true if they
// differ, and writes the reason into `reason` [size].
bool pm_identity_mismatch(const pm_identity *identity, const portmet_hello_t *hello, char *reason,
                          size_t size);

// Publishes a command of `kind` with `code` and `reason` for the sender of `hello`, as the answer
// to it, in the run `session`. PM_ENET.
pm_status pm_identity_answer(const pm_identity *identity, const portmet_hello_t *hello,
                             int64_t session, int8_t kind, pm_status code, const char *reason);

// Publishes a refusal of `instance`, which sends messages of `session`, with `reason`. As it
// answers no hello, it only makes that instance ask. PM_ENET.
pm_status pm_identity_refuse(const pm_identity *identity, int64_t session, int64_t instance,
                             const char *reason);

// True if a command was sent to this instance alone.
bool pm_identity_is_addressed(const pm_identity *identity, const portmet_command_t *command);

// True if a command that was sent to this instance answers its present hello, or the one before.
bool pm_identity_is_proven(const pm_identity *identity, const portmet_command_t *command);

#endif
