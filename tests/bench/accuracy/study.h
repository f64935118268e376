// What a study of accuracy compares, read from YAML: questions, and for each the trainings that
// answer it. A training is a shipped training file in which passages are replaced, so that nothing
// but what is asked for differs.
#ifndef TESTS_BENCH_STUDY_H
#define TESTS_BENCH_STUDY_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"

typedef struct study_passage {
    const char *old, *new;
} study_passage;

// A file of the configuration folder, each passage of which that is listed stands there once.
typedef struct study_file {
    const char *path; // in that folder
    int count;
    const study_passage *passage;
} study_file;

typedef struct study_variant {
    const char *name;
    const char *predicted; // what was expected before it was run
    study_file training;
    bool growth; // followed over the long trajectories too
} study_variant;

typedef struct study_question {
    const char *name, *asks;
    int count;
    const study_variant *variant;
    const char *picture; // gnuplot script that draws several of them together, or NULL
} study_question;

// training: what is learned from; validation: trajectories of another seed, on which everything is
// scored; growth: long ones.
enum { STUDY_TRAINING, STUDY_VALIDATION, STUDY_GROWTH, STUDY_TRUTHS };

typedef struct study {
    pm_arena arena; // owns all that follows
    study_file truth[STUDY_TRUTHS];
    int count;
    const study_question *question;
} study;

// Storage the caller owns, freed by study_free, on failure too. PM_EFILE, PM_ECONFIG, PM_ENOMEM.
pm_status study_load(study *s, const char *path);
void study_free(study *s);

// The text of the file in `folder`, passages replaced, in the arena. PM_EFILE; PM_ECONFIG: a
// passage that does not stand there exactly once; PM_ENOMEM.
pm_status study_text(const study_file *file, const char *folder, pm_arena *arena,
                     const char **text);

// Replaces one passage of *text, which `path` stands for in errors. PM_ECONFIG, PM_ENOMEM.
pm_status study_replace(const study_passage *passage, const char *path, pm_arena *arena,
                        const char **text);

#endif
