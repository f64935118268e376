// portmet-train inspect: describes a file of measurements, column by column.
#include "command/commands.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/options.h"
#include "evaluate/gnuplot.h"
#include "store/dataset.h"

// The standard deviation of a fourth difference 1 -4 6 -4 1 of white noise of deviation 1, and the
// ratio of the standard deviation of a normal distribution to its median absolute value.
#define FOURTH_DIFFERENCE 8.3666002653407556
#define NORMAL_MEDIAN 1.4826022185056018
#define GAP 1.5 // a step of time that is so many times the median one is a gap

typedef struct column_facts {
    long count, missing;
    double least, largest, mean, deviation;
    double noise;      // NAN: too few samples in a row
    double resolution; // the smallest difference of two samples in a row that is not zero; 0: none
} column_facts;

typedef struct time_facts {
    double shortest, median, longest; // s, of all steps
    double first, last;               // s, duration of the shortest and the longest trajectory
    long gaps;
} time_facts;

static int compare(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

// The number of samples of a trajectory before its times end.
static int sample_count(const pm_dataset *d, int trajectory) {
    int count = 0;
    while (count < d->ntime && !isnan(pm_dataset_time(d, trajectory, count))) {
        ++count;
    }
    return count;
}

// --- facts ---

static void add_sample(column_facts *f, double y, double *square) {
    if (isnan(y)) {
        ++f->missing;
        return;
    }
    f->least = fmin(f->least, y);
    f->largest = fmax(f->largest, y);
    f->mean += y;
    *square += y * y;
    ++f->count;
}

// Describes a column. `work` [ntrajectory ntime] receives fourth differences: noise of neighbouring
// samples is independent, while a smooth motion hardly has such differences.
static column_facts describe_column(const pm_dataset *d, int column, double *work) {
    column_facts f = {.least = INFINITY, .largest = -INFINITY, .resolution = INFINITY};
    const ptrdiff_t n = d->ncolumn;
    double square = 0;
    size_t differences = 0;
    for (int i = 0; i < d->ntrajectory; ++i) {
        const int count = sample_count(d, i);
        for (int k = 0; k < count; ++k) {
            const double *y = pm_dataset_state(d, i, k) + column;
            add_sample(&f, *y, &square);
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
    qsort(work, differences, sizeof *work, compare);
    f.noise = differences > 0 ? work[differences / 2] * NORMAL_MEDIAN / FOURTH_DIFFERENCE : NAN;
    f.mean /= f.count > 0 ? (double)f.count : 1;
    f.deviation = f.count > 0 ? sqrt(fmax(square / (double)f.count - f.mean * f.mean, 0)) : NAN;
    f.resolution = isfinite(f.resolution) ? f.resolution : 0;
    return f;
}

static time_facts describe_times(const pm_dataset *d, double *work) {
    time_facts f = {.shortest = INFINITY, .longest = 0, .first = INFINITY, .last = 0};
    size_t steps = 0;
    for (int i = 0; i < d->ntrajectory; ++i) {
        const int count = sample_count(d, i);
        const double duration = pm_dataset_time(d, i, count - 1) - pm_dataset_time(d, i, 0);
        f.first = fmin(f.first, duration);
        f.last = fmax(f.last, duration);
        for (int k = 0; k + 1 < count; ++k) {
            work[steps++] = pm_dataset_time(d, i, k + 1) - pm_dataset_time(d, i, k);
        }
    }
    qsort(work, steps, sizeof *work, compare);
    if (steps > 0) {
        f.shortest = work[0];
        f.median = work[steps / 2];
        f.longest = work[steps - 1];
    }
    for (size_t i = 0; i < steps; ++i) {
        f.gaps += work[i] > GAP * f.median;
    }
    return f;
}

// --- words ---

// Prints the table of columns; unit [ncolumn], or NULL: no unit is known.
static void print_facts(const pm_dataset *d, const char *const *unit, const char *path,
                        double *work) {
    const time_facts t = describe_times(d, work);
    printf("%s: %d trajectories of %.6g to %.6g s, at most %d samples each\n", path, d->ntrajectory,
           t.first, t.last, d->ntime);
    if (d->times == NULL) {
        printf("times: even, %.9g s apart\n", d->dt);
    } else {
        printf("times: uneven, %.4g to %.4g s apart, median %.6g s; %ld steps longer than %.1f "
               "medians\n",
               t.shortest, t.longest, t.median, t.gaps, GAP);
    }
    printf("%-14s %-8s %9s %9s %12s %12s %12s %12s %10s %10s\n", "column", "unit", "samples",
           "missing", "least", "largest", "mean", "deviation", "noise, %", "smallest step");
    for (int c = 0; c < d->ncolumn; ++c) {
        const column_facts f = describe_column(d, c, work);
        printf("%-14s %-8s %9ld %9ld %12.5g %12.5g %12.5g %12.5g %10.2g %10.2g\n", d->column[c],
               unit == NULL ? "" : unit[c], f.count, f.missing, f.least, f.largest, f.mean,
               f.deviation, 100 * f.noise / f.deviation, f.resolution);
    }
    printf("noise: at most so much, in %% of the deviation, by the fourth differences of "
           "neighbouring samples;\na motion that is fast compared with the sampling adds to it\n");
}

// --- picture ---

static pm_status plot(const pm_dataset *d, const char *const *unit, const char *folder) {
    char path[4096];
    PM_TRY(pm_options_folder(folder));
    snprintf(path, sizeof path, "%s/measured.txt", folder);
    FILE *data = fopen(path, "w");
    snprintf(path, sizeof path, "%s/measured.gp", folder);
    FILE *script = fopen(path, "w");
    for (int i = 0; i < d->ntrajectory && data != NULL; ++i) {
        for (int k = 0; k < sample_count(d, i); ++k) {
            fprintf(data, "%.9g", pm_dataset_time(d, i, k) - pm_dataset_time(d, i, 0));
            for (int c = 0; c < d->ncolumn; ++c) {
                fprintf(data, " %.9g", pm_dataset_state(d, i, k)[c]);
            }
            fprintf(data, "\n");
        }
        fprintf(data, "\n");
    }
    if (script != NULL) {
        fprintf(script,
                "set terminal pngcairo size 900,%d font 'DejaVu Sans,10' background 'white'\n"
                "set output 'measured.png'\nset multiplot layout %d,1\nset border 3\n"
                "set tics nomirror out\nset datafile missing 'nan'\n",
                60 + 170 * d->ncolumn, d->ncolumn);
        for (int c = 0; c < d->ncolumn; ++c) {
            const bool known = unit != NULL && *unit[c] != '\0';
            fprintf(script,
                    "set ylabel '%s%s%s'\n%splot 'measured.txt' using 1:%d with lines lw 0.5 "
                    "linecolor '#0072b2' notitle\n",
                    d->column[c], known ? ", " : "", known ? unit[c] : "",
                    c + 1 == d->ncolumn ? "set xlabel 'time, s'\n" : "", c + 2);
        }
        fprintf(script, "unset multiplot\n");
    }
    const bool written = data != NULL && script != NULL && !ferror(data) && !ferror(script);
    const bool data_closed = data == NULL || fclose(data) == 0;
    const bool script_closed = script == NULL || fclose(script) == 0;
    return written && data_closed && script_closed
               ? pm_gnuplot_run(folder, "measured.gp")
               : pm_fail(PM_EFILE, "%s: cannot be written", path);
}

static pm_status describe(const char *file, const char *name, const char *folder) {
    pm_dataset *d = NULL;
    double *work = NULL;
    const char **unit = NULL;
    pm_status status;
    PM_TRY_DONE(pm_dataset_load_measured(&d, file, name));
    PM_TRY_DONE(pm_dataset_units(d, &d->arena, &unit));
    work = malloc(((size_t)d->ntrajectory * (size_t)d->ntime + 1) * sizeof *work);
    if (work == NULL) {
        status = pm_fail(PM_ENOMEM, "inspect: out of memory");
        goto done;
    }
    print_facts(d, unit, file, work);
    status = folder == NULL ? PM_OK : plot(d, unit, folder);
done:
    free(work);
    pm_dataset_free(d);
    return status;
}

pm_status pm_command_inspect(int argc, char **argv, const volatile sig_atomic_t *stop) {
    const char *file = NULL, *name = "z", *folder = NULL;
    bool helped = false;
    const pm_option table[] = {
        {"--data-set", NULL, "NAME", NULL, &name, false, "the dataset in FILE; default: z"},
        {"--plot", NULL, "DIR", NULL, &folder, false,
         "draw all columns over time into DIR (gnuplot)"},
    };
    const pm_options options = {
        .usage = "portmet-train inspect FILE [options]",
        .summary =
            "Describes measurements: the times and their gaps, and for each column its unit,\n"
            "samples, range and noise.",
        .positional_name = "FILE",
        .positional = &file,
        .count = sizeof table / sizeof *table,
        .option = table,
    };
    (void)stop;
    PM_TRY(pm_options_read(&options, argc, argv, &helped));
    if (helped) {
        return PM_OK;
    }
    return describe(file, name, folder);
}
