// portmetd run and serve. Over LCM they start the scene's processes and are themselves the
// coordinator: of one run that starts at once, or of one run after another as clients ask for them.
// With run --in-process all subsystems live in this thread.
#include <inttypes.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/launch.h"
#include "app/notify.h"
#include "app/observer.h"
#include "app/prepare.h"
#include "app/serve.h"
#include "app/supervise.h"
#include "base/options.h"
#include "library/fleet.h"
#include "library/local_run.h"
#include "library/names.h"
#include "lockstep/control.h"
#include "lockstep/gate.h"
#include "lockstep/node.h"
#include "model/training_range.h"

#define MOST_STARTING 16      // nodes that start at the same time
#define LAUNCH_INTERVAL 0.25  // s after which one more starts, whatever the others do
#define WATCH_INTERVAL 0.05   // s between two looks at the children
#define GATE_INTERVAL 0.002   // s between two looks at the gate that holds a run in this thread
#define RESTING 0.5           // s between two looks at the children while nothing is to be done
#define WATCHDOG_INTERVAL 1.0 // s between two words to the service manager
#define END_GRACE 5.0         // s for the nodes to end by themselves after the last step

// --- over LCM ---

// A mutable global, since a signal handler can reach nothing else: SIGHUP asks to read the scene
// again.
static volatile sig_atomic_t hung_up = 0;

static void hang_up(int signal_number) {
    (void)signal_number;
    hung_up = 1;
}

typedef struct service {
    pm_setup setup;
    pm_run_options options; // of the present run
    const char *folder;     // of recordings; NULL: none
    char path[1024];        // of the recording
    pm_observer observer;   // of the present run
    pm_lockstep_coordinator *coordinator;
    const pm_journal *log;
    bool runs;   // a run is under way
    bool reload; // this process is to begin anew
} service;

// The nodes that are still to be launched. The coordinator answers those that are there meanwhile.
typedef struct launcher {
    pm_launch *launch;
    pm_setup *setup;
    pm_run_options options; // of the nodes
    service *service;       // whose runs they are; NULL: they serve one run
    int next;               // process to be launched
    double at;              // s, when the last one was
} launcher;

// The life of a node.
static pm_status serve_node(void *context, const char *name) {
    const launcher *l = context;
    if (l->service != NULL) {
        // It may start in the middle of a run. The recording, and the lock on it, are the parent's.
        (void)close_range(STDERR_FILENO + 1, ~0U, 0);
    }
    return pm_serve_node(l->setup, &l->options, pm_scene_find_process(l->setup->scene, name));
}

// Checks the files, so that a mistake in them does not end the service.
static pm_status check_reload(void *context) {
    service *s = context;
    pm_setup fresh = {0};
    pm_status status = pm_prepare(&fresh, &s->options, PM_TO_COORDINATE);
    if (status == PM_OK && strcmp(fresh.scene->name, s->setup.scene->name) != 0) {
        status = pm_fail(PM_ECONFIG, "%s: is now scene %s, and %s is served", fresh.scene->path,
                         fresh.scene->name, s->setup.scene->name);
    }
    pm_setup_free(&fresh);
    s->reload = status == PM_OK;
    return status;
}

