// portmetd status: listens for a moment to a run and prints how it is doing.
#include <stdio.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/health_table.h"
#include "base/progress.h"

#define PATIENCE 4.0 // s for a message to come, of which one is sent each second
#define INTERVAL 0.1 // s between two looks at the stop flag

typedef struct listener {
    const pm_scene *scene;
    int64_t session; // 0: any
    portmet_health_t health;
    bool heard;
} listener;

static void on_health(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    listener *l = context;
    if (!l->heard && pm_health_decode(&l->health, data, size) == PM_KEEP) {
        l->heard = l->session == 0 || l->health.session == l->session;
    }
}

static pm_status listen_to(listener *l, pm_transport *transport, const pm_run_options *options) {
    char channel[PM_CHANNEL_SIZE];
    PM_TRY(pm_channel_scene(channel, l->scene, "HEALTH"));
    PM_TRY(pm_transport_subscribe(transport, channel, on_health, l));
    for (const double end = pm_clock() + PATIENCE; !l->heard && pm_clock() < end;) {
        PM_TRY(pm_transport_wait(transport, INTERVAL, NULL));
        if (*options->stop) {
            return pm_fail(PM_EINTERRUPTED, "interrupted");
        }
    }
    return l->heard ? PM_OK
                    : pm_fail(PM_ETIMEOUT, "no run of scene %s says within %g s how it is doing",
                              l->scene->name, PATIENCE);
}

static pm_status execute(const pm_run_options *options) {
    pm_scene *scene = NULL;
    pm_transport *transport = NULL;
    pm_arena arena = {0};
    listener l = {.session = options->session};
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&scene, options->scene));
    l.scene = scene;
    PM_TRY_DONE(pm_connect_check(scene));
    PM_TRY_DONE(pm_connect_listener(scene, options->url));
    PM_TRY_DONE(pm_health_message_alloc(&l.health, &arena, scene->nprocess));
    PM_TRY_DONE(pm_connect_open(&transport, scene, "status", &options->log));
    PM_TRY_DONE(listen_to(&l, transport, options));
    pm_health_table_print(stdout, scene, &l.health);
done:
    pm_transport_close(transport);
    pm_arena_free(&arena);
    pm_scene_free(scene);
    return status;
}

static const pm_command command = {
    .arguments = "SCENE",
    .help =
        "Listens to a run of the scene, on this or any other host of the network, and prints how\n"
        "it is doing: the steps per second, and the process that all others wait for. For each\n"
        "process it prints the steps per second, the CPU time, the share of the time in which it\n"
        "is busy, the process that it waits for, the process whose messages it misses, the\n"
        "messages that it requests and sends again per second, the messages that it has dropped,\n"
        "the age of its checkpoint, and its memory. The coordinator prints the same table when it\n"
        "receives SIGUSR1.",
    .accepts = PM_OPTION_URL | PM_OPTION_SESSION,
    .execute = execute,
};

pm_status pm_command_status(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
