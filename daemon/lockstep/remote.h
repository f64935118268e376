// A client of a coordinator that stays (control.h), on this or any other host. It sends a request,
// repeats it until the coordinator has answered, and keeps the last reply.
//
// Life cycle: open, which asks what is served; ask, and read the reply after each; close.
#ifndef PM_LOCKSTEP_REMOTE_H
#define PM_LOCKSTEP_REMOTE_H

#include <signal.h>

#include "lockstep/codec.h"
#include "transport/transport.h"

typedef struct pm_client pm_client;

// A service says that it has this. The client owns all texts and arrays.
typedef struct pm_served {
    const char *description; // one line of JSON (daemon/WIRE.md)
    double dt;               // s
    int steps;               // that the scene file asks for
    int nsubsystem, nport, nz, nlive;
    const char **subsystem;              // [nsubsystem] names
    const char **variable, **unit;       // [nz] "upper.q[0]" and "m"
    const char **port, **end_a, **end_b; // [nport] names of ports, and of what is at their ends
    const char **live, **live_unit;      // [nlive] live inputs: names, and units ("": unknown)
} pm_served;

typedef struct pm_remote_options {
    const char *scene;  // its name, borrowed
    const char *sender; // name of this client, for people; borrowed
    int64_t session;    // that the service was given; 0: none
    // s without any reply, or of waiting for one live input, after which a request fails
    double patience;
    const volatile sig_atomic_t *stop; // a request fails soon after it is not 0; NULL: never
} pm_remote_options;

// Opens a client on a transport, which is borrowed and sealed by its owner if the scene has a key,
// and asks what is served. Nobody may wait on the transport after the client is closed.
// PM_ETIMEOUT: nobody answers; PM_ECONFIG: a channel's name is too long, or the description cannot
// be read; PM_EINTERRUPTED, PM_ENET, PM_ENOMEM.
pm_status pm_remote_open(pm_client **remote, pm_transport *transport,
                         const pm_remote_options *options);
void pm_remote_close(pm_client *remote); // NULL is allowed

const pm_served *pm_remote_served(const pm_client *remote);

// Sends a request, and repeats it until it is done, or, unless `wait`, until it is accepted. The
// caller sets its kind and what belongs to that; `client`, `nonce`, `ticket` and `sender` are set
// here, and NULL stands for an empty text. Returns the code of the reply, with its text. A refusal
// is such a code. PM_ETIMEOUT: nobody answers, or nobody gives a live input for which the run
// waits; PM_EUSAGE: a number is not finite; PM_ECONFIG: another scene is served by now;
// PM_EINTERRUPTED, PM_ENET.
pm_status pm_remote_ask(pm_client *remote, const portmet_control_t *request, bool wait);

// Lets a request return after `seconds` without its answer, with PM_EINTERRUPTED; 0, as at first:
// it does not. pm_remote_wait goes on waiting for the last request, whose arrays must stay until
// then, and returns what pm_remote_ask would have returned.
void pm_remote_interrupt_after(pm_client *remote, double seconds);
pm_status pm_remote_wait(pm_client *remote);

// Returns true if the last request has failed since nobody gives a live input.
bool pm_remote_awaits_input(const pm_client *remote);

// Returns the last reply, valid until the next request.
const portmet_control_reply_t *pm_remote_reply(const pm_client *remote);

#endif
