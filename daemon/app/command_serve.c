// The commands serve, coordinator and node of portmetd. `serve` launches all processes and makes
// one run after another, as clients ask (lockstep/control.h). `coordinator` makes one run with
// processes that were started by hand. `node` is such a process.
#include "app/serve.h"

#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "app/connect.h"
#include "app/launch.h"
#include "app/notify.h"
#include "app/observer.h"
#include "app/prepare.h"
#include "base/options.h"
#include "library/names.h"
#include "lockstep/control.h"
#include "lockstep/node.h"
#include "model/training_range.h"

#define MOST_STARTING 16     // nodes that start at the same time
#define LAUNCH_INTERVAL 0.25 // s after which one more starts, whatever the others do
#define WATCH_INTERVAL 0.05  // s between two looks at the children
#define SETTLED 1.0          // s after which the control has asked whether there is another
// s between two looks at the children while nothing is to be done. An interrupt may wait for the
// next one, and mpirun kills what has not ended after 1 s.
#define RESTING 0.5
#define WATCHDOG_INTERVAL 1.0 // s between two words to the service manager
#define END_GRACE 5.0         // s for the nodes to end by themselves after the last step

// Writes a warning to `log` if messages were dropped that no process of this scene sends:
// their number, and the reasons. `drops` are the counts of the state machine on this transport.
static void warn_of_drops(const pm_transport *transport, const pm_drops *drops,
                          const pm_journal *log) {
    // A best-effort network, or another run of the same scene, causes other drops; they do not
    // count.
    const pm_drops *below = pm_transport_drops(transport);
    char list[256];
    size_t used = 0;
    long total = 0;
    for (int i = 0; i < PM_NDROP; ++i) {
        const pm_drop drop = (pm_drop)i;
        const long count = pm_drop_is_strange(drop) ? drops->count[i] + below->count[i] : 0;
        if (count > 0 && used < sizeof list) {
            const int length = snprintf(list + used, sizeof list - used, "%s%ld %s",
                                        total > 0 ? ", " : "", count, pm_drop_name(drop));
            used += length < 0 ? 0 : (size_t)length;
        }
        total += count;
    }
    if (total > 0) {
        const pm_journal_field count = {.name = "dropped", .number = (double)total};
        pm_journal_write(log, PM_JOURNAL_WARNING, 1, &count, "messages dropped: %s", list);
    }
}

static void tell_alive(void *context, int64_t step) {
    (void)context;
    pm_notify("WATCHDOG=1\nSTATUS=step %lld", (long long)step);
}

// Opens the node of a process on a transport.
static pm_status open_node(pm_lockstep_node **node, pm_setup *setup, const pm_run_options *options,
                           int process_id, pm_transport *transport) {
    const char *name = setup->scene->network.process[process_id].name;
    pm_lockstep_node_options node_options = {
        .z = setup->initial,
        .session = options->session,
        .stays = options->stays,
        .alive = options->in_process ? NULL : tell_alive,
        .boundary_input = &setup->boundary_input,
        .live = setup->live,
    };
    PM_TRY(pm_prepare_checkpoint(setup, options, name, &node_options.checkpoint));
    return pm_lockstep_node_open(node, setup->system, process_id, transport, &node_options);
}

pm_status pm_serve_node(pm_setup *setup, const pm_run_options *options, int process_id) {
    const char *name = setup->scene->network.process[process_id].name;
    pm_transport *transport = NULL;
    pm_lockstep_node *node = NULL;
    pm_status status;
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene,
                                pm_connect_url(setup->scene, options->url), name, &options->log));
    PM_TRY_DONE(open_node(&node, setup, options, process_id, transport));
    pm_notify("READY=1");
    status = pm_lockstep_run_node(node, options->stop);
    warn_of_drops(transport, pm_lockstep_node_drops(node), &options->log);
    if (options->coordinator_speaks && status != PM_OK && status != PM_ETIMEOUT) {
        status = pm_fail(status, "%s", "");
    }
done:
    pm_lockstep_node_close(node);
    pm_transport_close(transport);
    return status;
}