// Runs the coordinator's loop, and watches the children and the stop flag: until the run is over,
// or with a control until the user ends the service or a child fails for good.
static pm_status conduct(pm_lockstep_coordinator *coordinator, launcher *nodes,
                         pm_control *control) {
    const pm_scene *scene = nodes->setup->scene;
    pm_transport *transport = pm_lockstep_coordinator_transport(coordinator);
    pm_status first = PM_OK; // the first failure of a child, or the interrupt
    char reason[1024] = "";
    int deaths = 0;
    double now = pm_clock(), looked = 0, notified = 0;
    bool ready = false;
    while (!pm_lockstep_coordinator_finished(coordinator)) {
        if (first == PM_OK && now - looked > WATCH_INTERVAL) {
            looked = now;
            const int before = deaths;
            first = pm_launch_watch(nodes->launch, &deaths);
            service *s = nodes->service;
            if (s != NULL && hung_up && !s->runs) {
                hung_up = 0;
                if (check_reload(s) != PM_OK) {
                    pm_journal_write(s->log, PM_JOURNAL_ERROR, 0, NULL, "not read again: %s",
                                     pm_error());
                }
            }
            if (*nodes->options.stop || (s != NULL && s->reload && !s->runs)) {
                first = pm_fail(PM_EINTERRUPTED, "interrupted");
            }
            snprintf(reason, sizeof reason, "%s", first == PM_OK ? "" : pm_error());
            // A process that was killed starts again, for the next run.
            if (control != NULL && deaths > before && nodes->options.checkpoint == NULL) {
                pm_lockstep_coordinator_fail(
                    coordinator, PM_ENET, "a process was killed, and the run keeps no checkpoints");
            }
        }
        if (first != PM_OK) { // an interrupt alone ends a coordinator that stays
            pm_lockstep_coordinator_fail(coordinator, control == NULL ? first : PM_EINTERRUPTED,
                                         reason);
        }
        if (control != NULL && now - notified > WATCHDOG_INTERVAL) {
            notified = now;
            pm_notify("WATCHDOG=1");
        }
        // Processes that run elsewhere may come much later.
        if (!ready && (nodes->options.elsewhere ||
                       pm_lockstep_coordinator_present(coordinator) == scene->network.nprocess)) {
            ready = true;
            pm_notify("READY=1");
        }
        // Nodes share the cores, and each has to start within its patience. So another one starts
        // as long as few of those before have yet to say hello.
        while (first == PM_OK && !nodes->options.elsewhere &&
               nodes->next < scene->network.nprocess &&
               (nodes->next - pm_lockstep_coordinator_present(coordinator) < MOST_STARTING ||
                pm_clock() > nodes->at + LAUNCH_INTERVAL)) {
            const char *name = scene->network.process[nodes->next].name, *progress = NULL;
            if (control != NULL) { // a node that is killed starts again
                PM_TRY(pm_prepare_checkpoint(nodes->setup, &nodes->options, name, &progress));
                progress = progress == NULL ? scene->path : progress;
            }
            PM_TRY(pm_launch_start(nodes->launch, name,
                                   (pm_launch_program){serve_node, nodes, control != NULL},
                                   progress));
            nodes->next += 1;
            nodes->at = pm_clock();
        }
        const double next = pm_lockstep_coordinator_poll(coordinator, now);
        if (control != NULL && pm_control_poll(control) != PM_OK && first == PM_OK) {
            first = PM_ENET;
            snprintf(reason, sizeof reason, "%s", pm_error());
        }
        const double interval = next - now > 2 * WATCH_INTERVAL ? RESTING : WATCH_INTERVAL;
        const double wait = next - now < interval ? next - now : interval;
        PM_TRY(pm_transport_wait(transport, wait > 0 ? wait : 0, NULL));
        now = pm_clock();
    }
    return control == NULL || first == PM_OK ? pm_lockstep_coordinator_result(coordinator)
                                             : pm_fail(first, "%s", reason);
}

static pm_status run_processes(pm_setup *setup, pm_observer *observer) {
    const pm_run_options *options = observer->options;
    const char *url = pm_connect_url(setup->scene, options->url);
    pm_transport *transport = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_lockstep_coordinator_options own = pm_observer_attach(observer, setup);
    launcher nodes = {.setup = setup, .options = *options};
    pm_status status;
    own.session = nodes.options.session = pm_lockstep_session();
    nodes.options.log.json = false; // this process passes their lines on
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene, url, "coordinator", &options->log));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&coordinator, setup->system, transport, &own));
    PM_TRY_DONE(pm_launch_open(&nodes.launch, setup->scene->network.nprocess, &options->log));
    status = conduct(coordinator, &nodes, NULL);
    if (status == PM_OK) {
        status = pm_launch_wait(nodes.launch, END_GRACE);
    }
    status =
        pm_observer_finish(observer, status, pm_lockstep_coordinator_ledger(coordinator),
                           pm_lockstep_coordinator_pace(coordinator), "a process each, over LCM");
    pm_connect_warn(transport, pm_lockstep_coordinator_drops(coordinator), &options->log);
done:
    pm_launch_close(nodes.launch);
    pm_lockstep_coordinator_close(coordinator);
    pm_transport_close(transport);
    return status;
}

// --- in this thread ---

