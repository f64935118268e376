// The names of LCM channels. lcmtypes/portmet.lcm lists them with their messages.
#ifndef PM_TRANSPORT_CHANNEL_H
#define PM_TRANSPORT_CHANNEL_H

#include "scene/scene.h"

// Size of the longest channel name with its terminator (LCM's limit).
#define PM_CHANNEL_SIZE 64

// Each function writes a name of the given form into `channel` [PM_CHANNEL_SIZE]. PM_ECONFIG: the
// name is too long.

// <SCENE>_<WORD>, for the scene of the name `scene`
pm_status pm_channel_scene(char *channel, const char *scene, const char *word);

// <SCENE>_<WORD>_<PROCESS>
pm_status pm_channel_process(char *channel, const pm_scene *scene, const char *word,
                             int process_id);

// <SCENE>_HELLO_<OWNER>: the channel of the hellos of `owner`, a process, or "" for the
// coordinator, whose channel is <SCENE>_HELLO.
pm_status pm_channel_hello(char *channel, const pm_scene *scene, const char *owner);

// <SCENE>_REQUEST_<OWNER>: the channel of requests for the messages of `owner`, a process, or ""
// for the coordinator, whose channel is <SCENE>_REQUEST_TICK.
pm_status pm_channel_request(char *channel, const pm_scene *scene, const char *owner);

#endif