// A mutable global, since a signal handler can reach nothing else: SIGHUP asks to read the scene
// again.
static volatile sig_atomic_t hung_up = 0;

static void hang_up(int signal_number) {
    (void)signal_number;
    hung_up = 1;
}

// A coordinator with the nodes that it launches: of one run, or of the runs that clients start.
typedef struct service {
    pm_setup *setup;
    pm_run_options options; // of the present run
    const char *folder;     // of recordings; NULL: none
    char path[1024];        // of the recording
    pm_observer observer;   // of the present run
    pm_lockstep_coordinator *coordinator;
    pm_control *control; // NULL: clients cannot reach it
    const pm_journal *log;
    bool runs;   // a run of a client is under way
    bool reload; // this process is to begin anew
    pm_launch *launch;
    pm_lockstep_node *inside; // the only node, in this process, on the coordinator's transport;
                              // NULL: nodes have processes of their own
    pm_run_options node;      // options of the nodes
    int next;  // node that is to be launched; the coordinator answers those before it
    double at; // s, when the last one was
} service;

// The life of a node.
static pm_status serve_node(void *context, const char *name) {
    const service *s = context;
    if (s->node.stays) {
        // It may start in the middle of a run. The recording, and the lock on it, are the parent's.
        (void)close_range(STDERR_FILENO + 1, ~0U, 0);
    }
    return pm_serve_node(s->setup, &s->node, pm_scene_find_process(s->setup->scene, name));
}

// Checks the files, so that a mistake in them does not end the service.
static pm_status check_reload(void *context) {
    service *s = context;
    pm_setup fresh = {0};
    pm_status status = pm_prepare(&fresh, &s->options, PM_TO_COORDINATE);
    if (status == PM_OK && strcmp(fresh.scene->name, s->setup->scene->name) != 0) {
        status = pm_fail(PM_ECONFIG, "%s: is now scene %s, and %s is served", fresh.scene->path,
                         fresh.scene->name, s->setup->scene->name);
    }
    pm_setup_free(&fresh);
    s->reload = status == PM_OK;
    return status;
}

// Looks at the children, the stop flag and SIGHUP, and starts more nodes. A failure ends the
// coordinator.
static pm_status watch(service *s, int *deaths) {
    const int before = *deaths;
    const bool stays = s->node.stays;
    const pm_status status = pm_launch_watch(s->launch, deaths);
    if (stays && hung_up && !s->runs) {
        hung_up = 0;
        if (check_reload(s) != PM_OK) {
            pm_journal_write(s->log, PM_JOURNAL_ERROR, 0, NULL, "not read again: %s", pm_error());
        }
    }
    // A process that was killed starts again, for the next run.
    if (stays && *deaths > before && s->node.checkpoint == NULL) {
        pm_lockstep_coordinator_fail(s->coordinator, PM_ENET,
                                     "a process was killed, and the run keeps no checkpoints");
    }
    if (*s->node.stop || (s->reload && !s->runs)) {
        return pm_fail(PM_EINTERRUPTED, "interrupted");
    }
    // Nodes share the cores, and each has to start within its patience: so another one starts as
    // long as few of those before have yet to say hello.
    const pm_network *network = &s->setup->scene->network;
    const int most = s->node.elsewhere || s->inside != NULL ? 0 : network->nprocess;
    while (status == PM_OK && s->next < most &&
           (s->next - pm_lockstep_coordinator_present(s->coordinator) < MOST_STARTING ||
            pm_clock() > s->at + LAUNCH_INTERVAL)) {
        const char *name = network->process[s->next].name, *progress = NULL;
        if (stays) { // a node that is killed starts again
            PM_TRY(pm_prepare_checkpoint(s->setup, &s->node, name, &progress));
            progress = progress == NULL ? s->setup->scene->path : progress;
        }
        PM_TRY(
            pm_launch_start(s->launch, name, (pm_launch_program){serve_node, s, stays}, progress));
        s->next += 1;
        s->at = pm_clock();
    }
    return status;
}

