// Measures a chain of learned links in one process, and in several with a coordinator: the time of
// a step by the clock, the processor time of each process, and the time for which each waits. The
// links begin in different states, so that none rests. The weights are the shipped ones.
//   run_bench_processes CONFIGS LINKS STEPS PROCESSES [URL]
// PROCESSES 0 is a run in one process that books every step in its ledger. Without URL the
// processes meet over LCM on this host. With mpi:// mpirun starts them, one more than PROCESSES.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/linalg.h"
#include "base/progress.h"
#include "base/rng.h"
#include "lockstep/lockstep.h"
#include "sim/monolithic.h"

#define NZ 5 // of a link
#define SEED 18u
#define WARM 4 // steps before the measurement
#define LCM_URL "udpm://239.255.76.67:7667?ttl=0"

// Links one and two. Further ones start near the second.
static const double start[2 * NZ] = {4.5, 4.4, -0.5, 1.4, -0.1, -2.7, 0.1, 1.4, -0.2, 0.1};

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

// --- the chain ---

static pm_status parse(bench *b, const char *configs) {
    static const char format[] =
        "scene: chain\ntime: {dt: 1.0e-6, steps: %ld, integrator: euler}\nsubsystems:\n"
        "  link0: {weights: weights/double_pendulum/upper.h5, state: %s}\n"
        "  \"link[1:%d]\": {weights: weights/double_pendulum/lower.h5, state: %s}\n"
        "ports:\n  \"joint[0:%d]\": {law: bracket, between: [\"link[i]\", \"link[i+1]\"],\n"
        "    weights: weights/double_pendulum/joint.h5,\n"
        "    expose: {\"link[i]\": [q, p, s], \"link[i+1]\": [q, p, s]}}\n"
        "processes:\n";
    static const char state[] =
        "{q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, s: {unit: J/K, size: 1}}";
    char path[4096], *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a scene");
    }
    fprintf(file, format, b->steps + WARM, state, b->links, state, b->links - 1);
    const int count = b->processes > 0 ? b->processes : 1;
    for (int i = 0; i < count; ++i) {
        fprintf(file, "  process%d: \"link[%d:%d]\"\n", i, (int)((long)b->links * i / count),
                (int)((long)b->links * (i + 1) / count));
    }
    fclose(file);
    snprintf(path, sizeof path, "%s/chain.yaml", configs);
    const pm_status status = pm_scene_parse(&b->scene, text, path);
    free(text);
    return status;
}

static pm_status open_chain(bench *b, const char *configs) {
    PM_TRY(parse(b, configs));
    PM_TRY(pm_system_load(&b->system, b->scene, NULL));
    b->z = malloc((size_t)b->scene->nz * sizeof *b->z);
    if (b->z == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for %d links", b->links);
    }
    pm_rng rng;
    pm_rng_init(&rng, SEED, 0);
    for (int i = 0; i < b->scene->nz; ++i) {
        b->z[i] = start[i < NZ ? i : NZ + i % NZ] + 0.05 * pm_rng_normal(&rng);
    }
    return PM_OK;
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
        PM_TRY_DONE(pm_ledger_enter(&ledger, &sample, &tally));
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
    PM_TRY_DONE(pm_transport_open(&transport, b->url, NULL));
    PM_TRY_DONE(pm_lockstep_node_open(&node, b->system, process_id, transport, &options));
    const double clock = pm_clock(), cpu = processor_time();
    status = pm_lockstep_run_node(node, NULL);
    print(b, b->scene->process[process_id].name, pm_clock() - clock, processor_time() - cpu,
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
    PM_TRY_DONE(pm_transport_open(&transport, b->url, NULL));
    PM_TRY_DONE(pm_lockstep_coordinator_open(&coordinator, b->system, transport, &options));
    status = pm_lockstep_run_coordinator(coordinator, NULL);
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

int main(int argc, char **argv) {
    if (argc < 5 || argc > 6) {
        fprintf(stderr, "usage: run_bench_processes CONFIGS LINKS STEPS PROCESSES [URL]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    bench b = {.links = atoi(argv[2]),
               .steps = atol(argv[3]),
               .processes = atoi(argv[4]),
               .url = argc == 6 ? argv[5] : LCM_URL};
    pm_status status = open_chain(&b, argv[1]);
    if (status == PM_OK) {
        status = b.processes > 0 ? run_processes(&b) : run_here(&b);
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_processes: %s\n", pm_error());
    }
    free(b.z);
    pm_system_free(b.system);
    pm_scene_free(b.scene);
    return (int)status;
}