static bool is_interrupted(const pm_observer *observer) {
    return observer->options->stop != NULL && *observer->options->stop != 0;
}

static void pause_for(double seconds) {
    nanosleep(&(struct timespec){.tv_nsec = (long)(1e9 * seconds)}, NULL);
}

// Takes all steps, as the gate and the pace allow. PM_EINTERRUPTED, PM_EFILE.
static pm_status step_to_the_end(pm_local_run *run, pm_gate *gate, pm_pace *pace,
                                 const pm_lockstep_observer *tell) {
    const pm_observer *observer = tell->context;
    PM_TRY(tell->step(tell->context, &run->sample));
    pm_pace_begin(pace, pm_clock());
    while (run->sample.step < run->setup->scene->run.steps) {
        for (bool told = false; gate->steps <= run->sample.step && !is_interrupted(observer);) {
            if (!told) {
                tell->hold(tell->context, run->sample.step);
                told = true;
            }
            pause_for(GATE_INTERVAL);
            PM_TRY(pm_gate_refresh(gate, pm_clock()));
        }
        const double due = pm_pace_due(pace, run->sample.step);
        for (double now = pm_clock(); now < due && !is_interrupted(observer); now = pm_clock()) {
            pause_for(due - now < WATCH_INTERVAL ? due - now : WATCH_INTERVAL);
        }
        if (is_interrupted(observer)) {
            return pm_fail(PM_EINTERRUPTED, "interrupted");
        }
        PM_TRY(pm_local_run_step(run));
        pm_pace_note(pace, run->sample.step, pm_clock());
        PM_TRY(tell->step(tell->context, &run->sample));
    }
    return PM_OK;
}

static pm_status run_together(const pm_setup *setup, pm_observer *observer) {
    const pm_lockstep_coordinator_options as = pm_observer_attach(observer, setup);
    pm_local_run run = {0};
    pm_gate gate;
    pm_pace pace = pm_pace_of(setup->scene);
    pm_status status;
    if (setup->scene->network.nlive > 0 && setup->replay == NULL) {
        return pm_fail(PM_EUSAGE, "run: live inputs arrive over LCM: --in-process needs --replay");
    }
    PM_TRY_DONE(pm_gate_init(&gate, observer->options->gate));
    PM_TRY_DONE(pm_local_run_open(&run, setup,
                                  pm_scene_may_report_sums(setup->scene) && !as.want_state
                                      ? PM_LOCAL_SUMS
                                      : PM_LOCAL_SAMPLES));
    status = step_to_the_end(&run, &gate, &pace, &as.observer);
    status = pm_observer_finish(observer, status, &run.ledger, &pace, "in one process");
done:
    pm_local_run_close(&run);
    return status;
}

// --- copies ---

// Gives every copy the first state of a trajectory.
static pm_status start_copies(pm_fleet *fleet, pm_setup *setup, const pm_dataset *starts,
                              const char *path) {
    pm_columns columns;
    if (starts->ntrajectory < fleet->count) {
        return pm_fail(PM_EDATA, "%s: %d trajectories, and %" PRId64 " copies need one each", path,
                       starts->ntrajectory, fleet->count);
    }
    PM_TRY(pm_system_check_dataset(setup->system, starts, path));
    PM_TRY(pm_columns_bind(&columns, setup->scene, starts, &setup->arena));
    for (int i = 0; i < fleet->count; ++i) {
        pm_columns_to_state(&columns, pm_dataset_state(starts, i, 0),
                            fleet->z + (ptrdiff_t)i * columns.nz);
    }
    return PM_OK;
}

// Makes a dataset with the scene's columns, or without them with the names of the variables.
// columns->column is then NULL.
static pm_status open_trajectories(pm_dataset **to, pm_columns *columns, pm_setup *setup,
                                   const pm_scene_variables *names, int64_t count, int ntime) {
    const pm_physics *physics = &setup->scene->physics;
    const char **name = pm_arena_array(&setup->arena, (size_t)physics->nz, sizeof(const char *));
    PM_TRY(pm_arena_status(&setup->arena, "trajectories"));
    bool mapped = true;
    for (int i = 0; i < physics->nsubsystem; ++i) {
        mapped = mapped && physics->subsystem[i].column != NULL;
    }
    for (int i = 0; i < physics->nsubsystem; ++i) {
        for (int c = 0; c < physics->subsystem[i].layout.nz; ++c) {
            const int at = physics->subsystem[i].first + c;
            name[at] = mapped ? physics->subsystem[i].column[c] : names->state.name[at];
        }
    }
    PM_TRY(pm_dataset_new(to, (int)count, ntime, physics->nz,
                          physics->dt * setup->scene->run.record_every, name));
    *columns = (pm_columns){0};
    return mapped ? pm_columns_bind(columns, setup->scene, *to, &setup->arena) : PM_OK;
}

