// Names of channels (lcmtypes/portmet.lcm lists them).
#ifndef PM_TRANSPORT_CHANNEL_H
#define PM_TRANSPORT_CHANNEL_H

#include "scene/scene.h"

// Longest name of a channel with its terminator (LCM's limit).
#define PM_CHANNEL_SIZE 64

// Each writes into `channel` [PM_CHANNEL_SIZE]; PM_ECONFIG if the name is too long.

// <SCENE>_<WORD>
pm_status pm_channel_scene(char *channel, const pm_scene *scene, const char *word);
// <SCENE>_<WORD>_<PROCESS>
pm_status pm_channel_process(char *channel, const pm_scene *scene, const char *word,
                             int process_id);

// <SCENE>_REQUEST_<OWNER>, on which `owner` alone is asked for what it has sent: a process, or ""
// for the coordinator, whose channel ends in TICK.
pm_status pm_channel_request(char *channel, const pm_scene *scene, const char *owner);

#endif
