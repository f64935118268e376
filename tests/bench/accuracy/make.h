// Runs portmet-train for a study. Results are kept in folders named by a digest of trainer, scene,
// configuration and data. A variant that two questions share is therefore trained once, and an
// interrupted study can be continued.
#ifndef TESTS_BENCH_MAKE_H
#define TESTS_BENCH_MAKE_H

#include <stdint.h>

#include "study.h"

typedef struct study_place {
    const char *configs; // folder of scenes and training files
    const char *trainer; // path of portmet-train
    const char *work;    // folder for all results
    uint64_t digest;     // of the trainer and all scenes
} study_place;

// Computes the digest of a place whose other members are set. PM_EFILE.
pm_status study_place_look(study_place *place);

typedef struct study_made {
    const char *config;  // the file that portmet-train read
    const char *folder;  // weights
    const char *data;    // dataset
    double cpu, elapsed; // s; the first of both threads together
} study_made;

// Make a dataset with `portmet-train truth`, and weights from a dataset with `portmet-train fit`.
// Text lives in the arena. PM_EFILE: the program failed (the message names its log); PM_ECONFIG,
// PM_ENOMEM.
pm_status study_simulate(const study_place *place, const study_file *truth, pm_arena *arena,
                         study_made *made);
pm_status study_train(const study_place *place, const study_file *training, const char *data,
                      pm_arena *arena, study_made *made);

// Runs a program in `folder` (NULL: the current folder) and writes its output to the file `log`.
// `cpu` receives its CPU time in s. PM_EFILE.
pm_status study_run(char *const *argv, const char *folder, const char *log, double *cpu);

#endif
