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
#include "app/ranks.h"
#include "app/serve.h"
#include "app/supervise.h"
#include "library/local_run.h"
#include "lockstep/gate.h"
#include "lockstep/lockstep.h"

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

// Launches nodes as long as few of those before have yet to say hello: they share the cores, and
// each has to start within its patience.
static pm_status launch_some(launcher *l, int present) {
    const pm_scene *scene = l->setup->scene;
    while (l->next < scene->nprocess &&
           (l->next - present < MOST_STARTING || pm_clock() > l->at + LAUNCH_INTERVAL)) {
        PM_TRY(pm_launch_start(l->launch, scene->process[l->next].name,
                               (pm_launch_program){serve_node, l}, NULL));
        l->next += 1;
        l->at = pm_clock();
    }
    return PM_OK;
}

// Runs the coordinator's loop, and watches the children and the stop flag until the first failure.
static pm_status conduct(pm_lockstep_coordinator *coordinator, launcher *nodes,
                         const volatile sig_atomic_t *stop) {
    pm_launch *launch = nodes->launch;
    pm_transport *transport = pm_lockstep_coordinator_transport(coordinator);
    bool failed = false;
    double now = pm_clock(), looked = 0;
    while (!pm_lockstep_coordinator_finished(coordinator)) {
        if (!failed && now - looked > WATCH_INTERVAL) {
            looked = now;
            pm_status status = pm_launch_watch(launch);
            if (*stop) {
                status = pm_fail(PM_EINTERRUPTED, "interrupted");
            }
            if (status != PM_OK) {
                pm_lockstep_coordinator_fail(coordinator, status, pm_error());
                failed = true;
            }
        }
        if (!failed && nodes->next < nodes->setup->scene->nprocess) {
            PM_TRY(launch_some(nodes, pm_lockstep_coordinator_present(coordinator)));
        }
        const double next = pm_lockstep_coordinator_poll(coordinator, now);
        const double wait = next - now < WATCH_INTERVAL ? next - now : WATCH_INTERVAL;
        PM_TRY(pm_transport_wait(transport, wait > 0 ? wait : 0, NULL));
        now = pm_clock();
    }
    return pm_lockstep_coordinator_result(coordinator);
}

static pm_status run_processes(pm_setup *setup, const pm_run_options *options,
                               pm_observer *observer) {
    pm_transport *transport = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_launch *launch = NULL;
    pm_lockstep_coordinator_options coordinator_options = pm_observer_attach(observer, setup);
    coordinator_options.session = pm_lockstep_session();
    pm_status status;
    PM_TRY_DONE(pm_connect_open(&transport, setup->scene, "coordinator", &options->log));
    PM_TRY_DONE(
        pm_lockstep_coordinator_open(&coordinator, setup->system, transport, &coordinator_options));
    PM_TRY_DONE(pm_launch_open(&launch, setup->scene->nprocess, &options->log));
    launcher nodes = {.launch = launch, .setup = setup, .options = *options};
    nodes.options.session = coordinator_options.session;
    nodes.options.log.json = false; // this process passes their lines on
    status = conduct(coordinator, &nodes, options->stop);
    if (status == PM_OK) {
        status = pm_launch_wait(launch, END_GRACE);
    }
    status =
        pm_observer_finish(observer, status, pm_lockstep_coordinator_ledger(coordinator),
                           pm_lockstep_coordinator_pace(coordinator), "a process each, over LCM");
    pm_connect_warn(transport, pm_lockstep_coordinator_drops(coordinator), &options->log);
done:
    pm_launch_close(launch);
    pm_lockstep_coordinator_close(coordinator);
    pm_transport_close(transport);
    return status;
}

// --- in this thread ---

static bool is_interrupted(const pm_observer *observer) {
    return observer->options->stop != NULL && *observer->options->stop != 0;
}

