// Measures a step of the double pendulum in one process on one core (both subsystems and the joint,
// with their fluxes), and a step of a chain of 64 links made of the same subsystems. The weights
// are the shipped ones.
//   run_bench_step CSV CONFIGS
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "bench.h"
#include "sim/monolithic.h"

#define LINKS 64
#define NZ 5 // of a link
#define CASES 4
// s; all steps measured come to less than a second of motion.
#define DT 1e-6
// us, of the method authors' program in the same sense.
#define REFERENCE 250.0

// Links one and two. Further ones start as the second, but for a little: else they would be at rest
// relative to each other, which costs nothing.
static const double start[2 * NZ] = {4.5, 4.4, -0.5, 1.4, -0.1, -2.7, 0.1, 1.4, -0.2, 0.1};

static void step(void *context) {
    // The state stays finite: see DT.
    (void)pm_monolithic_step(context);
}

// One scene, its models and what steps it.
typedef struct subject {
    const char *integrator;
    int links;
    pm_scene *scene;
    pm_system *system;
    pm_monolithic *assembly;
} subject;

static void write_chain(FILE *file, int links) {
    fprintf(file, "scene: chain\ntime: {dt: 1.0, steps: 1, integrator: euler}\nsubsystems:\n");
    for (int i = 1; i <= links; ++i) {
        fprintf(file,
                "  link%d:\n    weights: weights/double_pendulum/%s.h5\n"
                "    state: {q: {unit: m, size: 2}, p: {unit: kg m/s, size: 2}, "
                "s: {unit: J/K, size: 1}}\n",
                i, i == 1 ? "upper" : "lower");
    }
    fprintf(file, "ports:\n");
    for (int i = 1; i < links; ++i) {
        fprintf(
            file,
            "  joint%d: {law: bracket, between: [link%d, link%d], weights: "
            "weights/double_pendulum/joint.h5, expose: {link%d: [q, p, s], link%d: [q, p, s]}}\n",
            i, i, i + 1, i, i + 1);
    }
}

static pm_status load_chain(subject *s, const char *configs) {
    char path[4096], *text = NULL;
    size_t size;
    snprintf(path, sizeof path, "%s/chain.yaml", configs);
    FILE *file = open_memstream(&text, &size);
    if (file == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a scene");
    }
    write_chain(file, s->links);
    fclose(file);
    const pm_status status = pm_scene_parse(&s->scene, text, path);
    free(text);
    PM_TRY(status);
    return pm_system_load(&s->system, s->scene, NULL);
}

static pm_status open_subject(subject *s, const char *configs) {
    double z[LINKS * NZ];
    PM_TRY(load_chain(s, configs));
    s->scene->physics.integrator = pm_integrator_find(s->integrator);
    s->scene->physics.dt = DT;
    for (int i = 0; i < s->links; ++i) {
        memcpy(z + i * NZ, start + (i == 0 ? 0 : NZ), NZ * sizeof *z);
        z[i * NZ] += 0.01 * i;
    }
    PM_TRY(pm_monolithic_open(&s->assembly, s->system));
    pm_monolithic_set_state(s->assembly, z);
    return PM_OK;
}

static pm_status measure(subject *subjects, const char *csv, const char *configs) {
    bench_work *const work[CASES] = {step, step, step, step};
    void *context[CASES];
    bench_time time[CASES];
    bench_table *table = NULL;
    for (int i = 0; i < CASES; ++i) {
        PM_TRY(open_subject(&subjects[i], configs));
        context[i] = subjects[i].assembly;
    }
    bench_measure(CASES, work, context, time);
    PM_TRY(bench_table_open(&table, csv));
    for (int i = 0; i < CASES; ++i) {
        char name[64];
        snprintf(name, sizeof name, "%d links, %s", subjects[i].links, subjects[i].integrator);
        bench_table_add(table, name, time[i], 0, 0);
    }
    bench_table_close(table);
    printf("an euler step of the pair takes %.0f us in the authors' program: %.0f times as long\n",
           REFERENCE, REFERENCE / (1e6 * time[0].median));
    for (int i = 0; i < CASES; i += CASES - 1) {
        printf("%d links: %.0f subsystem-steps/s\n", subjects[i].links,
               subjects[i].links / time[i].median);
    }
    return PM_OK;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "usage: run_bench_step CSV CONFIGS\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    subject subjects[CASES] = {{.integrator = "euler", .links = 2},
                               {.integrator = "heun", .links = 2},
                               {.integrator = "rk4", .links = 2},
                               {.integrator = "euler", .links = LINKS}};
    const pm_status status = measure(subjects, argv[1], argv[2]);
    if (status != PM_OK) {
        fprintf(stderr, "bench_step: %s\n", pm_error());
    }
    for (int i = 0; i < CASES; ++i) {
        pm_monolithic_close(subjects[i].assembly);
        pm_system_free(subjects[i].system);
        pm_scene_free(subjects[i].scene);
    }
    return (int)status;
}
