// portmetd view: shows a run, or a recording, as a page in a browser, and sends its values as JSON
// over UDP.
#include <arpa/inet.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/view_datagram.h"
#include "app/view_history.h"
#include "app/view_recording.h"
#include "app/view_server.h"
#include "app/view_text.h"
#include "lockstep/listener.h"

#define INTERVAL 0.05 // s between two looks at what has arrived

typedef struct view {
    const pm_run_options *options;
    pm_arena arena;
    pm_scene *scene;
    pm_view_graph graph;
    pm_view_history history;
    double *frame; // [history.width] the frame that is being made
    pm_transport *transport;
    pm_listener *listener;
    pm_view_server *server;
    int datagrams;         // file descriptor; -1: none are sent
    int64_t session, step; // of the newest frame
    int64_t health;        // number of the newest state of health
    int64_t health_count;  // health messages that it counts
    bool health_over;      // whether it says that the run is over
} view;

// --- what a client receives ---

static bool write_next(void *context, pm_view_progress *progress, FILE *file) {
    view *v = context;
    if (progress->scene == 0) {
        progress->scene = 1;
        pm_view_write_scene(file, &v->graph, v->options->recording);
        return true;
    }
    const portmet_health_t *health = v->listener == NULL ? NULL : pm_listener_health(v->listener);
    if (health != NULL && progress->health != v->health) {
        progress->health = v->health;
        pm_view_write_health(file, v->scene, health, pm_listener_is_over(v->listener));
        return true;
    }
    const double *frame = pm_view_history_next(&v->history, &progress->frame);
    if (frame == NULL) {
        return false;
    }
    pm_view_write_frame(file, &v->graph, frame);
    return true;
}

// --- a run ---

static void put_ledger(double *frame, const portmet_ledger_t *ledger) {
    frame[PM_VIEW_ENERGY] = ledger == NULL ? (double)NAN : ledger->energy;
    frame[PM_VIEW_ENTROPY] = ledger == NULL ? (double)NAN : ledger->entropy;
    frame[PM_VIEW_ENERGY_RESIDUAL] = ledger == NULL ? (double)NAN : ledger->energy_residual;
    frame[PM_VIEW_ENTROPY_RESIDUAL] = ledger == NULL ? (double)NAN : ledger->entropy_residual;
    frame[PM_VIEW_VIOLATIONS] = ledger == NULL ? (double)NAN : (double)ledger->violations;
}

// Makes a frame of the newest sample, if it is a new one.
static pm_status take_frame(view *v) {
    const int64_t session = pm_listener_session(v->listener);
    const pm_sample *sample = pm_listener_sample(v->listener);
    if (sample == NULL || (session == v->session && sample->step == v->step)) {
        return PM_OK;
    }
    if (session != v->session) {
        pm_view_history_clear(&v->history);
    }
    v->session = session;
    v->step = sample->step;
    v->frame[PM_VIEW_SESSION_HIGH] = (double)((uint64_t)session >> 32);
    v->frame[PM_VIEW_SESSION_LOW] = (double)(uint32_t)session;
    v->frame[PM_VIEW_STEP] = (double)sample->step;
    v->frame[PM_VIEW_TIME] = sample->time;
    put_ledger(v->frame, pm_listener_ledger(v->listener));
    pm_view_frame_fill(&v->graph, sample, v->frame);
    pm_view_history_add(&v->history, v->frame);
    return v->datagrams < 0
               ? PM_OK
               : pm_view_write_values(&v->graph, v->frame, pm_listener_health(v->listener),
                                      pm_view_datagram_send, &v->datagrams);
}

static pm_status look(view *v) {
    PM_TRY(pm_listener_read(v->listener));
    PM_TRY(take_frame(v));
    const int64_t count = pm_listener_health_count(v->listener);
    const bool over = pm_listener_is_over(v->listener);
    if (count != v->health_count || over != v->health_over) {
        v->health += 1;
        v->health_count = count;
        v->health_over = over;
    }
    return PM_OK;
}

static void sleep_for(double seconds) {
    const struct timespec time = {.tv_nsec = (long)(1e9 * seconds)};
    (void)nanosleep(&time, NULL);
}

