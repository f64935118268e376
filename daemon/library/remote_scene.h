// A scene that `portmetd serve` steps in other processes, as the shared library shows it: the part
// of portmet.h behind portmet_scene_connect.
#ifndef PM_LIBRARY_REMOTE_SCENE_H
#define PM_LIBRARY_REMOTE_SCENE_H

#include "library/portmet.h"
#include "lockstep/remote.h"

// The caller reads the members, and writes `input` and `slice`. All arrays keep their place.
typedef struct pm_remote_scene {
    pm_arena arena;
    pm_transport *transport;
    pm_client *client;
    const pm_served *served;
    const char *name, *record;
    bool running;                                // a run of this client is under way
    double slice;                                // s of waiting at a time (pm_remote_wait); 0: any
    bool interrupted;                            // the last request has no answer yet
    bool was_running;                            // the same before the present request
    int64_t step;                                // steps taken
    double time;                                 // s
    const double *array[PORTMET_LEDGER + 1];     // as in portmet.h
    size_t size[PORTMET_LEDGER + 1];             // numbers of each
    const char *const *names[PORTMET_SCENE + 1]; // [nname] of each kind of names
    int nname[PORTMET_SCENE + 1];
    double *input; // [served->nlive] NaN: not set
} pm_remote_scene;

// The arguments of portmet_scene_connect.
typedef struct pm_remote_address {
    const char *name, *url, *key_file, *record;
    double patience; // s
} pm_remote_address;

// Begins a run that is held at the scene's initial state. The caller ends it by STOP, and closes
// client, transport and arena, on failure too.
pm_status pm_remote_scene_open(pm_remote_scene *scene, const pm_remote_address *address);

// Sends a request with the inputs, if all are set, and takes over the reply. RESET begins a run
// where none of this client is under way. Fails as pm_remote_ask does. Steps that wait for a live
// input that nobody gives are not taken: the run is held before them.
pm_status pm_remote_scene_ask(pm_remote_scene *scene, portmet_control_t request);

// Goes on waiting for the last request after PM_EINTERRUPTED, which comes after `slice` s. Another
// request holds the run first.
pm_status pm_remote_scene_wait(pm_remote_scene *scene);

#endif
