// A study of accuracy, read from YAML: a list of questions, each with the trainings that answer it.
// A training is a shipped training file in which passages are replaced, so that two trainings
// differ only in the setting under study.
#ifndef TESTS_BENCH_STUDY_H
#define TESTS_BENCH_STUDY_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"

typedef struct study_passage {
    const char *old, *new;
} study_passage;

// A file of the configuration folder, and the passages to replace in it. Each passage must occur
// exactly once.
typedef struct study_file {
    const char *path; // in that folder
    int count;
    const study_passage *passage;
} study_file;

typedef struct study_variant {
    const char *name;
    const char *predicted; // the result that was predicted before the run
    study_file training;
    bool growth; // also scored on the long trajectories
} study_variant;

typedef struct study_question {
    const char *name, *asks;
    int count;
    const study_variant *variant;
    const char *picture; // gnuplot script that draws several variants in one picture, or NULL
} study_question;

// The datasets of a study: trajectories for training, trajectories of another seed for scores, and
// long trajectories for the growth of errors.
enum { STUDY_TRAINING, STUDY_VALIDATION, STUDY_GROWTH, STUDY_TRUTHS };

typedef struct study {
    pm_arena arena; // owns all that follows
    study_file truth[STUDY_TRUTHS];
    int count;
    const study_question *question;
} study;

// Reads a study into storage that the caller owns and frees with study_free, after a failure too.
// PM_EFILE, PM_ECONFIG, PM_ENOMEM.
pm_status study_load(study *s, const char *path);
void study_free(study *s);

// Gives the text of the file in `folder`, with its passages replaced, in the arena. PM_EFILE;
// PM_ECONFIG: a passage does not occur exactly once; PM_ENOMEM.
pm_status study_text(const study_file *file, const char *folder, pm_arena *arena,
                     const char **text);

// Replaces one passage of *text. Errors call the text `path`. PM_ECONFIG, PM_ENOMEM.
pm_status study_replace(const study_passage *passage, const char *path, pm_arena *arena,
                        const char **text);

#endif