// Runs the coordinator's loop, and watches the children: until the run is over, or, if it stays,
// until the user ends the service or a child fails for good.
static pm_status conduct(service *s) {
    pm_lockstep_coordinator *coordinator = s->coordinator;
    pm_transport *transport = pm_lockstep_coordinator_transport(coordinator);
    const int nprocess = s->setup->scene->network.nprocess;
    const bool stays = s->node.stays;
    pm_status first = PM_OK; // the first failure of a child, or the interrupt
    char reason[1024] = "";
    int deaths = 0;
    bool ready = false;
    double now = pm_clock(), looked = 0, notified = 0;
    const double begun = now;
    while (!pm_lockstep_coordinator_finished(coordinator)) {
        if (first == PM_OK && now - looked > WATCH_INTERVAL) {
            looked = now;
            first = watch(s, &deaths);
            snprintf(reason, sizeof reason, "%s", first == PM_OK ? "" : pm_error());
        }
        if (first != PM_OK) { // an interrupt alone ends a coordinator that stays
            pm_lockstep_coordinator_fail(coordinator, stays ? PM_EINTERRUPTED : first, reason);
        }
        if (now - notified > WATCHDOG_INTERVAL) {
            notified = now;
            pm_notify("WATCHDOG=1");
        }
        // Processes that run elsewhere may come much later.
        if (!ready &&
            (s->node.elsewhere || pm_lockstep_coordinator_present(coordinator) == nprocess)) {
            ready = true;
            pm_notify("READY=1");
        }
        double next = pm_lockstep_coordinator_poll(coordinator, now);
        if (s->inside != NULL) {
            next = fmin(next, pm_lockstep_node_poll(s->inside, now));
        }
        if (s->control != NULL && pm_control_poll(s->control) != PM_OK && first == PM_OK) {
            first = PM_ENET;
            snprintf(reason, sizeof reason, "%s", pm_error());
        }
        const bool rests = next - now > 2 * WATCH_INTERVAL && now > begun + SETTLED;
        const double interval = rests ? RESTING : WATCH_INTERVAL;
        const double wait = fmax(0, fmin(next - now, interval));
        coordinator->endpoint.presence.planned = wait;
        PM_TRY(pm_transport_wait(transport, wait, NULL));
        now = pm_clock();
    }
    return stays && first != PM_OK ? pm_fail(first, "%s", reason)
                                   : pm_lockstep_coordinator_result(coordinator);
}

// --- the runs of clients ---

static void tell(const service *s, const pm_control_run *run, const char *text) {
    const pm_journal_field field[] = {{.name = "run", .number = (double)run->number},
                                      {.name = "client", .text = run->owner}};
    pm_journal_write(s->log, PM_JOURNAL_NOTICE, 2, field, "run %" PRId64 " of %s: %s", run->number,
                     run->owner, text);
}

static pm_status place(void *context, const char *name, const char *suffix, char *path,
                       size_t size) {
    const service *s = context;
    struct stat file;
    snprintf(path, size, "%s/%s%s", s->folder, name, suffix);
    return lstat(path, &file) == 0 && !S_ISREG(file.st_mode) // a link leads elsewhere
               ? pm_fail(PM_EFILE, "%s: is no file", path)
               : PM_OK;
}

static pm_status begin_run(void *context, const pm_control_run *run,
                           pm_lockstep_observer *observer) {
    service *s = context;
    char text[1200], from[48], steps[32] = "until it is stopped";
    s->options.record = NULL;
    if (run->record[0] != 0) {
        PM_TRY(place(s, run->record, "", s->path, sizeof s->path));
        s->options.record = s->path;
    }
    const pm_status status = pm_observer_open(&s->observer, s->setup, &s->options);
    if (status != PM_OK) {
        pm_observer_close(&s->observer);
        return status;
    }
    *observer = pm_observer_attach(&s->observer, s->setup).observer;
    s->runs = true;
    if (run->steps > 0) {
        snprintf(steps, sizeof steps, "%" PRId64 " steps", run->steps);
    }
    snprintf(from, sizeof from, "goes on after step %" PRId64, run->from);
    snprintf(text, sizeof text, "%s, %s%s%s%s",
             run->from >= 0     ? from
             : run->from_client ? "begins at the state of the client"
                                : "begins at the scene's state",
             steps, run->held ? ", held at its start" : "",
             s->options.record == NULL ? "" : ", recorded in ",
             s->options.record == NULL ? "" : s->path);
    tell(s, run, text);
    return PM_OK;
}

