// Writes the numbers of predictions with bands, and gnuplot scripts that draw them.
#include "command/evaluate_bands.h"

#include <errno.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "evaluate/evaluate_plot.h"
#include "evaluate/evaluate_plot_data.h"
#include "evaluate/gnuplot.h"

#define MOST_DRAWN 4   // trajectories
#define MOST_ROWS 1500 // of a trajectory; more would overlap
#define BINS 12        // of the time, in which coverage is counted
#define ROW_HEIGHT 190 // pixels
#define PER_COLUMN 4   // numbers in a row: measured, predicted, half the band, measured - predicted

typedef struct drawing {
    const pm_estimate *e;
    const pm_observation *o;
    const pm_dataset *data;
    const int *which;
    double seconds, until; // s after the first sample
    const char *folder;
} drawing;

// Time since the first sample of an estimate, NAN after its last one.
static double time_of(const drawing *d, int id, int k) {
    return pm_dataset_time(d->data, d->which[id], k) - pm_dataset_time(d->data, d->which[id], 0);
}

static double measured(const drawing *d, int id, int k, int column) {
    return pm_dataset_state(d->data, d->which[id], k)[d->o->column[column]];
}

// Half the width of the band; 0: there are no bands.
static double half_band(const drawing *d, int id, int k, int column) {
    const ptrdiff_t at = ((ptrdiff_t)id * d->e->ntime + k) * d->e->ny + column;
    return d->e->deviation == NULL ? 0 : PM_NINETY_PER_CENT * d->e->deviation[at];
}

// --- numbers ---

static void write_number(FILE *file, double value) {
    if (isfinite(value)) {
        fprintf(file, " %.9g", value);
    } else {
        fputs(" nan", file);
    }
}

static pm_status write_prediction(const drawing *d, int id) {
    FILE *file;
    char name[64];
    const pm_estimate *e = d->e;
    const int stride = 1 + e->ntime / MOST_ROWS;
    snprintf(name, sizeof name, "prediction_%d.txt", d->which[id]);
    PM_TRY(pm_plot_open(&file, d->folder, name));
    for (int k = 0; k < e->ntime; k += stride) {
        const double t = time_of(d, id, k);
        if (!(t <= d->until)) {
            break;
        }
        fprintf(file, "%.9g", t);
        for (int c = 0; c < e->ny; ++c) {
            const double y = measured(d, id, k, c);
            const double predicted = e->y[((ptrdiff_t)id * e->ntime + k) * e->ny + c];
            write_number(file, y);
            write_number(file, predicted);
            write_number(file, half_band(d, id, k, c));
            write_number(file, y - predicted);
        }
        fputc('\n', file);
    }
    return pm_plot_close(file, d->folder);
}

// The share of measurements inside the bands from `from` to `to` s; NAN: there are none.
static double share_inside(const drawing *d, int column, double from, double to) {
    long inside = 0, all = 0;
    for (int i = 0; i < d->e->count; ++i) {
        for (int k = 0; k < d->e->ntime; ++k) {
            const double t = time_of(d, i, k), y = measured(d, i, k, column);
            const ptrdiff_t at = ((ptrdiff_t)i * d->e->ntime + k) * d->e->ny + column;
            if (t > from && t <= to && isfinite(y)) {
                inside += fabs(d->e->y[at] - y) <= half_band(d, i, k, column);
                ++all;
            }
        }
    }
    return all > 0 ? (double)inside / (double)all : NAN;
}

static pm_status write_coverage(const drawing *d) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, d->folder, "coverage.txt"));
    const double width = (d->until - d->seconds) / BINS;
    for (int b = 0; b < BINS; ++b) {
        const double from = d->seconds + b * width;
        fprintf(file, "%.9g", from + width / 2);
        for (int c = 0; c < d->e->ny; ++c) {
            write_number(file, 100 * share_inside(d, c, from, from + width));
        }
        fputc('\n', file);
    }
    return pm_plot_close(file, d->folder);
}

// --- scripts ---