// Writes the present states as sample j. The trajectories of copies that have ended are over.
static void take_sample(const pm_fleet *fleet, const pm_columns *columns, pm_dataset *to, int j) {
    for (int i = 0; i < fleet->count; ++i) {
        double *row = pm_dataset_state(to, i, j);
        const double *z = fleet->z + (ptrdiff_t)i * to->ncolumn;
        for (int c = 0; c < to->ncolumn; ++c) {
            row[c] = fleet->ended[i] != 0 ? NAN : z[c];
        }
        if (columns->column != NULL && fleet->ended[i] == 0) {
            pm_columns_to_row(columns, z, row);
        }
    }
}

// Prints what the copies that have not ended are like.
static void print_copies(const pm_fleet *fleet, const pm_scene_variables *names, double seconds) {
    const pm_scene *scene = fleet->setup->scene;
    const int nz = scene->physics.nz;
    int64_t ended = 0;
    for (int i = 0; i < fleet->count; ++i) {
        ended += fleet->ended[i] != 0;
    }
    printf("%s: %d steps of %g s of %" PRId64 " copies, %" PRId64 " of which ended early\n",
           scene->name, scene->run.steps, scene->physics.dt, fleet->count, ended);
    printf("\n%-24s %15s %15s %15s %15s\n", "At the end", "mean", "deviation", "least", "largest");
    for (int k = 0; k < nz && k < PM_SCENE_LISTED && ended < fleet->count; ++k) {
        const double count = (double)(fleet->count - ended);
        double sum = 0, square = 0, least = INFINITY, largest = -INFINITY;
        for (int pass = 0; pass < 2; ++pass) {
            for (int i = 0; i < fleet->count; ++i) {
                const double x = fleet->z[(ptrdiff_t)i * nz + k];
                if (fleet->ended[i] == 0 && pass == 0) {
                    sum += x;
                    least = fmin(least, x);
                    largest = fmax(largest, x);
                } else if (fleet->ended[i] == 0) {
                    square += (x - sum / count) * (x - sum / count);
                }
            }
        }
        printf("  %-14s %-7s %+15.6e %15.6e %+15.6e %+15.6e\n", names->state.name[k],
               names->state.unit[k], sum / count, sqrt(square / count), least, largest);
    }
    printf("\nSpeed: %.3g s, %.3g us for a step of a copy\n", seconds,
           1e6 * seconds / (double)(scene->run.steps < 1 ? 1 : scene->run.steps) /
               (double)fleet->count);
}