static pm_status end_run(void *context, const pm_control_run *run, int64_t step, pm_status status,
                         const char *message) {
    service *s = context;
    char text[PM_TEXT_MAX + 64], reason[PM_TEXT_MAX + 1];
    status = status == PM_OK ? PM_OK : pm_fail(status, "%s", message);
    status =
        pm_observer_finish(&s->observer, status, pm_lockstep_coordinator_ledger(s->coordinator),
                           pm_lockstep_coordinator_pace(s->coordinator), "over LCM");
    snprintf(reason, sizeof reason, "%s", status == PM_OK ? "" : pm_error());
    pm_observer_close(&s->observer);
    s->observer = (pm_observer){0};
    s->runs = false;
    snprintf(text, sizeof text, "ended after step %" PRId64 "%s%s", step < 0 ? 0 : step,
             status == PM_OK ? "" : ": ", reason);
    tell(s, run, text);
    return status == PM_OK ? PM_OK : pm_fail(status, "%s", reason);
}

static void put_digest(FILE *file, const pm_component *component) {
    const pm_provenance *of = component->provenance;
    char verdict[2 * PM_VERDICT_LENGTH];
    fprintf(file, ",\"weights\":\"%016" PRIx64 "\",\"loss\":%.3g", of->digest, of->loss);
    if (of->verdict != NULL && of->verdict[0] != '\0') {
        pm_json_quote(verdict, sizeof verdict, of->verdict);
        fprintf(file, ",\"verdict\":%s", verdict);
    }
    fputs("}", file);
}

// Writes what is served as JSON: {"scene", "dt", "steps", "integrator", "substeps", "digest",
// "records", "view", "states", "subsystems": [{"name", "groups": [[name, unit, size, least and
// largest value of the training where the weights know them]], "weights", "loss", and where the
// weights know it "verdict" of the fit}], "ports": [{"name", "law", "ends", "weights", "loss",
// "verdict"}], "inputs": [[name, channel, unit]]}. Names need no quoting.
static pm_status describe(service *s, char **text) {
    const pm_scene *scene = s->setup->scene;
    const pm_physics *physics = &scene->physics;
    const bool states = !pm_scene_may_report_sums(scene); // else there are too many to list
    char unit[128];
    size_t size;
    pm_scene_variables variables;
    PM_TRY(pm_scene_variable_names(&variables, scene, &s->setup->arena));
    FILE *file = open_memstream(text, &size);
    PM_TRY(pm_allocated(file, "the description of scene %s", scene->name));
    fprintf(file,
            "{\"scene\":\"%s\",\"dt\":%.17g,\"steps\":%d,\"integrator\":\"%s\",\"substeps\":%d,"
            "\"digest\":\"%016" PRIx64
            "\",\"records\":%s,\"view\":%s,\"states\":%s,\"subsystems\":[",
            scene->name, physics->dt, scene->run.steps, physics->integrator->name,
            physics->substeps, s->setup->system->digest, s->folder == NULL ? "false" : "true",
            s->options.control == NULL ? "false" : "true", states ? "true" : "false");
    for (int i = 0; i < physics->nsubsystem && states; ++i) {
        const pm_scene_subsystem *subsystem = &physics->subsystem[i];
        const pm_training_range range = pm_training_range_of(s->setup->system->part[i]);
        fprintf(file, "%s{\"name\":\"%s\",\"groups\":[", i == 0 ? "" : ",", subsystem->name);
        for (int g = 0; g < subsystem->layout.ngroup; ++g) {
            const pm_group *group = &subsystem->layout.group[g];
            pm_json_quote(unit, sizeof unit, group->unit);
            fprintf(file, "%s[\"%s\",%s,%d", g == 0 ? "" : ",", group->name, unit, group->size);
            if (range.low != NULL && isfinite(range.low[g]) && isfinite(range.high[g])) {
                fprintf(file, ",%.6g,%.6g", range.low[g], range.high[g]);
            }
            fputs("]", file);
        }
        fputs("]", file);
        put_digest(file, &s->setup->system->component[i]);
    }
    fputs("],\"ports\":[", file);
    for (int i = 0; i < physics->nport && states; ++i) {
        const pm_scene_port *port = &physics->port[i];
        fprintf(file, "%s{\"name\":\"%s\",\"law\":\"%s\",\"ends\":[\"%s\",\"%s\"]",
                i == 0 ? "" : ",", port->name, port->law, port->between[0], port->between[1]);
        put_digest(file, &s->setup->system->component[physics->nsubsystem + i]);
    }
    fputs("],\"inputs\":[", file);
    for (int j = 0, n = 0; j < scene->network.nlive_input; ++j) {
        const pm_scene_live_input *input = &scene->network.live_input[j];
        for (int k = 0; k < input->count; ++k) {
            const char *of = "?"; // of the first quantity that it gives
            for (int i = physics->nprescribed - 1; i >= 0; --i) {
                of = s->setup->boundary_input.live_id[i] == n ? variables.input.unit[i] : of;
            }
            pm_json_quote(unit, sizeof unit, of);
            fprintf(file, "%s[\"%s\",\"%s\",%s]", n == 0 ? "" : ",", input->name[k], input->channel,
                    unit);
            n += 1;
        }
    }
    fputs("]}", file);
    return fclose(file) == 0 ? PM_OK
                             : pm_fail(PM_ENOMEM, "the description of scene %s", scene->name);
}

