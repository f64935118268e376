// Assigns the processes of a scene to hosts, as the option --hosts of `portmetd emit` asks.
#ifndef PM_APP_HOSTS_H
#define PM_APP_HOSTS_H

#include "base/arena.h"
#include "base/status.h"
#include "scene/scene.h"

// The hosts of the processes of a scene.
typedef struct pm_hosts {
    const char **of;   // [nprocess + 1] host of each process; the last is the coordinator's
    int count;         // different hosts
    const char **name; // [count]
} pm_hosts;

// Reads `list`: names of hosts and assignments PROCESS=HOST, separated by commas. The hosts that
// are not part of an assignment share the processes in the order of the scene, in equal numbers,
// and the first of them has the coordinator, which assignments call "coordinator". NULL stands for
// "localhost". The result lies in the arena. PM_EUSAGE: a name is not that of a host or a process,
// or a process has no host. PM_ENOMEM.
pm_status pm_hosts_read(pm_hosts *hosts, const pm_scene *scene, const char *list, pm_arena *arena);

#endif
