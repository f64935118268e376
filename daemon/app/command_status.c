// portmetd status: listens for a moment to a run and prints how it is doing (health_t in
// lcmtypes/portmet.lcm).
#include "app/status.h"

#include "app/command.h"
#include "app/connect.h"
#include "base/progress.h"

#define PATIENCE 4.0 // s for a message to come, of which one is sent each second
#define INTERVAL 0.1 // s between two looks at the stop flag
#define MEBIBYTE 1048576.0

// --- the table ---

static void print_share(FILE *file, const pm_scene *scene, int64_t peer, double share) {
    char text[64] = "-";
    if (peer != PM_HEALTH_NOBODY) {
        snprintf(text, sizeof text, "%.16s %.0f %%", pm_health_name(scene, peer), 100 * share);
    }
    fprintf(file, " %-20s", text);
}

// Prints a line for the run and one for each process as a table.
static void print_table(FILE *file, const pm_scene *scene, const portmet_health_t *h) {
    fprintf(file, "%s: step %lld", scene->name, (long long)(h->step < 0 ? 0 : h->step));
    if (h->steps < PM_STEPS_MAX) { // a run that is served may have no last step
        fprintf(file, " of %lld", (long long)h->steps);
    }
    fprintf(file, ", %.3g steps/s%s", h->rate, h->held ? ", held" : "");
    for (int i = 0; i < h->nprocess; ++i) {
        if (h->silent[i] < 0 && h->step < 0) {
            fprintf(file, "; %s is missing", pm_health_name(scene, i));
        } else if (h->silent[i] > pm_health_silence(h->nprocess, h->rate == 0)) {
            fprintf(file, "; %s is silent", pm_health_name(scene, i));
        }
    }
    if (h->blocker != PM_HEALTH_NOBODY) {
        fprintf(file, "; all others wait for %s", pm_health_name(scene, h->blocker));
    }
    for (int i = 0; i < h->nprocess; ++i) {
        if (h->loss[i] > PM_HEALTH_LOSS) {
            fprintf(file, "; %.0f %% lost from %s to %s", 100 * h->loss[i],
                    pm_health_name(scene, h->loses_from[i]), pm_health_name(scene, i));
        }
    }
    fprintf(file, "\n");
    fprintf(file, "%-16s %9s %9s %6s %8s %-20s %-20s %7s %7s %8s %8s %10s %6s %8s\n", "process",
            "step", "steps/s", "CPU, %", "busy, %", "waits for", "loses from", "asks/s", "sends/s",
            "dropped", "strange", "checkpoint", "MiB", "silent s");
    for (int i = 0; i < h->nprocess; ++i) {
        fprintf(file, "%-16.16s", scene->network.process[i].name);
        if (h->silent[i] < 0) {
            fprintf(file, " has not told yet how it is doing\n");
            continue;
        }
        fprintf(file, " %9lld %9.4g %6.0f %8.0f", (long long)h->process_step[i], h->process_rate[i],
                100 * h->cpu[i], 100 * h->computing[i]);
        print_share(file, scene, h->waits_for[i], h->waits_part[i]);
        print_share(file, scene, h->loses_from[i], h->loss[i]);
        fprintf(file, " %7.3g %7.3g %8lld %8lld", h->asks[i], h->answers[i], (long long)h->drops[i],
                (long long)h->strange[i]);
        if (h->checkpoint_age[i] < 0) {
            fprintf(file, " %10s", "none");
        } else {
            fprintf(file, " %8.0f s", h->checkpoint_age[i]);
        }
        fprintf(file, " %6.1f %8.0f\n", (double)h->rss[i] / MEBIBYTE, h->silent[i]);
    }
    fflush(file);
}

void pm_status_print(FILE *file, const pm_journal *log, const pm_scene *scene,
                     const portmet_health_t *h) {
    if (log == NULL || !log->json) {
        print_table(file, scene, h);
        return;
    }
    const pm_journal_field run[] = {{.name = "step", .number = (double)h->step},
                                    {.name = "steps", .number = (double)h->steps},
                                    {.name = "rate", .number = h->rate},
                                    {.name = "blocker", .text = pm_health_name(scene, h->blocker)}};
    pm_journal_write(log, PM_JOURNAL_NOTICE, 4, run, "status of the run");
    for (int i = 0; i < h->nprocess; ++i) {
        const pm_journal own = {log->json, log->program, scene->network.process[i].name};
        const pm_journal_field field[] = {
            {.name = "step", .number = (double)h->process_step[i]},
            {.name = "rate", .number = h->process_rate[i]},
            {.name = "cpu", .number = h->cpu[i]},
            {.name = "computing", .number = h->computing[i]},
            {.name = "waits_for", .text = pm_health_name(scene, h->waits_for[i])},
            {.name = "waits_part", .number = h->waits_part[i]},
            {.name = "loses_from", .text = pm_health_name(scene, h->loses_from[i])},
            {.name = "loss", .number = h->loss[i]},
            {.name = "rss", .number = (double)h->rss[i]},
            {.name = "silent", .number = h->silent[i]},
        };
        pm_journal_write(&own, PM_JOURNAL_NOTICE, (int)(sizeof field / sizeof field[0]), field,
                         "status of %s", scene->network.process[i].name);
    }
}

// --- the command ---

typedef struct listener {
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

static pm_status execute(const pm_run_options *options) {
    pm_scene *scene = NULL;
    pm_transport *transport = NULL;
    pm_arena arena = {0};
    listener l = {.session = options->session};
    const char *address;
    char channel[PM_CHANNEL_SIZE];
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&scene, options->scene));
    PM_TRY_DONE(pm_connect_check(scene));
    PM_TRY_DONE(pm_connect_listener(scene, options->url, &address));
    l.health.nprocess = scene->network.nprocess;
    PM_TRY_DONE(pm_health_alloc(&l.health, &arena));
    PM_TRY_DONE(pm_connect_open(&transport, scene, address, "status", &options->log));
    PM_TRY_DONE(pm_channel_scene(channel, scene->name, "HEALTH"));
    PM_TRY_DONE(pm_transport_subscribe(transport, channel, on_health, &l));
    for (const double end = pm_clock() + PATIENCE; !l.heard && pm_clock() < end;) {
        PM_TRY_DONE(pm_transport_wait(transport, INTERVAL, NULL));
        PM_TRY_DONE(*options->stop ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK);
    }
    PM_TRY_DONE(l.heard
                    ? PM_OK
                    : pm_fail(PM_ETIMEOUT, "no run of scene %s says within %g s how it is doing",
                              scene->name, PATIENCE));
    pm_status_print(stdout, NULL, scene, &l.health);
done:
    pm_transport_close(transport);
    pm_arena_free(&arena);
    pm_scene_free(scene);
    return status;
}

const pm_command pm_command_status = {
    .name = "status",
    .summary = "print how a run is doing",
    .arguments = "SCENE",
    .help =
        "Listens to a run of the scene, on this or any other host of the network, and prints how\n"
        "it is doing: the steps per second, and the process that all others wait for. For each\n"
        "process it prints the steps per second, the CPU time, the share of the time in which it\n"
        "is busy, the process that it waits for, the process whose messages it misses, the\n"
        "messages that it requests and sends again per second, the messages that it has dropped,\n"
        "the age of its checkpoint, and its memory. The coordinator prints the same table when it\n"
        "receives SIGUSR1.",
    .examples = "portmetd status configs/double_pendulum.yaml",
    .accepts = "url session",
    .execute = execute,
};