// --- a coordinator ---

enum { MOST_WORDS = 64, MOST_BYTES = 65536 };

pm_status pm_serve_coordinator(pm_setup *setup, const pm_run_options *options) {
    const pm_scene *scene = setup->scene;
    const char *url = pm_connect_url(scene, options->url);
    const bool stays = options->stays, ranks = pm_transport_has_ranks(url);
    service s = {.setup = setup, .options = *options, .node = *options, .log = &options->log};
    pm_transport *transport = NULL;
    char *description = NULL, host[64] = "", name[64];
    pm_lockstep_coordinator_options own = {.stays = true};
    pm_status status;
    (void)gethostname(host, sizeof host - 1);
    snprintf(name, sizeof name, "process %ld on %.31s", (long)getpid(), host);
    if (stays) {
        s.folder = options->record;
        s.options.quiet = true;
        PM_TRY_DONE(s.folder == NULL ? PM_OK : pm_options_folder(s.folder));
        own.want_state = !pm_scene_may_report_sums(scene);
    } else { // the run begins at once
        PM_TRY_DONE(pm_observer_open(&s.observer, setup, &s.options));
        own = pm_observer_attach(&s.observer, setup);
        own.held = options->held;
    }
    PM_TRY_DONE(pm_prepare_checkpoint(setup, options, NULL, &own.checkpoint));
    own.session =
        options->session > 0 || options->elsewhere ? options->session : pm_lockstep_session();
    s.node.session = own.session;
    s.node.log.json = false; // this process passes their lines on
    PM_TRY_DONE(pm_connect_open(&transport, scene, url, "coordinator", &options->log));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&s.coordinator, setup->system, transport, &own));
    if (stays && options->in_process) {
        PM_TRY_DONE(open_node(&s.inside, setup, &s.node, 0, transport));
    }
    if (!ranks) {
        PM_TRY_DONE(describe(&s, &description));
        const pm_control_service serves = {.context = &s,
                                           .description = description,
                                           .views = options->control != NULL,
                                           .path = s.folder == NULL ? NULL : place,
                                           .begin = begin_run,
                                           .end = end_run,
                                           .reload = check_reload,
                                           .checkpoint = stays ? own.checkpoint : NULL,
                                           .session = options->address,
                                           .name = name};
        PM_TRY_DONE(pm_control_open(&s.control, s.coordinator, &serves));
    }
    PM_TRY_DONE(pm_launch_open(&s.launch, scene->network.nprocess, &options->log));
    if (stays) {
        const struct sigaction action = {.sa_handler = hang_up, .sa_flags = SA_RESTART};
        sigaction(SIGHUP, &action, NULL);
    }
    status = conduct(&s);
    if (stays) { // the user ends a service by an interrupt
        status = status == PM_EINTERRUPTED ? PM_OK : status;
    } else {
        status = status == PM_OK ? pm_launch_wait(s.launch, END_GRACE) : status;
        status =
            pm_observer_finish(&s.observer, status, pm_lockstep_coordinator_ledger(s.coordinator),
                               pm_lockstep_coordinator_pace(s.coordinator),
                               ranks                ? "a rank each, over MPI"
                               : options->elsewhere ? "over LCM"
                                                    : "a process each, over LCM");
    }
    warn_of_drops(transport, pm_lockstep_coordinator_drops(s.coordinator), &options->log);
