// Studies what limits the error of a learned system: trains the variants of a study one after
// another on the same data, and scores each on trajectories that no training saw. The run takes
// hours.
//   run_bench_accuracy CSV CONFIGS SOURCE TRAINER [QUESTION ...]
// SOURCE is the folder of study.yaml; without a QUESTION all questions are run. All results, a log
// of each training and pictures of the growth of errors are kept in the folder "accuracy".
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "base/linalg.h"
#include "make.h"
#include "measure.h"

#define WORK "accuracy"
#define PICTURES WORK "/pictures"

typedef struct bench {
    pm_arena arena;
    study study;
    study_place place;
    const char *source;
    const char *training_data;
    study_truth truth[STUDY_TRUTHS]; // none of STUDY_TRAINING
    FILE *csv;
} bench;

// --- tables ---

static void print_header(const study_question *question) {
    printf("\n%s: %s\n", question->name, question->asks);
    printf("%-26s %7s %6s %8s  %-23s  %-23s  %9s %7s\n", "", "", "CPU", "one step",
           "median error, %", "mean error, %", "own E", "S falls");
    printf("%-26s %7s %6s %8s  %7s %7s %7s  %7s %7s %7s  %9s %7s\n", "", "weights", "s", "%", "q",
           "p", "s", "q", "p", "s", "drifts, J", "% steps");
}

static void print_score(const study_variant *variant, const study_made *made,
                        const study_score *s) {
    printf("%-26s %7d %6.0f %8.2g ", variant->name, s->weights, made->cpu,
           100 * sqrt(s->step_median));
    for (int g = 0; g < STUDY_GROUPS; ++g) {
        printf(" %7.2g", 100 * s->median[g]);
    }
    printf(" ");
    for (int g = 0; g < STUDY_GROUPS; ++g) {
        printf(" %7.2g", 100 * s->mean[g]);
    }
    printf("  %9.1e %7.1f\n", s->laws.own_median, 100 * s->laws.falls);
    printf("    predicted: %s\n", variant->predicted);
    if (s->failures > 0) {
        printf("    %d rollouts became non-finite\n", s->failures);
    }
    fflush(stdout);
}

static void print_growth(const study_score *s) {
    for (int k = 0; k < STUDY_TIMES; ++k) {
        printf("    first %3.0f s: median error", s->time[k]);
        for (int g = 0; g < STUDY_GROUPS; ++g) {
            printf(" %8.2g", 100 * s->growth[k][g]);
        }
        printf(" %%\n");
    }
    const study_laws *l = &s->laws;
    printf(
        "    median and worst: energy strays by %.1e %.1e J, the model's own by %.1e %.1e J,\n"
        "    angular momentum by %.1e %.1e kg m^2/s; entropy falls by up to %.1e J/K, on %.1f %% "
        "of the steps;\n    %d rollouts became non-finite\n",
        l->energy_median, l->energy_worst, l->own_median, l->own_worst, l->momentum_median,
        l->momentum_worst, l->fall, 100 * l->falls, s->failures);
    fflush(stdout);
}

static void write_csv_header(FILE *csv) {
    fprintf(csv, "question,variant,data,weights,cpu_s,elapsed_s,step_median,step_mean,"
                 "q_median,p_median,s_median,q_mean,p_mean,s_mean,energy_median_J,energy_worst_J,"
                 "own_energy_median_J,own_energy_worst_J,"
                 "momentum_median,momentum_worst,entropy_falls,entropy_fall_J_per_K,nonfinite\n");
}

static void write_csv(FILE *csv, const study_question *question, const study_variant *variant,
                      const char *data, const study_made *made, const study_score *s) {
    fprintf(csv, "\"%s\",\"%s\",%s,%d,%.3f,%.3f,%.6g,%.6g", question->name, variant->name, data,
            s->weights, made->cpu, made->elapsed, s->step_median, s->step_mean);
    for (int g = 0; g < STUDY_GROUPS; ++g) {
        fprintf(csv, ",%.6g", s->median[g]);
    }
    for (int g = 0; g < STUDY_GROUPS; ++g) {
        fprintf(csv, ",%.6g", s->mean[g]);
    }
    const study_laws *l = &s->laws;
    fprintf(csv, ",%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%d\n", l->energy_median, l->energy_worst,
            l->own_median, l->own_worst, l->momentum_median, l->momentum_worst, l->falls, l->fall,
            s->failures);
    fflush(csv);
}

// --- runs ---

static pm_status follow_growth(bench *b, const study_question *question,
                               const study_variant *variant, const study_made *made) {
    study_score score;
    const char *pictures = pm_arena_printf(&b->arena, PICTURES "/%s", variant->name);
    if (pictures == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for paths");
    }
    PM_TRY(study_measure(made->config, made->folder, &b->truth[STUDY_GROWTH], pictures, &score));
    print_growth(&score);
    write_csv(b->csv, question, variant, "growth", made, &score);
    return PM_OK;
}

