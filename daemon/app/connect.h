// A scene's way to the network, for whoever serves or coordinates it.
#ifndef PM_APP_CONNECT_H
#define PM_APP_CONNECT_H

#include "scene/scene.h"
#include "transport/transport.h"

// Reads the key that the scene names: PM_EFILE, with the place in the scene. `key` may be NULL:
// only tries whether it can be read. Nothing happens where the scene names none.
pm_status pm_connect_key(const pm_scene *scene, pm_key *key);

// Fills in the default address where the scene names none, and checks the address and the names of
// the channels, so that no process starts with one that LCM refuses. PM_ECONFIG, with the place in
// the scene.
pm_status pm_connect_check(pm_scene *scene);

// Opens the transport at the scene's URL, sealed if the scene names a key. The caller closes it. As
// pm_transport_open and pm_connect_key.
pm_status pm_connect_open(pm_transport **transport, const pm_scene *scene);

// One line to standard error if messages were dropped that no portmet of this scene sends: how
// many, and why. `drops`: of the state machine on this transport.
void pm_connect_warn(const pm_transport *transport, const pm_drops *drops);

#endif