done:
    pm_launch_close(s.launch);
    pm_lockstep_node_close(s.inside);
    pm_control_close(s.control);
    pm_lockstep_coordinator_close(s.coordinator);
    pm_transport_close(transport);
    pm_observer_close(&s.observer);
    free(description);
    if (status != PM_OK || !s.reload || *options->stop != 0) {
        return status;
    }
    // This process begins anew, with the same command line, number and place.
    char *argv[MOST_WORDS] = {NULL}, *line = calloc(1, MOST_BYTES);
    FILE *file = fopen("/proc/self/cmdline", "r");
    const size_t length = file == NULL || line == NULL ? 0 : fread(line, 1, MOST_BYTES - 1, file);
    size_t at = 0;
    for (int i = 0; i < MOST_WORDS - 1 && at < length; ++i) {
        argv[i] = line + at;
        at += strlen(argv[i]) + 1;
    }
    if (file != NULL) {
        fclose(file);
    }
    execv("/proc/self/exe", argv);
    free(line);
    return pm_fail(PM_EFILE, "/proc/self/exe: cannot be started again");
}

// --- the commands ---

// Prepares a process that the user starts. The ranks of an MPI run are started by mpirun alone.
static pm_status prepare(pm_setup *setup, const pm_run_options *options, pm_purpose purpose,
                         const char *command) {
    PM_TRY(pm_prepare(setup, options, purpose));
    const pm_scene *scene = setup->scene;
    const char *url = pm_connect_url(scene, options->url);
    return pm_transport_has_ranks(url)
               ? pm_fail(PM_EUSAGE,
                         "%s does not work at %s: mpirun starts all processes, by "
                         "\"mpirun -n %d portmetd run %s --url %s\"",
                         command, url, scene->network.nprocess + 1, scene->path, url)
               : PM_OK;
}

