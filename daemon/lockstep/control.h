// The control of a coordinator: it answers the requests of clients (control_t in
// lcmtypes/portmet.lcm), begins runs, holds, steps, resets and ends them, and tells each client
// when its request is done.
//
// A client repeats a request until it has its reply. The control remembers the last request of each
// client and its reply, so that a request that comes again is answered again and not done again.
// The ticket that each reply carries shows that a request is not a recorded one.
//
// Life cycle: open; poll after each poll of the coordinator; close before the coordinator.
#ifndef PM_LOCKSTEP_CONTROL_H
#define PM_LOCKSTEP_CONTROL_H

#include "lockstep/coordinator.h"

typedef struct pm_control pm_control;

// A run that a client has started.
typedef struct pm_control_run {
    int64_t number, session; // of the run
    int64_t steps;           // 0: until it is stopped
    double pace;             // simulated s per s; 0: as fast as it can be
    bool held;               // it is held at its start
    int64_t from;       // step from which it goes on, begun by a service that died; -1: it is new
    bool from_client;   // the client gave the state at its start
    const char *owner;  // name of the client
    const char *record; // name of the recording: letters, digits and "._-"; "": none
} pm_control_run;

// The owner of the control provides these functions. They are called when a run begins and ends,
// and upon RELOAD. A coordinator that does not stay has one run, which has begun by itself, and
// needs none of them.
typedef struct pm_control_service {
    void *context;
    const char *description; // of what is served, for clients; borrowed
    // Writes the path of the file `name` and `suffix`, of which the name is safe, in the folder of
    // clients. A failure refuses the request. NULL: there is no folder.
    pm_status (*path)(void *context, const char *name, const char *suffix, char *path, size_t size);
    // A run is about to begin: sets the observer of its steps. A failure refuses the run.
    pm_status (*begin)(void *context, const pm_control_run *run, pm_lockstep_observer *observer);
    // The run has ended after `step` steps with `status`, of which `message` says more. The result
    // is that of the run: `status`, or a failure to complete the recording, with pm_error() set.
    pm_status (*end)(void *context, const pm_control_run *run, int64_t step, pm_status status,
                     const char *message);
    // No run is under way: checks that what is served can be read again, which is then done. A
    // failure refuses it.
    pm_status (*reload)(void *context);
    bool views; // requests of `portmetd view`, whose sender is "view", are done; else refused
    // File that keeps the run and who asks for what, so that a service which is started again after
    // a kill goes on with both; borrowed. NULL: the run ends with the service.
    const char *checkpoint;
    int64_t session;  // by which clients address it; 0: none
    const char *name; // of this service, for others of the same scene; borrowed
} pm_control_service;

// Opens the control of a coordinator. `service` is copied. PM_ECONFIG: a channel's name
// is too long; PM_ENET, PM_ENOMEM.
pm_status pm_control_open(pm_control **control, pm_lockstep_coordinator *coordinator,
                          const pm_control_service *service);
void pm_control_close(pm_control *control); // NULL is allowed

// Follows the coordinator: asks at first whether the scene is served already, in the same session,
// and goes on with the run of a service that died; then notes the end of a run, and answers the
// requests that are done. PM_ENET: it is served already; nothing is answered from then on. A run
// that nobody has held goes on unanswered.
pm_status pm_control_poll(pm_control *control);

#endif
