// Runs the lock-step and records the time at which the coordinator's observer receives each step.
#include "coupled.h"

#include <signal.h>
#include <stdio.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"
#include "lockstep/coordinator.h"
#include "lockstep/lookahead.h"
#include "lockstep/node.h"
#include "tests/support/memory_hub.h"
#include "tests/support/together.h"

#define PROCESSES_MAX 64
#define WARM 16 // steps

typedef struct watch {
    int steps;
    double time[COUPLED_STEPS_MAX + 1]; // s, when each was complete, after WARM
    pid_t pid[PROCESSES_MAX];
    int npid;
    double cpu[2], bytes[2]; // at the beginning and at the end
} watch;

// Polls a coordinator until the run is over, and returns its result.
static pm_status run_coordinator(pm_lockstep_coordinator *c) {
    while (!pm_lockstep_coordinator_finished(c)) {
        const double now = pm_clock(), next = pm_lockstep_coordinator_poll(c, now);
        const double wait = next - now < 0.1 ? next - now : 0.1;
        PM_TRY(pm_transport_wait(pm_lockstep_coordinator_transport(c), wait > 0 ? wait : 0, NULL));
    }
    return pm_lockstep_coordinator_result(c);
}

// s, of this process and those it watches.
static double cpu_of_all(const watch *w) {
    double sum = cost_cpu_of_self();
    for (int i = 0; i < w->npid; ++i) {
        clockid_t id;
        struct timespec used;
        if (clock_getcpuclockid(w->pid[i], &id) == 0 && clock_gettime(id, &used) == 0) {
            sum += (double)used.tv_sec + 1e-9 * (double)used.tv_nsec;
        }
    }
    return sum;
}

static pm_status observe(void *context, const pm_sample *sample) {
    watch *w = context;
    const long step = sample->step - WARM;
    if (step == 0 || step == w->steps) {
        w->cpu[step > 0] = cpu_of_all(w);
        w->bytes[step > 0] = cost_bytes_sent();
    }
    if (step >= 0) {
        w->time[step] = pm_clock();
    }
    return PM_OK;
}

static pm_lockstep_coordinator_options options_of(watch *w) {
    return (pm_lockstep_coordinator_options){.steps = WARM + w->steps,
                                             .observer = {.context = w, .step = observe}};
}

static pm_status run_in_process(const pm_system *system, const double *z, watch *w) {
    const pm_lockstep_node_options node_options = {.z = z};
    const pm_lockstep_coordinator_options options = options_of(w);
    pm_hub *hub = NULL;
    pm_transport *transport[2] = {NULL, NULL};
    pm_lockstep_node *node = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_status status;
    PM_TRY_DONE(pm_hub_open(&hub, NULL));
    PM_TRY_DONE(pm_hub_connect(hub, &transport[0]));
    PM_TRY_DONE(pm_hub_connect(hub, &transport[1]));
    PM_TRY_DONE(pm_lockstep_node_open(&node, system, 0, transport[0], &node_options));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&coordinator, system, transport[1], &options));
    status = run_together(coordinator, 1, &node, NULL);
done:
    pm_lockstep_coordinator_close(coordinator);
    pm_lockstep_node_close(node);
    pm_transport_close(transport[1]);
    pm_transport_close(transport[0]);
    pm_hub_close(hub);
    return status;
}

// In a process of its own.
static int serve(const pm_system *system, int process_id, const double *z, const char *url,
                 int64_t session) {
    const pm_lockstep_node_options options = {.z = z, .session = session};
    pm_transport *transport = NULL;
    pm_lockstep_node *node = NULL;
    pm_status status;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    PM_TRY_DONE(pm_transport_open(&transport, url));
    PM_TRY_DONE(pm_lockstep_node_open(&node, system, process_id, transport, &options));
    status = pm_lockstep_run_node(node, NULL);
done:
    if (status != PM_OK) {
        fprintf(stderr, "%s: %s\n", system->scene->network.process[process_id].name, pm_error());
    }
    return (int)status;
}

static pm_status run_processes(const pm_system *system, const char *url, const double *z,
                               watch *w) {
    pm_lockstep_coordinator_options options = options_of(w);
    options.session = pm_lockstep_session();
    pm_transport *transport = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_status status = PM_OK;
    fflush(stdout);
    for (; w->npid < system->scene->network.nprocess; ++w->npid) {
        w->pid[w->npid] = fork();
        if (w->pid[w->npid] == 0) {
            _exit(serve(system, w->npid, z, url, options.session));
        }
        if (w->pid[w->npid] < 0) {
            status = pm_fail(PM_ENOMEM, "cannot fork");
            goto done;
        }
    }
    PM_TRY_DONE(pm_transport_open(&transport, url));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&coordinator, system, transport, &options));
    status = run_coordinator(coordinator);
done:
    for (int i = 0; i < w->npid; ++i) {
        if (status != PM_OK) {
            kill(w->pid[i], SIGKILL);
        }
        waitpid(w->pid[i], NULL, 0);
    }
    pm_lockstep_coordinator_close(coordinator);
    pm_transport_close(transport);
    return status;
}

pm_status coupled_run(const pm_system *system, const char *url, const double *z, int steps,
                      cost *result) {
    static watch w; // too large for the stack
    w = (watch){.steps = steps};
    if (steps > COUPLED_STEPS_MAX || system->scene->network.nprocess > PROCESSES_MAX) {
        return pm_fail(PM_EUSAGE, "%d steps in %d processes: at most %d and %d", steps,
                       system->scene->network.nprocess, COUPLED_STEPS_MAX, PROCESSES_MAX);
    }
    PM_TRY(url == NULL ? run_in_process(system, z, &w) : run_processes(system, url, z, &w));
    // Steps are observed in as many at once as are reported together.
    *result = cost_of(steps, pm_lookahead(system->scene), w.time, w.cpu[1] - w.cpu[0],
                      w.bytes[1] - w.bytes[0]);
    return PM_OK;
}