// Writes the panel of one column: the column itself, or measurement minus prediction.
static void write_panel(const drawing *d, FILE *file, int id, int column, bool difference) {
    const int first = 2 + PER_COLUMN * column, band = first + 2;
    const int last = column + 1 == d->e->ny;
    fprintf(file, "set xlabel '%s'\nset ylabel \"%s%s%s%s\" noenhanced\nplot ",
            last ? "time, s" : "", d->o->name[column], difference ? ": difference" : "",
            d->o->unit[column] == NULL ? "" : ", ",
            d->o->unit[column] == NULL ? "" : d->o->unit[column]);
    char centre[16] = "0";
    if (!difference) {
        snprintf(centre, sizeof centre, "$%d", first + 1);
    }
    if (d->e->deviation != NULL) {
        fprintf(
            file,
            "'prediction_%d.txt' using 1:(%s-$%d):(%s+$%d) with filledcurves fillcolor '#a6cee3' "
            "title 'band of 90 %%', ",
            d->which[id], centre, band, centre, band);
    }
    fprintf(file,
            "'prediction_%d.txt' using 1:%d with points pointtype 7 pointsize 0.25 linecolor "
            "'#222222' title 'measured', '' using 1:(%s) with lines linewidth 1.4 linecolor '%s' "
            "title 'predicted'\n",
            d->which[id], difference ? first + 3 : first, centre, pm_plot_colour(0));
}

static pm_status script_prediction(const drawing *d, int id) {
    FILE *file;
    char name[64];
    snprintf(name, sizeof name, "prediction_%d", d->which[id]);
    PM_TRY(pm_plot_open_script(&file, d->folder, name, 1100, 80 + ROW_HEIGHT * d->e->ny));
    fprintf(
        file,
        "set multiplot layout %d,2 title 'Trajectory %d'\n"
        "set key at screen 0.98, screen 0.99 right top horizontal font ',10' samplen 1.2 width -1\n"
        "set lmargin 12\nset rmargin 2\nset xrange [0:%.9g]\n"
        "set arrow from %.9g, graph 0 to %.9g, graph 1 nohead dashtype 3 linecolor '#555555'\n",
        d->e->ny, d->which[id], d->until, d->seconds, d->seconds);
    for (int c = 0; c < d->e->ny; ++c) {
        write_panel(d, file, id, c, false);
        fputs("unset key\n", file);
        write_panel(d, file, id, c, true);
    }
    PM_TRY(pm_plot_close(file, d->folder));
    strcat(name, ".gp");
    return pm_gnuplot_run(d->folder, name);
}

static pm_status script_coverage(const drawing *d) {
    FILE *file;
    PM_TRY(pm_plot_open_script(&file, d->folder, "coverage", 800, 420));
    fprintf(file,
            "set xlabel 'time, s'\nset ylabel 'measurements inside bands of 90 %%, %%'\n"
            "set xrange [0:%.9g]\nset yrange [0:100]\nset key outside right top noenhanced\n"
            "plot 90 with lines dashtype 3 linecolor '#555555' notitle",
            d->until);
    for (int c = 0; c < d->e->ny; ++c) {
        fprintf(
            file,
            ", 'coverage.txt' using 1:%d with linespoints pointtype 7 linecolor '%s' title '%s'",
            2 + c, pm_plot_colour(c), d->o->name[c]);
    }
    fputc('\n', file);
    PM_TRY(pm_plot_close(file, d->folder));
    return pm_gnuplot_run(d->folder, "coverage.gp");
}

// Returns the time of the last sample of any trajectory that is scored.
static double last_time(const drawing *d) {
    double last = 0;
    for (int i = 0; i < d->e->count; ++i) {
        for (int k = 0; k < d->e->ntime; ++k) {
            last = fmax(last, time_of(d, i, k)); // fmax ignores NAN
        }
    }
    return fmin(last, d->e->until);
}

pm_status pm_evaluate_bands_draw(const pm_estimate *e, const pm_observation *o,
                                 const pm_dataset *data, const int *which, double seconds,
                                 const char *folder) {
    drawing d = {
        .e = e, .o = o, .data = data, .which = which, .seconds = seconds, .folder = folder};
    d.until = last_time(&d);
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
    }
    for (int i = 0; i < e->count && i < MOST_DRAWN; ++i) {
        PM_TRY(write_prediction(&d, i));
        PM_TRY(script_prediction(&d, i));
    }
    if (e->deviation == NULL) {
        return PM_OK;
    }
    PM_TRY(write_coverage(&d));
    return script_coverage(&d);
}
