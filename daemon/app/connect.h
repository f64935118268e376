// Connects a process of a scene to the network: address, key and transport.
#ifndef PM_APP_CONNECT_H
#define PM_APP_CONNECT_H

#include "base/journal.h"
#include "scene/scene.h"
#include "transport/transport.h"

// Reads the key file that the scene names; does nothing if it names none. If `key` is NULL, only
// checks that the file can be read. PM_EFILE; the error names the place in the scene file.
pm_status pm_connect_key(const pm_scene *scene, pm_key *key);

// Returns the address at which the processes of the scene meet: `url`, the option of the command
// line; if it is NULL, the scene's; if the scene names none, the default.
const char *pm_connect_url(const pm_scene *scene, const char *url);

// Checks the scene's address and its channel names, so that no process starts with an address or a
// name that LCM refuses. PM_ECONFIG; the error names the place in the scene file.
pm_status pm_connect_check(const pm_scene *scene);

// Finds the address for programs that listen to a run over LCM: `url`; if it is NULL, the scene's
// address, or the default where that is MPI's. PM_ECONFIG.
pm_status pm_connect_listener(const pm_scene *scene, const char *url, const char **address);

// Opens the transport at `address` for the process `name`; "coordinator" stands for the
// coordinator. A transport that is not LCM repeats the channels of the scene's `tap` at the address
// for listeners. If the scene names a key, the transport is sealed, and warnings in `log`, which
// must outlive the transport, name each sender whose clock is ahead of this host's. The caller
// closes the transport. Fails as pm_transport_open and pm_connect_key do.
pm_status pm_connect_open(pm_transport **transport, const pm_scene *scene, const char *address,
                          const char *name, const pm_journal *log);

#endif