static pm_status run_copies(pm_setup *setup, const pm_run_options *options) {
    const pm_scene *scene = setup->scene;
    const int every = scene->run.record_every;
    pm_fleet fleet = {0};
    pm_dataset *starts = NULL, *to = NULL;
    pm_scene_variables names;
    pm_columns columns;
    char why[sizeof fleet.why] = "";
    pm_status status;
    if (options->checkpoint != NULL || options->gate != NULL || options->replay != NULL ||
        scene->network.nlive > 0) {
        return pm_fail(PM_EUSAGE, "run: --copies and --starts go with --steps, --weights, --record "
                                  "and --overwrite, and with scenes without live inputs");
    }
    PM_TRY_DONE(pm_scene_variable_names(&names, scene, &setup->arena));
    if (options->starts != NULL) {
        PM_TRY_DONE(pm_dataset_load(&starts, options->starts));
        PM_TRY_DONE(pm_columns_convert(scene, starts));
    }
    const int64_t count = options->copies > 0 ? options->copies : starts->ntrajectory;
    PM_TRY_DONE(pm_fleet_open(&fleet, setup, count, 0));
    PM_TRY_DONE(starts == NULL ? PM_OK : start_copies(&fleet, setup, starts, options->starts));
    if (options->record != NULL) {
        PM_TRY_DONE(pm_recording_check(options->record, options->overwrite));
        PM_TRY_DONE(
            open_trajectories(&to, &columns, setup, &names, count, scene->run.steps / every + 1));
        take_sample(&fleet, &columns, to, 0);
    }
    const double begin = pm_clock();
    for (int step = 0, next; step < scene->run.steps; step = next) {
        next = step + every < scene->run.steps ? step + every : scene->run.steps;
        if (*options->stop) {
            status = pm_fail(PM_EINTERRUPTED, "interrupted");
            goto done;
        }
        pm_fleet_step(&fleet, next - step);
        memcpy(why, why[0] == '\0' ? fleet.why : why, sizeof why);
        if (to != NULL && next % every == 0) {
            take_sample(&fleet, &columns, to, next / every);
        }
    }
    if (!options->quiet) {
        print_copies(&fleet, &names, pm_clock() - begin);
        printf(why[0] == '\0' ? "%s" : "  the first copy that ended is %s\n", why);
    }
    status = to == NULL ? PM_OK : pm_dataset_save(to, options->record);
done:
    pm_dataset_free(starts);
    pm_dataset_free(to);
    pm_fleet_close(&fleet);
    return status;
}

// --- as one rank of a job of mpirun ---

// Rank 0 coordinates, and rank i + 1 serves process i of the scene. Rank 0 alone describes the
// result.
static pm_status run_rank(pm_setup *setup, const pm_run_options *options, const char *url) {
    const pm_scene *scene = setup->scene;
    const int expected = scene->network.nprocess + 1;
    pm_status status = PM_OK;
    int rank, count;
    PM_TRY(pm_transport_place(url, &rank, &count));
    if (count != expected) {
        status = pm_fail(PM_EUSAGE,
                         "scene %s has %d processes: expected %d ranks (mpirun -n %d), one for "
                         "each process and one that coordinates them, found %d",
                         scene->name, scene->network.nprocess, expected, expected, count);
    } else if (options->checkpoint != NULL) {
        status = pm_fail(PM_EUSAGE, "run: --checkpoint is for processes that may die one by one, "
                                    "and mpirun ends all ranks when one dies");
    } else if (scene->network.nlive > 0 && setup->replay == NULL) {
        status = pm_fail(PM_EUSAGE, "run: live inputs arrive over LCM: %s needs --replay", url);
    }
    if (status != PM_OK) {
        // Every rank opens and closes the transport, so that the job ends in order.
        pm_transport *transport;
        char reason[512];
        snprintf(reason, sizeof reason, "%s", rank == 0 ? pm_error() : "");
        PM_TRY(pm_transport_open(&transport, url));
        pm_transport_close(transport);
        return pm_fail(status, "%s", reason);
    }
    if (rank == 0) {
        return pm_serve_coordinator(setup, options);
    }
    pm_run_options own = *options;
    own.log.part = scene->network.process[rank - 1].name;
    own.coordinator_speaks = true;
    return pm_serve_node(setup, &own, rank - 1);
}

static pm_status execute_run(const pm_run_options *options) {
    pm_setup setup = {0};
    pm_observer observer = {0};
    pm_status status;
    if (options->in_process && options->checkpoint != NULL) {
        return pm_fail(PM_EUSAGE, "run: --checkpoint is for processes that may die one by one, "
                                  "not for --in-process");
    }
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_COORDINATE));
    if (options->copies > 0 || options->starts != NULL) {
        status = run_copies(&setup, options);
        goto done;
    }
    const char *url = pm_connect_url(setup.scene, options->url);
    if (!options->in_process && pm_transport_has_ranks(url)) {
        status = run_rank(&setup, options, url);
    } else if (options->checkpoint != NULL) {
        status = pm_supervise(&setup, options);
    } else {
        PM_TRY_DONE(pm_observer_open(&observer, &setup, options));
        status = options->in_process ? run_together(&setup, &observer)
                                     : run_processes(&setup, &observer);
    }
done:
    pm_observer_close(&observer);
    pm_setup_free(&setup);
    return status;
}

