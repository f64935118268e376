// The identity of a node or coordinator: the hello with which it announces itself and asks for an
// answer, and the refusal of others that do not fit or that claim the same place. An instance is
// identified by the time at which it was started (ns since 1970), so the older of two rivals is the
// one with the smaller number.
//
// A hello has a nonce, a random number. A message that repeats the nonce is an answer: its sender
// has received this hello. A message that was recorded before the hello cannot repeat the nonce,
// and nobody can guess it.
#ifndef PM_LOCKSTEP_IDENTITY_H
#define PM_LOCKSTEP_IDENTITY_H

#include <stdbool.h>

#include "lockstep/codec.h"
#include "scene/system.h"
#include "transport/transport.h"

// The caller owns this storage.
typedef struct pm_identity {
    pm_transport *transport;
    char hello_channel[PM_CHANNEL_SIZE]; // on which this instance publishes hellos
    char command_channel[PM_CHANNEL_SIZE];
    portmet_hello_t hello; // the hello of this instance, with its present nonce
    int64_t answered;      // the last nonce that was answered; 0: none
} pm_identity;

// Makes the hello and the channel names of an instance. `name` is the name of the process, or ""
// for a coordinator, and must outlive the identity. `session` is the session that the instance was
// started for, or 0. PM_ECONFIG: the name of a channel is too long.
pm_status pm_identity_init(pm_identity *identity, const pm_system *system, const char *name,
                           int64_t session, bool keeps_checkpoints, pm_transport *transport);

// Publishes the hello. PM_ENET.
pm_status pm_identity_publish_hello(const pm_identity *identity);

// Returns true if one of the nonces `answer` [count] is that of the present hello.
bool pm_identity_is_answer(const pm_identity *identity, const int64_t *answer, int count);

// Draws another nonce, since the present one has been answered.
void pm_identity_renew(pm_identity *identity);

// Returns true if a hello comes from another instance of the same process and session.
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

// Publishes a refusal of `instance`, which sends messages of `session`, with `reason`. A refusal
// that answers no hello does not end that instance. The instance sends a hello, and only a refusal
// that answers this hello ends it. PM_ENET.
pm_status pm_identity_refuse(const pm_identity *identity, int64_t session, int64_t instance,
                             const char *reason);

// Returns true if a command names this instance as its addressee.
bool pm_identity_is_addressed(const pm_identity *identity, const portmet_command_t *command);

// Returns true if a command names this instance as its addressee and answers its present hello, or
// the hello whose nonce was last renewed.
bool pm_identity_is_proven(const pm_identity *identity, const portmet_command_t *command);

#endif
