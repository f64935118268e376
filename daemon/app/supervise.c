// Supervises children that keep checkpoints.
#include "app/supervise.h"

#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <sys/file.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"

#include "app/launch.h"
#include "app/prepare.h"
#include "app/status_request.h"
#include "lockstep/lockstep_coordinator.h"
#include "store/snapshot.h"

#define WATCH_INTERVAL 5000000 // ns between two looks at the children
#define END_GRACE 1.0          // s for all children to end by themselves after the first of them
#define STOP_GRACE 5.0         // s for the coordinator to end the run after it was told to stop
#define LOCK_GRACE 3.0         // s for the processes of a killed run to disappear
#define MAX_ARGUMENTS 24
#define COORDINATOR 0 // the first child

// Opens and locks the folder of the checkpoints. The children inherit the lock, so that it is free
// when the last process of a run is gone, however the run ended.
static pm_status lock(int *folder, const char *path, const volatile sig_atomic_t *stop) {
    const double deadline = pm_clock() + LOCK_GRACE;
    *folder = open(path, O_RDONLY | O_DIRECTORY);
    while (*folder < 0 || flock(*folder, LOCK_EX | LOCK_NB) != 0) {
        if (*folder < 0 || pm_clock() > deadline || *stop) {
            return pm_fail(PM_EFILE, "%s: %s", path,
                           *folder < 0 ? "cannot be opened" : "another run uses it");
        }
        nanosleep(&(struct timespec){.tv_nsec = WATCH_INTERVAL}, NULL);
    }
    return PM_OK;
}

// Chooses the session, as text: that of the checkpoints, or else a random one.
static pm_status choose_session(pm_setup *setup, const char *checkpoint, const char **text) {
    int64_t session = 0;
    bool found;
    PM_TRY(pm_snapshot_session(checkpoint, setup->system->digest, &session, &found));
    session = found ? session : pm_lockstep_session();
    *text = pm_arena_printf(&setup->arena, "%" PRId64, session);
    return *text == NULL ? pm_fail(PM_ENOMEM, "run: out of memory") : PM_OK;
}

const char *const *pm_supervise_arguments(pm_setup *setup, const pm_run_options *options,
                                          const char *session, const char *process) {
    const bool coordinates = process == NULL;
    const char **argv = pm_arena_array(&setup->arena, MAX_ARGUMENTS, sizeof *argv);
    const char *steps = pm_arena_printf(&setup->arena, "%d", setup->scene->steps);
    if (argv == NULL || steps == NULL) {
        return NULL;
    }
    const struct {
        const char *option, *value;
    } given[] = {
        {"--session", session},
        {"--url", setup->scene->url},
        {"--weights", options->weights},
        {"--checkpoint", options->checkpoint},
        {"--steps", coordinates ? steps : NULL},
        {"--record", coordinates ? options->record : NULL},
        {"--gate", coordinates ? options->gate : NULL},
    };
    int count = 0;
    argv[count++] = "portmetd";
    argv[count++] = coordinates ? "coordinator" : "node";
    for (size_t i = 0; i < sizeof given / sizeof given[0]; ++i) {
        if (given[i].value != NULL) {
            argv[count++] = given[i].option;
            argv[count++] = given[i].value;
        }
    }
    if (coordinates && options->quiet) {
        argv[count++] = "--quiet";
    }
    if (coordinates && options->record != NULL) {
        argv[count++] = "--overwrite"; // `run` has checked the file before it started a process
    }
    argv[count++] = "--";
    argv[count++] = options->scene;
    argv[count] = process;
    return argv;
}

static pm_status start(pm_launch *launch, pm_setup *setup, const pm_run_options *options,
                       const char *session, const char *process, const char *checkpoint) {
    const char *const *argv = pm_supervise_arguments(setup, options, session, process);
    const char *name = process == NULL ? "coordinator" : process;
    return argv == NULL ? pm_fail(PM_ENOMEM, "run: out of memory")
                        : pm_launch_start(launch, name, argv, checkpoint);
}

static pm_status start_all(pm_launch *launch, pm_setup *setup, const pm_run_options *options) {
    const pm_scene *scene = setup->scene;
    const char *checkpoint, *session;
    PM_TRY(pm_prepare_checkpoint(setup, options, NULL, &checkpoint));
    PM_TRY(choose_session(setup, checkpoint, &session));
    PM_TRY(start(launch, setup, options, session, NULL, checkpoint));
    for (int i = 0; i < scene->nprocess; ++i) {
        const char *name = scene->process[i].name;
        PM_TRY(pm_prepare_checkpoint(setup, options, name, &checkpoint));
        PM_TRY(start(launch, setup, options, session, name, checkpoint));
    }
    return PM_OK;
}

// Watches the children until the coordinator has ended or one of them has failed.
static pm_status watch(pm_launch *launch, const volatile sig_atomic_t *stop) {
    pm_status status = PM_OK;
    while (status == PM_OK && !pm_launch_ended_well(launch, COORDINATOR)) {
        if (*stop) {
            // The coordinator ends the other processes and prints the tables of the steps done.
            pm_launch_signal(launch, COORDINATOR, SIGTERM);
            (void)pm_launch_wait(launch, STOP_GRACE);
            return pm_fail(PM_EINTERRUPTED, "interrupted");
        }
        if (pm_status_request_take()) {
            pm_launch_signal(launch, COORDINATOR, SIGUSR1);
        }
        nanosleep(&(struct timespec){.tv_nsec = WATCH_INTERVAL}, NULL);
        status = pm_launch_watch(launch);
    }
    return status;
}

// Removes the checkpoints, after all children have ended.
static void remove_checkpoints(pm_setup *setup, const pm_run_options *options) {
    for (int i = -1; i < setup->scene->nprocess; ++i) {
        const char *name = i < 0 ? NULL : setup->scene->process[i].name;
        const char *checkpoint;
        if (pm_prepare_checkpoint(setup, options, name, &checkpoint) == PM_OK) {
            unlink(checkpoint);
        }
    }
}

pm_status pm_supervise(pm_setup *setup, const pm_run_options *options) {
    pm_launch *launch = NULL;
    int folder = -1;
    const char *checkpoint;
    pm_status status;
    // This makes the folder, too.
    PM_TRY_DONE(pm_prepare_checkpoint(setup, options, NULL, &checkpoint));
    PM_TRY_DONE(lock(&folder, options->checkpoint, options->stop));
    PM_TRY_DONE(pm_launch_open(&launch, setup->scene->nprocess + 1));
    PM_TRY_DONE(start_all(launch, setup, options));
    status = watch(launch, options->stop);
    // Among several failures the coordinator's says most. If it has succeeded, the run has.
    if (status != PM_EINTERRUPTED) {
        const pm_status end = pm_launch_wait(launch, END_GRACE);
        status = pm_launch_ended_well(launch, COORDINATOR) ? PM_OK : end;
    }
done:
    pm_launch_close(launch);
    if (status == PM_OK) {
        remove_checkpoints(setup, options);
    }
    if (folder >= 0) {
        close(folder);
    }
    return status;
}
