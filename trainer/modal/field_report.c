// Prints and draws errors, with the trajectories that training saw apart from the others.
#include "modal/field_report.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "evaluate/gnuplot.h"
#include "sim/score.h"

static const char *const names[PM_FIELD_NERROR] = {"displacement", "velocity", "stress"};

// --- the table ---

static int count_of(const pm_field_report *r, bool trained) {
    int count = 0;
    for (int i = 0; i < r->count; ++i) {
        count += r->trained[i] == trained;
    }
    return count;
}

static void print_part(const pm_field_report *r, bool trained, double *column) {
    const int count = count_of(r, trained);
    if (count == 0) {
        return;
    }
    printf("%-21s %9s %9s %9s %9s %9s %9s\n", trained ? "Trained on, %" : "Relative L2 error, %",
           "whisker", "quartile", "median", "quartile", "whisker", "mean");
    for (int e = 0; e < PM_FIELD_NERROR; ++e) {
        int at = 0;
        for (int i = 0; i < r->count; ++i) {
            if (r->trained[i] == trained) {
                column[at++] = r->error[i * PM_FIELD_NERROR + e];
            }
        }
        const pm_box b = pm_box_of(count, column);
        printf("  %-20s %9.3g %9.3g %9.3g %9.3g %9.3g %9.3g\n", names[e], 100 * b.low,
               100 * b.first_quartile, 100 * b.median, 100 * b.third_quartile, 100 * b.high,
               100 * b.mean);
    }
}

pm_status pm_field_report_print(const pm_field_report *report) {
    double *column = calloc((size_t)report->count + 1, sizeof *column);
    if (column == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for errors");
    }
    print_part(report, false, column);
    print_part(report, true, column);
    free(column);
    return PM_OK;
}

// --- the picture ---

static pm_status write_file(const char *folder, const char *name, FILE **file) {
    char path[1024];
    if (snprintf(path, sizeof path, "%s/%s", folder, name) >= (int)sizeof path) {
        return pm_fail(PM_EFILE, "%s: the name is too long", folder);
    }
    *file = fopen(path, "w");
    return *file == NULL ? pm_fail(PM_EFILE, "%s: %s", path, strerror(errno)) : PM_OK;
}

static pm_status close_file(FILE *file, const char *folder) {
    const bool failed = ferror(file) != 0;
    return fclose(file) != 0 || failed ? pm_fail(PM_EFILE, "%s: cannot be written", folder) : PM_OK;
}

// Writes the errors in %, one row for each trajectory that training saw, or did not see.
static pm_status write_numbers(const pm_field_report *r, const char *folder, bool trained) {
    FILE *file;
    PM_TRY(write_file(folder, trained ? "trained.txt" : "test.txt", &file));
    for (int i = 0; i < r->count; ++i) {
        const double *error = r->error + (ptrdiff_t)i * PM_FIELD_NERROR;
        if (r->trained[i] == trained) {
            fprintf(file, "%.6g %.6g %.6g\n", 100 * error[0], 100 * error[1], 100 * error[2]);
        }
    }
    return close_file(file, folder);
}

static void write_boxes(FILE *file, const char *data, double shift, double opacity) {
    static const char *const colours[PM_FIELD_NERROR] = {"#0072b2", "#d55e00", "#009e73"};
    for (int e = 0; e < PM_FIELD_NERROR; ++e) {
        fprintf(file,
                "%s'%s' using (%g):%d pointtype 7 pointsize 0.3 linewidth 1.2 linecolor '%s' "
                "fillstyle solid %g",
                e > 0 ? ", " : "", data, e + 1 + shift, e + 1, colours[e], opacity);
    }
}

static pm_status write_script(const pm_field_report *r, const char *folder) {
    const int trained = count_of(r, true), test = count_of(r, false);
    const bool both = trained > 0 && test > 0;
    FILE *file;
    PM_TRY(write_file(folder, "errors.gp", &file));
    fprintf(file,
            "set terminal pngcairo size 600,450 font 'DejaVu Sans,11' background 'white'\n"
            "set output 'errors.png'\nset border 3 linecolor '#555555'\n"
            "set tics nomirror out\nset grid noxtics ytics linecolor '#e4e4e4'\n"
            "set style data boxplot\nset key noautotitle\nset logscale y\n"
            "set ylabel 'relative L_2 error, %%'\nset xrange [0.4:3.6]\nset boxwidth %g\n"
            "set xtics scale 0 ('%s' 1, '%s' 2, '%s, free nodes' 3)\n"
            "set title 'per trajectory: train (%d, pale), test (%d)'\nplot ",
            both ? 0.3 : 0.5, names[0], names[1], names[2], trained, test);
    if (trained > 0) {
        write_boxes(file, "trained.txt", both ? -0.18 : 0, 0.1);
    }
    fputs(both ? ", " : "", file);
    if (test > 0) {
        write_boxes(file, "test.txt", both ? 0.18 : 0, 0.5);
    }
    fputc('\n', file);
    return close_file(file, folder);
}

pm_status pm_field_report_plot(const pm_field_report *report, const char *folder) {
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
    }
    PM_TRY(write_numbers(report, folder, true));
    PM_TRY(write_numbers(report, folder, false));
    PM_TRY(write_script(report, folder));
    return pm_gnuplot_run(folder, "errors.gp");
}
