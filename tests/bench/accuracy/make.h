// Runs portmet-train for a study. What it makes is kept in folders named by a digest of trainer,
// scene, configuration and data, so that variants which two questions share are trained once and a
// study that was interrupted goes on.
#ifndef TESTS_BENCH_MAKE_H
#define TESTS_BENCH_MAKE_H

#include <stdint.h>

#include "study.h"

typedef struct study_place {
    const char *configs; // folder of scenes and training files
    const char *trainer; // path of portmet-train
    const char *work;    // folder for all that is made
    uint64_t digest;     // of the trainer and all scenes
} study_place;

// Fills in the digest. PM_EFILE.
pm_status study_place_look(study_place *place);

typedef struct study_made {
    const char *config;  // the file that portmet-train was given
    const char *folder;  // weights
    const char *data;    // dataset
    double cpu, elapsed; // s; the first of both threads together
} study_made;

// A dataset, and the weights learned from it. Text lives in the arena. PM_EFILE: the program failed
// (its log is named); PM_ECONFIG, PM_ENOMEM.
pm_status study_simulate(const study_place *place, const study_file *truth, pm_arena *arena,
                         study_made *made);
pm_status study_train(const study_place *place, const study_file *training, const char *data,
                      pm_arena *arena, study_made *made);

// Runs a program inside `folder` (NULL: here) with its output in the file `log`. PM_EFILE. `cpu`
// receives the CPU time it took in s.
pm_status study_run(char *const *argv, const char *folder, const char *log, double *cpu);

#endif
