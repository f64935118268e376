// Names of channels (lcmtypes/portmet.lcm lists them).
#ifndef PM_NET_CHANNEL_H
#define PM_NET_CHANNEL_H

#include "model/port.h"
#include "net/transport.h"
#include "store/scene.h"

// Each writes into `channel` [PM_CHANNEL_SIZE]; PM_ECONFIG if the name is too long.

// <SCENE>_<WORD>
pm_status pm_channel_scene(char *channel, const pm_scene *scene, const char *word);
// <SCENE>_<WORD>_<NAME>
pm_status pm_channel_subsystem(char *channel, const pm_scene *scene, const char *word,
                               int subsystem_id);
// <SCENE>_FLUX_<FROM>_<TO>_<PORT>, from the end `from` to the other. PM_ECONFIG too if another
// port's channel would read the same, as names may contain '_' themselves.
pm_status pm_channel_flux(char *channel, const pm_scene *scene, int port_id, pm_end from);

#endif
