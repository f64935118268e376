// Supervises children that keep checkpoints.
#include "app/supervise.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"

#include "app/launch.h"
#include "app/observer.h"
#include "app/prepare.h"
#include "app/serve.h"
#include "lockstep/coordinator.h"
#include "lockstep/lookahead.h"
#include "store/snapshot.h"

#define WATCH_INTERVAL 5000000 // ns between two looks at the children
#define END_GRACE 1.0          // s for all children to end by themselves after the first of them
#define STOP_GRACE 5.0         // s for the coordinator to end the run after it was told to stop
#define LOCK_GRACE 3.0         // s for the processes of a killed run to disappear
#define COORDINATOR 0          // the first child

// The setup and the options of the children.
typedef struct shared {
    pm_setup *setup;
    pm_run_options options;
} shared;

static pm_status coordinate(void *context, const char *name) {
    shared *s = context;
    (void)name;
    return pm_serve_coordinator(s->setup, &s->options);
}

static pm_status serve_node(void *context, const char *name) {
    shared *s = context;
    return pm_serve_node(s->setup, &s->options, pm_scene_find_process(s->setup->scene, name));
}

// Starts the coordinator and all nodes.
static pm_status start_all(pm_launch *launch, shared *s) {
    const pm_scene *scene = s->setup->scene;
    const char *checkpoint;
    bool found;
    PM_TRY(pm_prepare_checkpoint(s->setup, &s->options, NULL, &checkpoint));
    // The session is that of the checkpoints, or else a random one. The recording of a new run is
    // checked here, since each new coordinator replaces what the one before has left of it.
    const pm_snapshot_key key = {.digest = s->setup->system->digest,
                                 .owner =
                                     pm_checkpoint_owner(&s->setup->arena, scene, "coordinator")};
    PM_TRY(pm_arena_status(&s->setup->arena, "%s", checkpoint));
    PM_TRY(pm_snapshot_session(checkpoint, &key, &s->options.session, &found));
    if (!found) {
        PM_TRY(pm_observer_check_recording(&s->options));
        s->options.session = pm_lockstep_session();
    }
    s->options.overwrite = s->options.elsewhere = true;
    s->options.log.json = false; // this process passes their lines on
    PM_TRY(pm_launch_start(launch, "coordinator", (pm_launch_program){coordinate, s, false},
                           checkpoint));
    for (int i = 0; i < scene->network.nprocess; ++i) {
        const char *name = scene->network.process[i].name;
        PM_TRY(pm_prepare_checkpoint(s->setup, &s->options, name, &checkpoint));
        PM_TRY(
            pm_launch_start(launch, name, (pm_launch_program){serve_node, s, false}, checkpoint));
    }
    return PM_OK;
}

pm_status pm_supervise(pm_setup *setup, const pm_run_options *options) {
    pm_launch *launch = NULL;
    shared children = {setup, *options};
    int folder = -1;
    const char *checkpoint;
    pm_status status;
    // This makes the folder, too.
    PM_TRY_DONE(pm_prepare_checkpoint(setup, options, NULL, &checkpoint));
    // Opens and locks the folder of the checkpoints. The children inherit the lock, so that it is
    // free when the last process of a run is gone, however the run ended.
    const double deadline = pm_clock() + LOCK_GRACE;
    folder = open(options->checkpoint, O_RDONLY | O_DIRECTORY);
    while (folder < 0 || flock(folder, LOCK_EX | LOCK_NB) != 0) {
        if (folder < 0 || pm_clock() > deadline || *options->stop) {
            PM_TRY_DONE(pm_fail(PM_EFILE, "%s: %s", options->checkpoint,
                                folder < 0 ? "cannot be opened" : "another run uses it"));
        }
        nanosleep(&(struct timespec){.tv_nsec = WATCH_INTERVAL}, NULL);
    }
    PM_TRY_DONE(pm_launch_open(&launch, setup->scene->network.nprocess + 1, &options->log));
    PM_TRY_DONE(start_all(launch, &children));
    // The children are watched until the coordinator has ended or one of them has failed.
    while (status == PM_OK && !pm_launch_ended_well(launch, COORDINATOR)) {
        if (*options->stop) {
            // The coordinator ends the other processes and prints the tables of the steps done.
            pm_launch_signal(launch, COORDINATOR, SIGTERM);
            (void)pm_launch_wait(launch, STOP_GRACE);
            status = pm_fail(PM_EINTERRUPTED, "interrupted");
            break;
        }
        if (pm_status_requested()) {
            pm_launch_signal(launch, COORDINATOR, SIGUSR1);
        }
        nanosleep(&(struct timespec){.tv_nsec = WATCH_INTERVAL}, NULL);
        status = pm_launch_watch(launch, NULL);
    }
    // Among several failures the coordinator's says most. If it has succeeded, the run has.
    if (status != PM_EINTERRUPTED) {
        const pm_status end = pm_launch_wait(launch, END_GRACE);
        status = pm_launch_ended_well(launch, COORDINATOR) ? PM_OK : end;
    }
done:
    pm_launch_close(launch);
    // The checkpoints of a run that has succeeded are removed, after all children have ended.
    for (int i = -1; status == PM_OK && i < setup->scene->network.nprocess; ++i) {
        const char *name = i < 0 ? NULL : setup->scene->network.process[i].name;
        if (pm_prepare_checkpoint(setup, options, name, &checkpoint) == PM_OK) {
            unlink(checkpoint);
        }
    }
    if (folder >= 0) {
        close(folder);
    }
    return status;
}
