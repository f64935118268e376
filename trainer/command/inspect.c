// portmet-train inspect: describes a file of measurements, column by column.
#include "command/commands.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/linalg.h"
#include "base/options.h"
#include "base/python.h"
#include "command/tables.h"
#include "data/hold.h"
#include "store/dataset.h"

// The standard deviation of a fourth difference 1 -4 6 -4 1 of white noise of deviation 1, and the
// ratio of the standard deviation of a normal distribution to its median absolute value.
#define FOURTH_DIFFERENCE 8.3666002653407556
#define NORMAL_MEDIAN 1.4826022185056018
#define EVEN 1e-3 // of a step: by so much even times may differ
#define MOST_FILES 10000
#define GAP 1.5 // a step of time that is so many times the median one is a gap

typedef struct column_facts {
    long count, missing;
    double least, largest, mean, deviation;
    double noise;      // NAN: too few samples in a row
    double resolution; // the smallest difference of two samples in a row that is not zero; 0: none
} column_facts;

// The number of samples of a trajectory before its times end.
static int sample_count(const pm_dataset *d, int trajectory) {
    return pm_dataset_length(d, trajectory);
}

// Prints the times and the table of columns; unit [ncolumn], or NULL: no unit is known. `work`
// [ntrajectory ntime] receives steps, then fourth differences: noise of neighbouring samples is
// independent, while a smooth motion hardly has such differences.
static pm_status print_facts(const pm_dataset *d, const char *const *unit, const char *path,
                             double *work) {
    double shortest = INFINITY, longest = 0; // trajectory, s
    size_t steps = 0;
    for (int i = 0; i < d->ntrajectory; ++i) {
        const int count = sample_count(d, i);
        const double duration = pm_dataset_time(d, i, count - 1) - pm_dataset_time(d, i, 0);
        shortest = fmin(shortest, duration);
        longest = fmax(longest, duration);
        for (int k = 0; k + 1 < count; ++k) {
            work[steps++] = pm_dataset_time(d, i, k + 1) - pm_dataset_time(d, i, k);
        }
    }
    pm_sort(steps, work);
    const double median = steps > 0 ? work[steps / 2] : 0;
    long gaps = 0;
    for (size_t i = 0; i < steps; ++i) {
        gaps += work[i] > GAP * median;
    }
    printf("%s: %d trajector%s of %.6g to %.6g s, at most %d samples each\n", path, d->ntrajectory,
           d->ntrajectory == 1 ? "y" : "ies", shortest, longest, d->ntime);
    if (d->times == NULL || work[steps - 1] - work[0] <= EVEN * median) {
        printf("times: even, %.9g s apart\n", d->dt);
    } else {
        printf("times: uneven, %.4g to %.4g s apart, median %.6g s; %ld steps longer than %.1f "
               "medians\n",
               steps > 0 ? work[0] : INFINITY, steps > 0 ? work[steps - 1] : 0, median, gaps, GAP);
    }
    printf("%-14s %-8s %9s %9s %12s %12s %12s %12s %10s %10s\n", "column", "unit", "samples",
           "missing", "least", "largest", "mean", "deviation", "noise, %", "smallest step");
    for (int c = 0; c < d->ncolumn; ++c) {
        column_facts f = {.least = INFINITY, .largest = -INFINITY, .resolution = INFINITY};
        const ptrdiff_t n = d->ncolumn;
        double square = 0;
        size_t differences = 0;
        for (int i = 0; i < d->ntrajectory; ++i) {
            const int count = sample_count(d, i);
            for (int k = 0; k < count; ++k) {
                const double *y = pm_dataset_state(d, i, k) + c;
                if (isnan(*y)) {
                    ++f.missing;
                } else {
                    f.least = fmin(f.least, *y);
                    f.largest = fmax(f.largest, *y);
                    f.mean += *y;
                    square += *y * *y;
                    ++f.count;
                }
                const double step = k > 0 ? fabs(y[0] - y[-n]) : NAN;
                f.resolution = step > 0 ? fmin(f.resolution, step) : f.resolution;
                if (k + 4 < count) {
                    const double fourth = y[0] - 4 * y[n] + 6 * y[2 * n] - 4 * y[3 * n] + y[4 * n];
                    if (isfinite(fourth)) {
                        work[differences++] = fabs(fourth);
                    }
                }
            }
        }
        pm_sort(differences, work);
        f.noise = differences > 0 ? work[differences / 2] * NORMAL_MEDIAN / FOURTH_DIFFERENCE : NAN;
        f.mean /= f.count > 0 ? (double)f.count : 1;
        f.deviation = f.count > 0 ? sqrt(fmax(square / (double)f.count - f.mean * f.mean, 0)) : NAN;
        f.resolution = isfinite(f.resolution) ? f.resolution : 0;
        printf("%-14s %-8s %9ld %9ld %12.5g %12.5g %12.5g %12.5g %10.2g %10.2g\n", d->column[c],
               unit == NULL ? "" : unit[c], f.count, f.missing, f.least, f.largest, f.mean,
               f.deviation, 100 * f.noise / f.deviation, f.resolution);
    }
    printf("noise: at most so much, in %% of the deviation, by the fourth differences of "
           "neighbouring samples;\na motion that is fast compared with the sampling adds to it\n");
    int held = 0;
    for (int c = 0; c < d->ncolumn; ++c) {
        pm_hold hold;
        PM_TRY(pm_hold_of_column(d, c, &hold));
        if (hold == PM_HOLD_PREVIOUS) {
            printf("%s%s",
                   held++ == 0 ? "staircases, as of inputs that are held between samples "
                                 "(hold: previous): "
                               : ", ",
                   d->column[c]);
        }
    }
    printf(held > 0 ? "\n" : "");
    return PM_OK;
}

