// Connects a process of a scene to the network: address, key and transport.
#ifndef PM_APP_CONNECT_H
#define PM_APP_CONNECT_H

#include "base/journal.h"
#include "scene/scene.h"
#include "transport/transport.h"

// Reads the key file that the scene names; does nothing if it names none. If `key` is NULL, only
// checks that the file can be read. PM_EFILE; the error names the place in the scene file.
pm_status pm_connect_key(const pm_scene *scene, pm_key *key);

// Sets scene->url to the default address if the scene names none, and scene->tap_url to the address
// at which LCM programs listen: scene->url, or the default where that is MPI's. Checks the address
// and the channel names, so that no process starts with an address or a name that LCM refuses.
// PM_ECONFIG; the error names the place in the scene file.
pm_status pm_connect_check(pm_scene *scene);

// Puts the address `url` in place of the scene's, for programs that listen to a run over LCM; NULL:
// the scene's own address of LCM (scene->tap_url). pm_connect_check comes first. PM_ECONFIG.
pm_status pm_connect_listener(pm_scene *scene, const char *url);

// PM_EUSAGE if the scene's URL has ranks, which only `run` can use; `command` is the user's.
pm_status pm_connect_refuse_ranks(const pm_scene *scene, const char *command);

// Opens the transport at the scene's URL for the process `name`; "coordinator" stands for the
// coordinator. A transport that is not LCM repeats the channels of the scene's `tap` at
// scene->tap_url. If the scene names a key, the transport is sealed, and warnings in `log`, which
// must outlive the transport, name each sender whose clock is ahead of this host's. The caller
// closes the transport. Fails as pm_transport_open and pm_connect_key do.
pm_status pm_connect_open(pm_transport **transport, const pm_scene *scene, const char *name,
                          const pm_journal *log);

// Writes a warning to `log` if messages were dropped that no process of this scene sends:
// their number, and the reasons. `drops` are the counts of the state machine on this transport.
void pm_connect_warn(const pm_transport *transport, const pm_drops *drops, const pm_journal *log);

#endif
