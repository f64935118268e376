// Listens to a run of a scene without taking part in it. The processes of the run do not notice a
// listener: it publishes nothing. It assembles the reports of all processes on one step into a
// sample, and keeps the newest ledger, health and command (lcmtypes/portmet.lcm). A listener may
// miss messages. A step of which it has missed a report gives no sample, and neither does a step of
// which the reports have sums instead of all subsystems.
#ifndef PM_LOCKSTEP_LISTENER_H
#define PM_LOCKSTEP_LISTENER_H

#include <stdbool.h>

#include "lockstep/codec.h"
#include "scene/recording.h"
#include "transport/transport.h"

#define PM_LISTENER_SILENT 3.0 // s of silence after which a listener may follow another run

typedef struct pm_listener pm_listener;

// Opens a listener on `transport`, which belongs to the caller, as does `scene`; both must outlive
// it. A listener with a session other than 0 follows the run with this number alone. With session 0
// it follows the first run that it hears, and another one when that has ended or was silent for
// PM_LISTENER_SILENT. The caller closes the listener. PM_ECONFIG, PM_ENET, PM_ENOMEM.
pm_status pm_listener_open(pm_listener **listener, pm_transport *transport, const pm_scene *scene,
                           int64_t session);
void pm_listener_close(pm_listener *listener); // NULL is allowed

// Lets pm_listener_read call `handler` with each sample that is complete and newer than all before
// it, also where several become complete in one call.
typedef void pm_sample_handler(void *context, const pm_sample *sample);
void pm_listener_set_handler(pm_listener *listener, pm_sample_handler *handler, void *context);

// Handles the messages that have arrived, without waiting. It returns after some thousand messages,
// even if more arrive. PM_ENET.
pm_status pm_listener_read(pm_listener *listener);

// Returns the session of the run that the listener follows; 0: it has heard none yet.
int64_t pm_listener_session(const pm_listener *listener);
// Returns true if the run that the listener follows has said that it is over.
bool pm_listener_is_over(const pm_listener *listener);

// Return the newest complete sample, ledger and health of the run, or NULL if there is none. The
// sample has no residuals, which only the coordinator knows. The listener owns the results, which
// stay valid until the next call of pm_listener_read.
const pm_sample *pm_listener_sample(const pm_listener *listener);
// Returns true if samples have the state z, since somebody records or compares the run.
bool pm_listener_has_state(const pm_listener *listener);
const portmet_ledger_t *pm_listener_ledger(const pm_listener *listener);
const portmet_health_t *pm_listener_health(const pm_listener *listener);
// Returns the number of health messages that the listener has used.
int64_t pm_listener_health_count(const pm_listener *listener);

#endif