pm_status pm_command_inspect(int argc, char **argv, const volatile sig_atomic_t *stop) {
    const char **file = calloc(MOST_FILES + 1, sizeof *file), *name = "z", *folder = NULL;
    PM_TRY(pm_allocated(file, "a description"));
    const pm_option table[] = {
        {"--data-set", NULL, "NAME", NULL, &name, false, .help = "the dataset in FILE; default: z"},
        {"--plot", NULL, "DIR", NULL, &folder, false,
         .help = "draw all columns over time into DIR (gnuplot)"},
    };
    const pm_options options = {
        .usage = "portmet-train inspect FILE... [options]",
        .summary =
            "Describes measurements, a dataset or tables (see import --help): the times and their\n"
            "gaps, and for each column its unit, samples, range and noise.",
        .examples = "portmet-train inspect runs.h5",
        .positional_name = "FILE",
        .positional = file,
        .least = 1,
        .most = MOST_FILES,
        PM_OPTION_TABLE(table),
    };
    (void)stop;
    pm_dataset *d = NULL;
    pm_data_file data = {0};
    double *work = NULL;
    const char **unit = NULL;
    pm_words given = {.word = file};
    pm_status status;
    PM_TRY_DONE(pm_options_read(&options, argc, argv));
    while (file[given.count] != NULL) {
        ++given.count;
    }
    PM_TRY_DONE(pm_data_open(&data, &given, NULL, false));
    PM_TRY_DONE(folder == NULL ? PM_OK : pm_python_check_pictures("columns", folder));
    PM_TRY_DONE(pm_dataset_load_measured(&d, data.path, name));
    PM_TRY_DONE(pm_dataset_units(d, &d->arena, &unit));
    work = pm_arena_array(&d->arena, (size_t)d->ntrajectory * (size_t)d->ntime + 1, sizeof *work);
    PM_TRY_DONE(pm_arena_status(&d->arena, "differences"));
    const char *title =
        given.count == 1 ? file[0]
                         : pm_arena_printf(&d->arena, "%s and %d more", file[0], given.count - 1);
    PM_TRY_DONE(pm_arena_status(&d->arena, "a title"));
    PM_TRY_DONE(print_facts(d, unit, title, work));
    if (folder != NULL) {
        const char *const drawn[] = {"columns", folder, data.path, name, NULL};
        PM_TRY_DONE(pm_options_folder(folder));
        status = pm_python_run(&pm_python_pictures, drawn, false);
    }
done:
    pm_dataset_free(d);
    pm_data_close(&data);
    free(file);
    return status;
}