// Waits until the gate lets the run go beyond `step`. PM_EINTERRUPTED, PM_EFILE.
static pm_status pass_gate(pm_gate *gate, const pm_lockstep_observer *tell, long step) {
    const pm_observer *observer = tell->context;
    const struct timespec pause = {0, (long)(1e9 * GATE_INTERVAL)};
    for (bool told = false; gate->steps <= step && !is_interrupted(observer);) {
        if (!told) {
            tell->hold(tell->context, step);
            told = true;
        }
        nanosleep(&pause, NULL);
        PM_TRY(pm_gate_refresh(gate, pm_clock()));
    }
    return is_interrupted(observer) ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK;
}

// Waits until the step with this number is due. PM_EINTERRUPTED.
static pm_status keep_pace(const pm_pace *pace, const pm_observer *observer, long step) {
    const double due = pm_pace_due(pace, step);
    for (double now = pm_clock(); now < due && !is_interrupted(observer); now = pm_clock()) {
        const double wait = due - now < WATCH_INTERVAL ? due - now : WATCH_INTERVAL;
        const struct timespec pause = {0, (long)(1e9 * wait)};
        nanosleep(&pause, NULL);
    }
    return is_interrupted(observer) ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK;
}

static pm_status step_to_the_end(pm_local_run *run, pm_gate *gate, pm_pace *pace,
                                 const pm_lockstep_observer *tell) {
    PM_TRY(tell->step(tell->context, &run->sample));
    pm_pace_begin(pace, pm_clock());
    while (run->sample.step < run->setup->scene->steps) {
        PM_TRY(pass_gate(gate, tell, run->sample.step));
        PM_TRY(keep_pace(pace, tell->context, run->sample.step));
        PM_TRY(pm_local_run_step(run));
        pm_pace_note(pace, run->sample.step, pm_clock());
        PM_TRY(tell->step(tell->context, &run->sample));
    }
    return PM_OK;
}

static pm_status run_together(const pm_setup *setup, pm_observer *observer) {
    const pm_lockstep_coordinator_options as = pm_observer_attach(observer, setup);
    const pm_lockstep_observer tell = as.observer;
    pm_local_run run = {0};
    pm_gate gate;
    pm_pace pace = pm_pace_of(setup->scene);
    pm_status status;
    if (setup->scene->nlive > 0 && setup->replay == NULL) {
        return pm_fail(PM_EUSAGE, "run: live inputs arrive over LCM: --in-process needs --replay");
    }
    PM_TRY_DONE(pm_gate_init(&gate, observer->options->gate));
    PM_TRY_DONE(
        pm_local_run_open(&run, setup, pm_scene_may_report_sums(setup->scene) && !as.want_state));
    status = step_to_the_end(&run, &gate, &pace, &tell);
    status = pm_observer_finish(observer, status, &run.ledger, &pace, "in one process");
done:
    pm_local_run_close(&run);
    return status;
}

static pm_status run_here(pm_setup *setup, const pm_run_options *options) {
    pm_observer observer = {0};
    pm_status status;
    PM_TRY_DONE(pm_observer_open(&observer, setup, options));
    status = options->in_process ? run_together(setup, &observer)
                                 : run_processes(setup, options, &observer);
done:
    pm_observer_close(&observer);
    return status;
}

static pm_status execute(const pm_run_options *options) {
    pm_setup setup;
    if (options->in_process && options->checkpoint != NULL) {
        return pm_fail(PM_EUSAGE, "run: --checkpoint is for processes that may die one by one, "
                                  "not for --in-process");
    }
    pm_status status = pm_prepare(&setup, options, PM_TO_COORDINATE);
    if (status != PM_OK) {
    } else if (!options->in_process && pm_transport_has_ranks(setup.scene->url)) {
        status = pm_ranks_run(&setup, options);
    } else {
        status =
            options->checkpoint == NULL ? run_here(&setup, options) : pm_supervise(&setup, options);
    }
    pm_setup_free(&setup);
    return status;
}

static const pm_command command = {
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

pm_status pm_command_run(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
