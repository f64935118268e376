// A transport carries messages, as bytes, between processes or within one. The URL chooses the
// kind:
//   udpm://, mpudpm://   LCM over UDP multicast, best effort (transport_lcm.c)
//   mpi://               between the ranks of one job of mpirun (transport_mpi.c)
// With udpm, messages arrive on a filtered socket of this program (transport_lcm.c), unless the URL
// says
// "?receive=lcm".
// A transport is a table of functions (transport_table.h) and one line in transport.c. With a key,
// a transport that seals and checks messages (seal.c) stands in front of any of them. A
// tap repeats chosen messages over LCM.
//
// Life cycle: open, perhaps tap, perhaps seal, subscribe, then publish and wait in turn, close.
#ifndef PM_TRANSPORT_TRANSPORT_H
#define PM_TRANSPORT_TRANSPORT_H

#include <stdbool.h>
#include <stddef.h>

#include "base/status.h"
#include "transport/channel.h"
#include "transport/drops.h"
#include "transport/seal.h"

typedef struct pm_transport pm_transport;
struct pm_transport_table;

// A function that pm_transport_wait calls for each message. `data` [size] and `channel` are valid
// until the handler returns. The handler may publish; it must not wait, subscribe or close.
typedef void pm_message_handler(void *context, const char *channel, const void *data, size_t size);

// Checks the form of a URL, without opening anything. PM_ECONFIG: the scheme is unknown or the
// address malformed.
pm_status pm_transport_check(const char *url);

// True if the processes that meet at this URL are numbered by ranks, as those of mpi:// are.
bool pm_transport_has_ranks(const char *url);

// Finds the rank of this process, from 0 on, and their number, at a URL that has ranks. With mpi://
// this begins MPI, and a process that does not open the transport then and close it makes mpirun
// end the others. PM_ECONFIG: as pm_transport_check; PM_ENET: MPI has ended.
pm_status pm_transport_place(const char *url, int *rank, int *count);

// Opens a transport. PM_ECONFIG: as pm_transport_check. PM_ENET: there is no socket or no route for
// multicast; the error then names the commands that make one. PM_ENOMEM.
pm_status pm_transport_open(pm_transport **transport, const char *url);

// Returns words for an error about somebody who is silent: that with the ttl of the URL no message
// leaves this host, or "".
const char *pm_transport_reach(const pm_transport *transport);

// Makes a transport of functions (transport_table.h) and their state, which it then owns.
// PM_ENOMEM.
pm_status pm_transport_make(pm_transport **transport, const struct pm_transport_table *table,
                            void *state);

// Closes a transport. With mpi:// it waits until every rank closes it, for 60 s at most; NULL is
// allowed.
void pm_transport_close(pm_transport *transport);

// Which messages are repeated over LCM. All pointers are borrowed.
typedef struct pm_tap {
    const char *url;      // of LCM
    const char *scene;    // with which, and "_", the channels begin
    int count;            // number of patterns
    const char **pattern; // [count] of what follows, as fnmatch(3) reads patterns
} pm_tap;

// Makes the transport publish messages over LCM as well, if a pattern of `tap`, whose texts must
// outlive the transport, matches their channel. Nothing is received from there, and a failure of
// LCM after this call does not fail the transport. It must be called before pm_transport_seal.
// Fails as pm_transport_open does.
pm_status pm_transport_tap(pm_transport *transport, const pm_tap *tap);

// Called during pm_transport_wait, once for each sender whose clock is more than PM_SEAL_AGE ahead
// of this host's, with the difference in s.
typedef void pm_clock_handler(const void *context, const char *sender, double seconds);

// Makes the transport seal all messages that it publishes, as `sender` (NAME@HOST), and drop
// received messages without a valid seal (seal.h). `on_clock`, which gets `context`, may be NULL.
// It must be called before the first subscription; the key may be cleared afterwards. PM_ENOMEM.
pm_status pm_transport_seal(pm_transport *transport, const pm_key *key, const char *sender,
                            pm_clock_handler *on_clock, const void *context);

// Passes all messages on exactly this channel to `handler`, with `context`. Messages that this
// transport publishes are passed, too. Several handlers may subscribe to one channel. PM_ENET,
// PM_ENOMEM.
pm_status pm_transport_subscribe(pm_transport *transport, const char *channel,
                                 pm_message_handler *handler, void *context);

// Sends `data` [size] without waiting. Success does not mean that anyone received it. PM_ENET,
// PM_ENOMEM.
pm_status pm_transport_publish(pm_transport *transport, const char *channel, const void *data,
                               size_t size);

// Waits up to `seconds` (0: not at all) for a message, then passes all that have arrived to their
// handlers. `handled` (may be NULL) receives their number; it is also 0 when a signal ended the
// wait. PM_ENET.
pm_status pm_transport_wait(pm_transport *transport, double seconds, int *handled);

// Returns a file descriptor for poll() that becomes readable when a message arrives, or -1 if the
// transport has no descriptor.
int pm_transport_file(const pm_transport *transport);

// Returns the counts of messages that were dropped before they reached a handler. The transport
// owns them.
const pm_drops *pm_transport_drops(const pm_transport *transport);

#endif