const pm_command pm_command_run = {
    .name = "run",
    .summary = "run a scene: its processes, and a coordinator",
    .arguments = "SCENE",
    .help =
        "Launches `portmetd node` once per process, by default one for each subsystem,\n"
        "coordinates them over LCM, and prints mean fluxes, errors against the scene's\n"
        "reference trajectory, the ledger of energy and entropy, and the speed. It starts\n"
        "from each subsystem's `initial`, else from the reference's first state. Ctrl-C ends all\n"
        "processes and prints the tables of the steps done so far. With --checkpoint a process\n"
        "that is killed starts again and goes on, and the result has the same bits. If the whole\n"
        "run is interrupted, the same command continues it. With --url mpi:// the processes are\n"
        "the ranks of `mpirun -n N portmetd run ...`, one more than the scene has processes.\n"
        "With --copies or --starts it runs many copies of the scene in this process, on all\n"
        "processors, and prints what they are like in the end; --record then writes their\n"
        "trajectories as a dataset.",
    .examples = "portmetd run configs/double_pendulum.yaml --record run.h5\n"
                "portmetd run configs/chain_10.yaml --in-process --steps 100\n"
                "portmetd run configs/double_pendulum.yaml --copies 1000 --record copies.h5",
    .accepts = PM_OPTION_CHECKPOINT | PM_OPTION_STEPS | PM_OPTION_RECORD | PM_OPTION_REPLAY |
               PM_OPTION_OVERWRITE | PM_OPTION_WEIGHTS | PM_OPTION_URL | PM_OPTION_IN_PROCESS |
               PM_OPTION_GATE | PM_OPTION_LOG | PM_OPTION_QUIET | PM_OPTION_COMPILED,
    .execute = execute_run,
};

