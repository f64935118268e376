// Who a process or coordinator is: what it says at its start, and how another one is refused.
#ifndef PM_LOCKSTEP_IDENTITY_H
#define PM_LOCKSTEP_IDENTITY_H

#include <stdbool.h>

#include "lockstep/codec.h"
#include "scene/system.h"
#include "transport/transport.h"

// Storage the caller owns.
typedef struct pm_identity {
    pm_transport *transport;
    char hello_channel[PM_CHANNEL_SIZE], command_channel[PM_CHANNEL_SIZE];
    portmet_hello_t hello;
} pm_identity;

// `name`: of the process, "" for a coordinator, and must stay. `session`: the one it was started
// for, or 0. PM_ECONFIG.
pm_status pm_identity_init(pm_identity *identity, const pm_system *system, const char *name,
                           int64_t session, bool keeps_checkpoints, pm_transport *transport);

pm_status pm_identity_say(const pm_identity *identity); // hello

// Whether a hello is another one's who would be the same process of the same run; and whether this
// one came before that instance.
bool pm_identity_rivals(const pm_identity *identity, const portmet_hello_t *hello);
bool pm_identity_precedes(const pm_identity *identity, int64_t instance);

// Why whoever says hello does not fit to this one, into `reason` [size]; false: it does.
bool pm_identity_differs(const pm_identity *identity, const portmet_hello_t *hello, char *reason,
                         size_t size);

// Tells another one to leave: `instance`, who spoke as one of `session`.
pm_status pm_identity_refuse(const pm_identity *identity, int64_t session, int64_t instance,
                             pm_status code, const char *reason);

// Whether a command refuses this one, who is of the run `session` or, if that is 0, still asks for
// one.
bool pm_identity_is_refused(const pm_identity *identity, int64_t session,
                            const portmet_command_t *command);

#endif
