// Measures systems of 2 to 100,000 learned links (many_links.h) in one process: the processor time
// of a link and step, of reading and building a link, and the memory of a link. The sizes take
// turns, so that a busy machine slows all of them alike.
//   run_bench_scale CONFIGS [INTEGRATOR [SHAPE [compiled]]]
#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/linalg.h"
#include "many_links.h"
#include "sim/monolithic.h"

#define ROUNDS 9   // of which the median counts
#define WORK 40000 // links times steps of a round, at least one step

static const int sizes[] = {2, 8, 64, 1000, 10000, 100000};
#define SIZES ((int)(sizeof sizes / sizeof sizes[0]))

typedef struct subject {
    int links;
    pm_scene *scene;
    pm_system *system;
    pm_monolithic *monolithic;
    double read, load, open; // s of processor time
    size_t bytes[3];         // of scene, system, integration
    double seconds[ROUNDS];  // of processor time for a link and step
} subject;

// Returns the processor time of this process in s.
static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static size_t allocated(void) {
    const struct mallinfo2 info = mallinfo2();
    return info.uordblks + info.hblkhd;
}

static pm_status open_subject(subject *s, many_links what) {
    const size_t nothing = allocated();
    const double before = now();
    what.links = s->links;
    PM_TRY(many_links_scene(&s->scene, &what));
    s->links = s->scene->physics.nsubsystem; // a grid is a square
    const double parsed = now();
    s->bytes[0] = allocated() - nothing;
    PM_TRY(pm_system_load(&s->system, s->scene, NULL));
    const double loaded = now();
    s->bytes[1] = allocated() - nothing - s->bytes[0];
    s->system->compiled = what.compiled;
    PM_TRY(pm_monolithic_open(&s->monolithic, s->system));
    s->open = now() - loaded;
    s->bytes[2] = allocated() - nothing - s->bytes[0] - s->bytes[1];
    s->read = parsed - before;
    s->load = loaded - parsed;
    double *z = many_links_states(s->scene);
    if (z == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for %d links", s->links);
    }
    pm_monolithic_set_state(s->monolithic, z);
    free(z);
    return PM_OK;
}

static pm_status measure(subject *s, int round) {
    const int steps = 1 + WORK / s->links;
    const double before = now();
    for (int i = 0; i < steps; ++i) {
        PM_TRY(pm_monolithic_step(s->monolithic));
    }
    s->seconds[round] = (now() - before) / steps / s->links;
    return PM_OK;
}

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void print(subject *s) {
    qsort(s->seconds, ROUNDS, sizeof s->seconds[0], compare);
    const double n = s->links;
    printf("%7d  %7.1f %7.1f %7.1f %7.1f  %6.2f  %7.2f %7.2f %7.2f  %6.0f %6.0f %6.0f\n", s->links,
           1e9 * s->seconds[0], 1e9 * s->seconds[ROUNDS / 2], 1e9 * s->seconds[ROUNDS / 4],
           1e9 * s->seconds[3 * ROUNDS / 4], 1e-6 / s->seconds[ROUNDS / 2], 1e6 * s->read / n,
           1e6 * s->load / n, 1e6 * s->open / n, (double)s->bytes[0] / n, (double)s->bytes[1] / n,
           (double)s->bytes[2] / n);
}

static pm_status run(subject *subjects, const many_links *what) {
    for (int i = 0; i < SIZES; ++i) {
        subjects[i].links = sizes[i];
        PM_TRY(open_subject(&subjects[i], *what));
    }
    for (int round = 0; round < ROUNDS; ++round) {
        for (int i = 0; i < SIZES; ++i) {
            PM_TRY(measure(&subjects[i], round));
        }
    }
    printf("%s, %s, %s; processor time of a link\n", what->shape, what->integrator,
           what->compiled ? "compiled" : "interpreted");
    printf(
        "  links  ns/step: least, median, quartiles  M/s    us: read    load    open  bytes: scene "
        "system integration\n");
    for (int i = 0; i < SIZES; ++i) {
        print(&subjects[i]);
    }
    return PM_OK;
}

int main(int argc, char **argv) {
    if (argc < 2 || argc > 5) {
        fprintf(stderr, "usage: run_bench_scale CONFIGS [INTEGRATOR [SHAPE [compiled]]]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    subject subjects[SIZES] = {{0}};
    const many_links what = {.configs = argv[1],
                             .shape = argc > 3 ? argv[3] : "chain",
                             .integrator = argc > 2 ? argv[2] : "euler",
                             .steps = 1,
                             .compiled = argc > 4};
    const pm_status status = run(subjects, &what);
    if (status != PM_OK) {
        fprintf(stderr, "bench_scale: %s\n", pm_error());
    }
    for (int i = 0; i < SIZES; ++i) {
        pm_monolithic_close(subjects[i].monolithic);
        pm_system_free(subjects[i].system);
        pm_scene_free(subjects[i].scene);
    }
    return (int)status;
}