// Runs the question's gnuplot script on the data beside the pictures.
static pm_status draw(bench *b, const study_question *question) {
    char *const script = pm_arena_printf(&b->arena, "%s/%s", b->source, question->picture);
    char *const argv[] = {"gnuplot", script, NULL};
    double cpu;
    return script == NULL ? pm_fail(PM_ENOMEM, "out of memory for paths")
                          : study_run(argv, PICTURES, PICTURES "/log", &cpu);
}

static pm_status answer(bench *b, const study_question *question) {
    print_header(question);
    for (int i = 0; i < question->count; ++i) {
        const study_variant *variant = &question->variant[i];
        study_made made;
        study_score score;
        PM_TRY(study_train(&b->place, &variant->training, b->training_data, &b->arena, &made));
        PM_TRY(study_measure(made.config, made.folder, &b->truth[STUDY_VALIDATION], NULL, &score));
        print_score(variant, &made, &score);
        write_csv(b->csv, question, variant, "validation", &made, &score);
        if (variant->growth) {
            PM_TRY(follow_growth(b, question, variant, &made));
        }
    }
    return question->picture == NULL ? PM_OK : draw(b, question);
}

static pm_status simulate(bench *b) {
    for (int i = 0; i < STUDY_TRUTHS; ++i) {
        study_made made;
        PM_TRY(study_simulate(&b->place, &b->study.truth[i], &b->arena, &made));
        if (i == STUDY_TRAINING) {
            b->training_data = made.data;
        } else {
            PM_TRY(pm_truth_load(&b->truth[i].physics, made.config, NULL));
            PM_TRY(pm_dataset_load(&b->truth[i].dataset, made.data));
        }
    }
    return PM_OK;
}

static bool is_asked(const char *name, int count, char **names) {
    for (int i = 0; i < count; ++i) {
        if (strcmp(name, names[i]) == 0) {
            return true;
        }
    }
    return count == 0;
}

static pm_status check_names(const study *s, int count, char **names) {
    for (int i = 0; i < count; ++i) {
        bool found = false;
        for (int k = 0; k < s->count; ++k) {
            found = found || strcmp(names[i], s->question[k].name) == 0;
        }
        if (!found) {
            return pm_fail(PM_EUSAGE, "there is no question \"%s\"", names[i]);
        }
    }
    return PM_OK;
}

static pm_status run(bench *b, int count, char **names) {
    char path[4096];
    if ((size_t)snprintf(path, sizeof path, "%s/study.yaml", b->source) >= sizeof path) {
        return pm_fail(PM_EFILE, "%s: the path is too long", b->source);
    }
    PM_TRY(study_place_look(&b->place));
    PM_TRY(study_load(&b->study, path));
    PM_TRY(check_names(&b->study, count, names));
    if ((mkdir(WORK, 0777) != 0 && errno != EEXIST) ||
        (mkdir(PICTURES, 0777) != 0 && errno != EEXIST)) {
        return pm_fail(PM_EFILE, PICTURES ": %s", strerror(errno));
    }
    PM_TRY(simulate(b));
    write_csv_header(b->csv);
    for (int i = 0; i < b->study.count; ++i) {
        const study_question *question = &b->study.question[i];
        if (is_asked(question->name, count, names)) {
            PM_TRY(answer(b, question));
        }
    }
    return PM_OK;
}

static void free_all(bench *b) {
    for (int i = 0; i < STUDY_TRUTHS; ++i) {
        pm_truth_free(b->truth[i].physics);
        pm_dataset_free(b->truth[i].dataset);
    }
    study_free(&b->study);
    pm_arena_free(&b->arena);
}

int main(int argc, char **argv) {
    if (argc < 5) {
        fprintf(stderr, "usage: run_bench_accuracy CSV CONFIGS SOURCE TRAINER [QUESTION ...]\n");
        return PM_EUSAGE;
    }
    pm_linalg_init();
    bench b = {.place = {.configs = argv[2], .trainer = argv[4], .work = WORK},
               .source = argv[3],
               .csv = fopen(argv[1], "w")};
    pm_status status = b.csv == NULL ? pm_fail(PM_EFILE, "%s: %s", argv[1], strerror(errno))
                                     : run(&b, argc - 5, argv + 5);
    if (b.csv != NULL && fclose(b.csv) != 0 && status == PM_OK) {
        status = pm_fail(PM_EFILE, "%s: %s", argv[1], strerror(errno));
    }
    if (status != PM_OK) {
        fprintf(stderr, "bench_accuracy: %s\n", pm_error());
    }
    free_all(&b);
    return (int)status;
}
