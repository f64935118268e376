// portmetd run: runs a whole scene with one command. Over LCM it starts the scene's processes and
// is itself the coordinator; with --in-process all subsystems live in this thread.
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/launch.h"
#include "app/observer.h"
#include "app/prepare.h"
#include "app/serve.h"
#include "app/supervise.h"
#include "library/local_run.h"
#include "lockstep/coordinator.h"
#include "lockstep/gate.h"
#include "lockstep/node.h"

#define MOST_STARTING 16     // nodes that start at the same time
#define LAUNCH_INTERVAL 0.25 // s after which one more starts, whatever the others do
#define WATCH_INTERVAL 0.05  // s between two looks at the children
#define GATE_INTERVAL 0.002  // s between two looks at the gate that holds a run in this thread
#define END_GRACE 5.0        // s for the nodes to end by themselves after the last step

// --- over LCM ---

// The nodes that are still to be launched. The coordinator answers those that are there meanwhile.
typedef struct launcher {
    pm_launch *launch;
    pm_setup *setup;
    pm_run_options options; // of the nodes
    int next;               // process to be launched
    double at;              // s, when the last one was
} launcher;

// The life of a node.
static pm_status serve_node(void *context, const char *name) {
    const launcher *l = context;
    return pm_serve_node(l->setup, &l->options, pm_scene_find_process(l->setup->scene, name));
}

// Runs the coordinator's loop, and watches the children and the stop flag until the first failure.
static pm_status conduct(pm_lockstep_coordinator *coordinator, launcher *nodes) {
    const pm_scene *scene = nodes->setup->scene;
    pm_transport *transport = pm_lockstep_coordinator_transport(coordinator);
    bool failed = false;
    double now = pm_clock(), looked = 0;
    while (!pm_lockstep_coordinator_finished(coordinator)) {
        if (!failed && now - looked > WATCH_INTERVAL) {
            looked = now;
            pm_status status = pm_launch_watch(nodes->launch);
            if (*nodes->options.stop) {
                status = pm_fail(PM_EINTERRUPTED, "interrupted");
            }
            if (status != PM_OK) {
                pm_lockstep_coordinator_fail(coordinator, status, pm_error());
                failed = true;
            }
        }
        // Nodes share the cores, and each has to start within its patience. So another one starts
        // as long as few of those before have yet to say hello.
        while (!failed && nodes->next < scene->network.nprocess &&
               (nodes->next - pm_lockstep_coordinator_present(coordinator) < MOST_STARTING ||
                pm_clock() > nodes->at + LAUNCH_INTERVAL)) {
            PM_TRY(pm_launch_start(nodes->launch, scene->network.process[nodes->next].name,
                                   (pm_launch_program){serve_node, nodes}, NULL));
            nodes->next += 1;
            nodes->at = pm_clock();
        }
        const double next = pm_lockstep_coordinator_poll(coordinator, now);
        const double wait = next - now < WATCH_INTERVAL ? next - now : WATCH_INTERVAL;
        PM_TRY(pm_transport_wait(transport, wait > 0 ? wait : 0, NULL));
        now = pm_clock();
    }
    return pm_lockstep_coordinator_result(coordinator);
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
    status = conduct(coordinator, &nodes);
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
    PM_TRY_DONE(
        pm_local_run_open(&run, setup, pm_scene_may_report_sums(setup->scene) && !as.want_state));
    status = step_to_the_end(&run, &gate, &pace, &as.observer);
    status = pm_observer_finish(observer, status, &run.ledger, &pace, "in one process");
done:
    pm_local_run_close(&run);
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

static pm_status execute(const pm_run_options *options) {
    pm_setup setup = {0};
    pm_observer observer = {0};
    pm_status status;
    if (options->in_process && options->checkpoint != NULL) {
        return pm_fail(PM_EUSAGE, "run: --checkpoint is for processes that may die one by one, "
                                  "not for --in-process");
    }
    PM_TRY_DONE(pm_prepare(&setup, options, PM_TO_COORDINATE));
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
        "the ranks of `mpirun -n N portmetd run ...`, one more than the scene has processes.",
    .accepts = PM_OPTION_CHECKPOINT | PM_OPTION_STEPS | PM_OPTION_RECORD | PM_OPTION_REPLAY |
               PM_OPTION_OVERWRITE | PM_OPTION_WEIGHTS | PM_OPTION_URL | PM_OPTION_IN_PROCESS |
               PM_OPTION_GATE | PM_OPTION_LOG | PM_OPTION_QUIET,
    .execute = execute,
};
