// Serves the page of a view over HTTP, and its messages over a websocket, on one port. The server
// answers GET requests for the three files of the page and refuses every other request. A short
// text that arrives on a websocket is handed to `hear`, which decides what it means.
//
// A browser may hold pages of other origins, which must not read or control a run. The server
// therefore refuses a request whose Host is neither an address nor "localhost" (a name that
// somebody has pointed at this host), and a websocket whose Origin is another one than that of the
// page.
//
// This is the only file that uses libwebsockets. A program that was built without it has the same
// functions, and pm_view_server_open says that it has no server.
#ifndef PM_APP_VIEW_SERVER_H
#define PM_APP_VIEW_SERVER_H

#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "base/status.h"

#define PM_VIEW_CLIENTS 32 // websockets at a time

// The messages that a client has received so far; all zero at the start.
typedef struct pm_view_progress {
    int64_t scene;         // 1: the description of the scene
    int64_t frame, health; // number of the newest state, and of the newest message on health
    int64_t control;       // number of the newest answer to what a client sent
} pm_view_progress;

// Writes the next message for a client to `file` and updates its progress. Returns false, and
// writes nothing, if the client has received everything.
typedef bool pm_view_next(void *context, pm_view_progress *progress, FILE *file);

// Takes a word [PM_VIEW_WORD] that a client has sent.
#define PM_VIEW_WORD 16 // bytes, with the terminator
typedef void pm_view_hear(void *context, const char *word);

typedef struct pm_view_server pm_view_server;

// Opens a server on `port` of `address`, an IPv4 address of this host. `next` gives the messages,
// and `hear` takes those of clients; both are called with `context`. The caller closes the server.
// PM_ENET: the address or the port cannot be used, or the program was built without libwebsockets.
// PM_ENOMEM.
pm_status pm_view_server_open(pm_view_server **server, const char *address, int port,
                              pm_view_next *next, pm_view_hear *hear, void *context);
void pm_view_server_close(pm_view_server *server); // NULL is allowed

// Offers new messages to all clients and serves for `seconds`, or until a signal arrives. PM_ENET.
pm_status pm_view_server_serve(pm_view_server *server, double seconds,
                               const volatile sig_atomic_t *stop);

#endif
