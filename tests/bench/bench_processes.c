// Measures learned links (many_links.h) in one process, and in several with a coordinator: the time
// of a step by the clock, the processor time of each process, and the time for which each waits.
//   run_bench_processes CONFIGS SHAPE LINKS STEPS PROCESSES [URL [SESSION PROCESS]]
// PROCESSES 0 is a run in one process that books every step in its ledger. Without URL the
// processes meet over LCM on this host. With mpi:// mpirun starts them, one more than PROCESSES.
// With SESSION, a number that all processes of a run share, only one of them is run: PROCESS, from
// 0, or the coordinator, -1. So they can be on several hosts.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/linalg.h"
#include "base/progress.h"
#include "lockstep/coordinator.h"
#include "lockstep/node.h"
#include "many_links.h"
#include "run_coordinator.h"
#include "sim/monolithic.h"

#define WARM 4 // steps before the measurement
#define LCM_URL "udpm://239.255.76.67:7667?ttl=0"

typedef struct bench {
    int links, processes;
    long steps;
    const char *url;
    pm_scene *scene;
    pm_system *system;
    double *z;      // [scene->nz]
    double clock;   // s, when the measurement began
    double cpu;     // s of processor time of this process, then
    double seconds; // s, from then to the last step
} bench;

// Returns the processor time of this process in s.
static double processor_time(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

// Returns the largest resident memory of this process so far, in bytes.
static double peak_memory(void) {
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    return 1024.0 * (double)usage.ru_maxrss;
}

// Prints what a process has used in a measurement of so many seconds and steps.
static void print(const bench *b, const char *name, double seconds, double cpu, long steps) {
    printf("  %-12s %10.1f us/step, %10.1f of CPU, %10.1f of waiting; %6.0f bytes per link\n", name,
           1e6 * seconds / (double)steps, 1e6 * cpu / (double)steps,
           1e6 * (seconds - cpu) / (double)steps, peak_memory() / b->links);
    fflush(stdout);
}

static pm_status open_links(bench *b, const char *configs, const char *shape) {
    const many_links what = {.configs = configs,
                             .shape = shape,
                             .integrator = "euler",
                             .links = b->links,
                             .processes = b->processes > 0 ? b->processes : 1,
                             .steps = b->steps + WARM};
    PM_TRY(many_links_scene(&b->scene, &what));
    PM_TRY(pm_system_load(&b->system, b->scene, NULL));
    b->links = b->scene->physics.nsubsystem;
    b->z = many_links_states(b->scene);
    return b->z != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for %d links", b->links);
}

// --- the runs ---

static pm_status observe(void *context, const pm_sample *sample) {
    bench *b = context;
    if (sample->step <= WARM) {
        b->clock = pm_clock();
        b->cpu = processor_time();
    }
    b->seconds = pm_clock() - b->clock;
    return PM_OK;
}

static pm_status run_here(bench *b) {
    pm_monolithic *m = NULL;
    pm_ledger ledger;
    pm_status status;
    pm_ledger_init(&ledger, b->system);
    PM_TRY_DONE(pm_monolithic_open(&m, b->system));
    pm_monolithic_set_state(m, b->z);
    for (long i = 0; i < b->steps + WARM; ++i) {
        PM_TRY_DONE(pm_monolithic_step(m));
        pm_tally tally;
        pm_sample sample = *pm_monolithic_sums(m, &tally);
        PM_TRY_DONE(pm_ledger_add_sums(&ledger, &sample, &tally));
        PM_TRY_DONE(observe(b, &sample));
    }
    print(b, "alone", b->seconds, processor_time() - b->cpu, b->steps);
done:
    pm_monolithic_close(m);
    return status;
}

static pm_status serve(bench *b, int process_id, int64_t session) {
    const pm_lockstep_node_options options = {.z = b->z, .session = session};
    pm_transport *transport = NULL;
    pm_lockstep_node *node = NULL;
    pm_status status;
    PM_TRY_DONE(pm_transport_open(&transport, b->url));
    PM_TRY_DONE(pm_lockstep_node_open(&node, b->system, process_id, transport, &options));
    const double clock = pm_clock(), cpu = processor_time();
    status = pm_lockstep_run_node(node, NULL);
    print(b, b->scene->network.process[process_id].name, pm_clock() - clock, processor_time() - cpu,
          b->steps + WARM);
done:
    pm_lockstep_node_close(node);
    pm_transport_close(transport);
    return status;
}

static pm_status conduct(bench *b, int64_t session) {
    const pm_lockstep_coordinator_options options = {.session = session,
                                                     .observer = {.context = b, .step = observe}};
    pm_transport *transport = NULL;
    pm_lockstep_coordinator *coordinator = NULL;
    pm_status status;
    PM_TRY_DONE(pm_transport_open(&transport, b->url));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&coordinator, b->system, transport, &options));
    status = run_coordinator(coordinator);
    print(b, "coordinator", b->seconds, processor_time() - b->cpu, b->steps);
    const pm_ledger *ledger = pm_lockstep_coordinator_ledger(coordinator);
    printf("  worst residuals: energy %.2e, entropy %.2e; %ld steps in violation; E %.17g J\n",
           ledger->worst_energy, ledger->worst_entropy, ledger->violations, ledger->energy);
done:
    pm_lockstep_coordinator_close(coordinator);
    pm_transport_close(transport);
    return status;
}

static pm_status run_processes(bench *b) {
    const int64_t session = pm_lockstep_session();
    int rank, count;
    if (pm_transport_has_ranks(b->url)) {
        PM_TRY(pm_transport_place(b->url, &rank, &count));
        return rank == 0 ? conduct(b, 0) : serve(b, rank - 1, 0);
    }
    fflush(stdout);
    for (int i = 0; i < b->processes; ++i) {
        if (fork() == 0) {
            const pm_status status = serve(b, i, session);
            if (status != PM_OK) {
                fprintf(stderr, "bench_processes: %s\n", pm_error());
            }
            _exit((int)status);
        }
    }
    const pm_status status = conduct(b, session);
    while (wait(NULL) > 0) {
    }
    return status;
}

// Runs one process of a run on several hosts.
static pm_status run_one(bench *b, int64_t session, int process_id) {
    return process_id < 0 ? conduct(b, session) : serve(b, process_id, session);
}

int main(int argc, char **argv) {
    if (argc < 6 || argc > 9 || argc == 8) {
        fprintf(stderr, "usage: run_bench_processes CONFIGS SHAPE LINKS STEPS PROCESSES [URL "
                        "[SESSION PROCESS]]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    bench b = {.links = atoi(argv[3]),
               .steps = atol(argv[4]),
               .processes = atoi(argv[5]),
               .url = argc > 6 ? argv[6] : LCM_URL};
    pm_status status = open_links(&b, argv[1], argv[2]);
    if (status == PM_OK) {
        status = argc == 9         ? run_one(&b, atol(argv[7]), atoi(argv[8]))
                 : b.processes > 0 ? run_processes(&b)
                                   : run_here(&b);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_processes: %s\n", pm_error());
    }
    free(b.z);
    pm_system_free(b.system);
    pm_scene_free(b.scene);
    return (int)status;
}
