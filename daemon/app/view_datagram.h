// Sends texts as UDP datagrams to a port of this host, for tools such as PlotJuggler.
#ifndef PM_APP_VIEW_DATAGRAM_H
#define PM_APP_VIEW_DATAGRAM_H

#include <stddef.h>

#include "base/status.h"

// Opens a socket that sends to UDP port `port` of 127.0.0.1; `file` receives its descriptor, which
// the caller closes. PM_ENET.
pm_status pm_view_datagram_open(int *file, int port);

// Sends text [size] as one datagram through the descriptor to which `context` points. It does not
// matter whether anybody receives it.
void pm_view_datagram_send(void *context, const char *text, size_t size);

#endif