static pm_status watch(view *v) {
    while (*v->options->stop == 0) {
        if (v->listener != NULL) {
            PM_TRY(look(v));
        }
        if (v->server == NULL) {
            sleep_for(INTERVAL);
            continue;
        }
        pm_view_server_wake(v->server);
        PM_TRY(pm_view_server_serve(v->server, INTERVAL, v->options->stop));
    }
    return pm_fail(PM_EINTERRUPTED, "interrupted");
}

// --- opening ---

static pm_status check_options(const pm_run_options *options) {
    struct in_addr address;
    if (options->bind != NULL && inet_pton(AF_INET, options->bind, &address) != 1) {
        return pm_fail(PM_EUSAGE, "--bind %s: expected an IPv4 address of this host, such as %s",
                       options->bind, "0.0.0.0 for all");
    }
    if (options->recording != NULL && options->udp != 0) {
        return pm_fail(PM_EUSAGE, "--udp is for runs, and --recording for the page");
    }
    return PM_OK;
}

static pm_status open_run(view *v) {
    PM_TRY(pm_connect_check(v->scene));
    PM_TRY(pm_connect_listener(v->scene, v->options->url));
    PM_TRY(pm_connect_open(&v->transport, v->scene, "view", &v->options->log));
    return pm_listener_open(&v->listener, v->transport, v->scene, v->options->session);
}

// The page is served unless only --udp is given.
static pm_status open_outputs(view *v) {
    const pm_run_options *options = v->options;
    if (options->udp != 0) {
        PM_TRY(pm_view_datagram_open(&v->datagrams, (int)options->udp));
        printf("portmetd: values of %s as JSON to udp://127.0.0.1:%d\n", v->scene->name,
               (int)options->udp);
    }
    if (options->udp == 0 || options->port != 0) {
        const char *address = options->bind == NULL ? "127.0.0.1" : options->bind;
        const int port = options->port == 0 ? PM_VIEW_PORT : (int)options->port;
        PM_TRY(pm_view_server_open(&v->server, address, port, write_next, v));
        printf("portmetd: a view of %s at http://%s:%d/\n", v->scene->name, address, port);
    }
    fflush(stdout);
    return PM_OK;
}

static pm_status open_view(view *v) {
    PM_TRY(check_options(v->options));
    PM_TRY(pm_scene_load(&v->scene, v->options->scene));
    // A recording may have some subsystems alone.
    const bool *shown = v->options->recording == NULL ? NULL : v->scene->recorded;
    PM_TRY(pm_view_graph_init(&v->graph, &v->arena, v->scene, shown));
    const int width = pm_view_frame_size(&v->graph);
    PM_TRY(pm_view_history_init(&v->history, &v->arena, width));
    v->frame = pm_arena_array(&v->arena, (size_t)width, sizeof *v->frame);
    if (v->frame == NULL) {
        return pm_fail(PM_ENOMEM, "view: out of memory");
    }
    PM_TRY(v->options->recording != NULL
               ? pm_view_recording_read(v->options->recording, &v->graph, &v->history)
               : open_run(v));
    return open_outputs(v);
}

static pm_status execute(const pm_run_options *options) {
    view v = {.options = options, .datagrams = -1, .step = -1};
    pm_status status;
    PM_TRY_DONE(open_view(&v));
    PM_TRY_DONE(watch(&v));
done:
    pm_view_server_close(v.server);
    pm_listener_close(v.listener);
    pm_transport_close(v.transport);
    if (v.datagrams >= 0) {
        close(v.datagrams);
    }
    pm_arena_free(&v.arena);
    pm_scene_free(v.scene);
    return status;
}

static const pm_command command = {
    .arguments = "SCENE",
    .help =
        "Shows a run of the scene, which goes on beside it on this or any other host of the\n"
        "network, as a page in a browser: the subsystems as a graph, with arrows as wide as the\n"
        "power through each port; both laws; energies and entropies over time; and how each\n"
        "process is doing. The page can stop at any time of the run. A view shows whatever run of\n"
        "the scene it hears, one after the other, and cannot change any. With --recording it "
        "shows\n"
        "a recording. It ends when it is interrupted.",
    .accepts = PM_OPTION_PORT | PM_OPTION_BIND | PM_OPTION_UDP | PM_OPTION_RECORDING |
               PM_OPTION_URL | PM_OPTION_SESSION,
    .execute = execute,
};

pm_status pm_command_view(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
