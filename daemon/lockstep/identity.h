// The identity of a node or coordinator: the hello that it publishes at its start, and the refusal
// of other instances that have another digest or the same name. The number of an instance is the
// time at which it was started (ns since 1970), so that the older of two rivals has the smaller
// number.
#ifndef PM_LOCKSTEP_IDENTITY_H
#define PM_LOCKSTEP_IDENTITY_H

#include <stdbool.h>

#include "lockstep/codec.h"
#include "scene/system.h"
#include "transport/transport.h"

// The caller owns this storage.
typedef struct pm_identity {
    pm_transport *transport;
    char hello_channel[PM_CHANNEL_SIZE], command_channel[PM_CHANNEL_SIZE];
    portmet_hello_t hello; // the hello of this instance
} pm_identity;

// Makes the hello and the channel names of an instance. `name` is the name of the process, or ""
// for a coordinator, and must outlive the identity. `session` is the session that the instance was
// started for, or 0. PM_ECONFIG: the name of a channel is too long.
pm_status pm_identity_init(pm_identity *identity, const pm_system *system, const char *name,
                           int64_t session, bool keeps_checkpoints, pm_transport *transport);

// Publishes the hello. PM_ENET.
pm_status pm_identity_publish_hello(const pm_identity *identity);

// Returns true if a hello comes from another instance of the same process in the same run.
bool pm_identity_is_rival(const pm_identity *identity, const portmet_hello_t *hello);

// Returns true if this instance was started before `instance`.
bool pm_identity_is_older(const pm_identity *identity, int64_t instance);

// Compares protocol, digest and checkpoint interval with those of a hello. Returns true if they
// differ, and writes the reason into `reason` [size].
bool pm_identity_mismatch(const pm_identity *identity, const portmet_hello_t *hello, char *reason,
                          size_t size);

// Publishes a command that tells `instance`, a sender of messages of `session`, to end with `code`
// and `reason`. PM_ENET.
pm_status pm_identity_refuse(const pm_identity *identity, int64_t session, int64_t instance,
                             pm_status code, const char *reason);

// Returns true if a command refuses this instance, which takes part in `session` (0: in none yet).
bool pm_identity_is_refused(const pm_identity *identity, int64_t session,
                            const portmet_command_t *command);

#endif