// --- one run after another ---

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
    char text[1200], steps[32] = "until it is stopped";
    s->options.record = NULL;
    if (run->record[0] != 0) {
        PM_TRY(place(s, run->record, "", s->path, sizeof s->path));
        s->options.record = s->path;
    }
    const pm_status status = pm_observer_open(&s->observer, &s->setup, &s->options);
    if (status != PM_OK) {
        pm_observer_close(&s->observer);
        return status;
    }
    *observer = pm_observer_attach(&s->observer, &s->setup).observer;
    s->runs = true;
    if (run->steps > 0) {
        snprintf(steps, sizeof steps, "%" PRId64 " steps", run->steps);
    }
    snprintf(text, sizeof text, "begins at %s, %s%s%s%s",
             run->from_client ? "the state of the client" : "the scene's state", steps,
             run->held ? ", held at its start" : "",
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
    const pm_scene *scene = s->setup.scene;
    const pm_physics *physics = &scene->physics;
    const bool states = !pm_scene_may_report_sums(scene); // else there are too many to list
    char unit[128];
    size_t size;
    pm_scene_variables variables;
    PM_TRY(pm_scene_variable_names(&variables, scene, &s->setup.arena));
    FILE *file = open_memstream(text, &size);
    if (file == NULL) {
        return pm_fail(PM_ENOMEM, "the description of scene %s", scene->name);
    }
    fprintf(file,
            "{\"scene\":\"%s\",\"dt\":%.17g,\"steps\":%d,\"integrator\":\"%s\",\"substeps\":%d,"
            "\"digest\":\"%016" PRIx64
            "\",\"records\":%s,\"view\":%s,\"states\":%s,\"subsystems\":[",
            scene->name, physics->dt, scene->run.steps, physics->integrator->name,
            physics->substeps, s->setup.system->digest, s->folder == NULL ? "false" : "true",
            s->options.control == NULL ? "false" : "true", states ? "true" : "false");
    for (int i = 0; i < physics->nsubsystem && states; ++i) {
        const pm_scene_subsystem *subsystem = &physics->subsystem[i];
        const pm_training_range range = pm_training_range_of(s->setup.system->part[i]);
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
        put_digest(file, &s->setup.system->component[i]);
    }
    fputs("],\"ports\":[", file);
    for (int i = 0; i < physics->nport && states; ++i) {
        const pm_scene_port *port = &physics->port[i];
        fprintf(file, "%s{\"name\":\"%s\",\"law\":\"%s\",\"ends\":[\"%s\",\"%s\"]",
                i == 0 ? "" : ",", port->name, port->law, port->between[0], port->between[1]);
        put_digest(file, &s->setup.system->component[physics->nsubsystem + i]);
    }
    fputs("],\"inputs\":[", file);
    for (int j = 0, n = 0; j < scene->network.nlive_input; ++j) {
        const pm_scene_live_input *input = &scene->network.live_input[j];
        for (int k = 0; k < input->count; ++k) {
            const char *of = "?"; // of the first quantity that it gives
            for (int i = physics->nprescribed - 1; i >= 0; --i) {
                of = s->setup.boundary_input.live_id[i] == n ? variables.input.unit[i] : of;
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

static pm_status execute_serve(const pm_run_options *options) {
    service s = {.options = *options, .folder = options->record, .log = &options->log};
    launcher nodes = {.setup = &s.setup, .options = *options, .service = &s};
    pm_transport *transport = NULL;
    pm_control *control = NULL;
    char *description = NULL, host[64] = "", name[64];
    pm_lockstep_coordinator_options own = {.stays = true};
    pm_status status;
    s.options.quiet = true;
    if (options->control != NULL && strcmp(options->control, "view") != 0) {
        return pm_fail(PM_EUSAGE, "--control: expected view, found \"%s\"", options->control);
    }
    PM_TRY_DONE(pm_prepare(&s.setup, options, PM_TO_COORDINATE));
    const pm_scene *scene = s.setup.scene;
    const char *url = pm_connect_url(scene, options->url);
    if (pm_transport_has_ranks(url)) {
        status = pm_fail(PM_EUSAGE, "serve does not work at %s: it needs udpm://", url);
        goto done;
    }
    if (s.folder != NULL) {
        PM_TRY_DONE(pm_options_folder(s.folder));
    }
    PM_TRY_DONE(pm_prepare_checkpoint(&s.setup, options, NULL, &own.checkpoint));
    own.want_state = !pm_scene_may_report_sums(scene);
    own.session =
        options->session > 0 || options->elsewhere ? options->session : pm_lockstep_session();
    nodes.options.session = own.session;
    nodes.options.stays = true;
    nodes.options.log.json = false; // this process passes their lines on
    (void)gethostname(host, sizeof host - 1);
    snprintf(name, sizeof name, "process %ld on %.31s", (long)getpid(), host);
    PM_TRY_DONE(describe(&s, &description));
    PM_TRY_DONE(pm_connect_open(&transport, scene, url, "coordinator", &options->log));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&s.coordinator, s.setup.system, transport, &own));
    const pm_control_service serves = {.context = &s,
                                       .description = description,
                                       .views = options->control != NULL,
                                       .path = s.folder == NULL ? NULL : place,
                                       .begin = begin_run,
                                       .end = end_run,
                                       .reload = check_reload,
                                       .session = options->session,
                                       .name = name};
    PM_TRY_DONE(pm_control_open(&control, s.coordinator, &serves));
    PM_TRY_DONE(pm_launch_open(&nodes.launch, scene->network.nprocess, &options->log));
    const struct sigaction action = {.sa_handler = hang_up, .sa_flags = SA_RESTART};
    sigaction(SIGHUP, &action, NULL);
    status = conduct(s.coordinator, &nodes, control);
    pm_connect_warn(transport, pm_lockstep_coordinator_drops(s.coordinator), &options->log);
    // The user ends a service in this way.
    status = status == PM_EINTERRUPTED ? PM_OK : status;
done:
    pm_launch_close(nodes.launch);
    pm_control_close(control);
    pm_lockstep_coordinator_close(s.coordinator);
    pm_transport_close(transport);
    pm_observer_close(&s.observer);
    free(description);
    pm_setup_free(&s.setup);
    if (status != PM_OK || !s.reload || *options->stop != 0) {
        return status;
    }
    // This process begins anew, with the same command line, number and place.
    enum { MOST_WORDS = 64, MOST_BYTES = 65536 };
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
        "run fails and the next one can be started.",
    .examples = "portmetd serve configs/double_pendulum.yaml --record recordings",
    .accepts = PM_OPTION_CHECKPOINT | PM_OPTION_FOLDER | PM_OPTION_WEIGHTS | PM_OPTION_URL |
               PM_OPTION_SESSION | PM_OPTION_LOG | PM_OPTION_ELSEWHERE | PM_OPTION_COMPILED,
    .execute = execute_serve,
};