static pm_status execute_node(const pm_run_options *options) {
    pm_setup setup;
    pm_status status;
    PM_TRY_DONE(prepare(&setup, options, PM_TO_SERVE, "node"));
    const pm_scene *scene = setup.scene;
    const int process_id = pm_scene_find_process(scene, options->name);
    if (process_id >= 0) {
        status = pm_serve_node(&setup, options, process_id);
        goto done;
    }
    char list[256] = "";
    size_t used = 0;
    for (int i = 0; i < scene->network.nprocess && used < sizeof list; ++i) {
        const int length = snprintf(list + used, sizeof list - used, "%s%s", i == 0 ? "" : ", ",
                                    scene->network.process[i].name);
        used += length < 0 ? 0 : (size_t)length;
    }
    status = pm_fail(PM_EUSAGE, "%s: no process called \"%s\"; there are: %s", scene->path,
                     options->name, list);
done:
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_node = {
    .name = "node",
    .summary = "serve one process of a scene",
    .arguments = "SCENE NAME",
    .help = "Serves the process NAME: one subsystem, or those that the scene's `processes` list.\n"
            "It publishes their energy and entropy fluxes through the ports to other processes,\n"
            "listens to the fluxes of these, and steps when the coordinator grants a step. It\n"
            "ends when the run does. Scene, weights and initial state must be the same on every\n"
            "host; the coordinator refuses a node that differs. Start the processes by hand, one\n"
            "in each terminal or on each host, in any order:\n\n"
            "  portmetd node SCENE NAME1\n"
            "  portmetd node SCENE NAME2\n"
            "  portmetd coordinator SCENE\n\n"
            "With --serve it waits for one run after another, as long as it takes: beside\n"
            "`portmetd serve --elsewhere`.\n\n"
            "If all of them have --checkpoint, one that was killed goes on when the same command\n"
            "starts it again within the scene's `patience`.",
    .examples = "portmetd node configs/double_pendulum.yaml upper",
    .accepts = "weights url session checkpoint log stays compiled",
    .execute = execute_node,
};

static pm_status execute_coordinator(const pm_run_options *options) {
    pm_setup setup = {0};
    pm_run_options own = *options;
    pm_status status;
    own.elsewhere = true;
    PM_TRY_DONE(prepare(&setup, options, PM_TO_COORDINATE, "coordinator"));
    PM_TRY_DONE(pm_prepare_check_steps(&setup, options));
    status = pm_serve_coordinator(&setup, &own);
done:
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_coordinator = {
    .name = "coordinator",
    .summary = "step the nodes of a scene that run elsewhere",
    .arguments = "SCENE",
    .help =
        "Waits for one `portmetd node` per process, on this or any other host of the network,\n"
        "then steps them together, keeps the ledger of energy and entropy, records, and prints\n"
        "the same tables as `portmetd run`. Nodes with another scene, other weights or another "
        "initial\n"
        "state are refused by name. With --checkpoint it continues after a kill; remove\n"
        "the files in the folder when all processes have ended well.",
    .examples = "portmetd coordinator configs/double_pendulum.yaml --record run.h5",
    .accepts = "steps record replay overwrite weights url session checkpoint held log quiet",
    .execute = execute_coordinator,
};

static pm_status execute_serve(const pm_run_options *options) {
    pm_setup setup = {0};
    pm_run_options own = *options;
    pm_status status;
    own.stays = true;
    if (options->control != NULL && strcmp(options->control, "view") != 0) {
        return pm_fail(PM_EUSAGE, "--control: expected view, found \"%s\"", options->control);
    }
    if (options->in_process && (options->checkpoint != NULL || options->elsewhere)) {
        return pm_fail(PM_EUSAGE, "serve: --checkpoint and --elsewhere are for processes that may "
                                  "die one by one, not for --in-process");
    }
    PM_TRY_DONE(prepare(&setup, options, PM_TO_COORDINATE, "serve"));
    status = pm_serve_coordinator(&setup, &own);
done:
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_serve = {
    .name = "serve",
    .summary = "serve a scene: start, hold, step and end runs over LCM",
    .arguments = "SCENE",
    .help =
        "Launches the processes of the scene once, and waits for clients: `portmetd start`,\n"
        "`pause`, `resume`, `advance`, `set`, `reset`, `stop` and `query`, or any program that\n"
        "sends control_t over LCM (daemon/WIRE.md). One run is under way at a time. After a run,\n"
        "and after one that has failed, it waits for the next, as long as it takes. Ctrl-C or\n"
        "SIGTERM ends the run and the service; SIGHUP reads the scene and its weights again, "
        "between\n"
        "two runs. With --record clients may record runs, in that\n"
        "folder. With --checkpoint a process that is killed within a run goes on; without, the\n"
        "run fails and the next one can be started. With --in-process and --compiled a single\n"
        "step takes least.",
    .examples = "portmetd serve configs/double_pendulum.yaml --record recordings\n"
                "portmetd serve configs/double_pendulum.yaml --in-process --compiled",
    .accepts = "checkpoint folder weights url session log elsewhere compiled together",
    .execute = execute_serve,
};
