// Writes the numbers of an evaluation as text columns, one gnuplot script for each picture of them,
// and runs gnuplot on the scripts.
#include "evaluate/evaluate_plot.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "evaluate/gnuplot.h"

// Errors that a logarithmic axis cannot show are moved to the ends of its range, in per cent.
#define SMALLEST 1e-12
#define LARGEST 1e3
// The most points of a true trajectory; more would overlap.
#define MOST_POINTS 250

// The columns that describe a distribution over the rollouts.
enum {
    LOW,    // smallest
    FIRST,  // first quartile
    MEDIAN, // median
    THIRD,  // third quartile
    HIGH,   // largest
    SPREAD  // the number of these columns
};

static double per_cent(double error) {
    return fmin(fmax(100 * error, SMALLEST), LARGEST);
}

static pm_status write_errors(const pm_evaluation *e, const char *folder, const char *name,
                              bool snapshots) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, name));
    const int ngroup = e->columns.ngroup;
    for (int i = 0; i < e->count; ++i) {
        const pm_rollout *r = &e->rollout[i];
        for (int j = snapshots ? 1 : 0; j < (snapshots ? r->length : 1); ++j) {
            fprintf(file, "%d %.9g", r->trajectory, e->truth->t[j]);
            for (int g = 0; g < ngroup; ++g) {
                fprintf(file, " %.9g",
                        per_cent(snapshots ? r->snapshot[j * ngroup + g] : r->error[g]));
            }
            fputc('\n', file);
        }
    }
    return pm_plot_close(file, folder);
}

// Sorts the values of all rollouts and writes the columns of their distribution.
static void write_spread(FILE *file, int count, double *value) {
    const pm_box box = pm_box_of(count, value);
    fprintf(file, " %.9g %.9g %.9g %.9g %.9g", value[0], box.first_quartile, box.median,
            box.third_quartile, value[count - 1]);
}

static void write_log_axis(FILE *file, const char *label) {
    fprintf(file, "set logscale y\nunset mytics\nset format y '10^{%%L}'\nset ylabel '%s'\n",
            label);
}

// Draws a box for each group, shifted by `shift` from the position of the group.
static void write_boxes(FILE *file, const pm_evaluation *e, const char *data, double shift,
                        double opacity) {
    for (int g = 0; g < e->columns.ngroup; ++g) {
        fprintf(file,
                "%s'%s' using (%g):%d pointtype 7 pointsize 0.3 linewidth 1.2 linecolor '%s' "
                "fillstyle solid %g",
                g > 0 ? ", " : "", data, g + 1 + shift, g + 3, pm_plot_colour(g), opacity);
    }
}

// Draws one panel for trajectories and one for snapshots.
static pm_status draw_errors(const pm_evaluation *e, const pm_evaluation *trained,
                             const char *folder) {
    PM_TRY(write_errors(e, folder, "trajectories.txt", false));
    PM_TRY(write_errors(e, folder, "snapshots.txt", true));
    if (trained != NULL) {
        PM_TRY(write_errors(trained, folder, "trained_trajectories.txt", false));
        PM_TRY(write_errors(trained, folder, "trained_snapshots.txt", true));
    }
    FILE *file;
    PM_TRY(pm_plot_open_script(&file, folder, "errors", 900, 450));
    fprintf(file, "set multiplot layout 1,2\n"
                  "set style data boxplot\n"
                  "set grid noxtics ytics\n"
                  "set xtics scale 0 (");
    for (int g = 0; g < e->columns.ngroup; ++g) {
        fprintf(file, "%s'%s' %d", g > 0 ? ", " : "", e->columns.group_name[g], g + 1);
    }
    fprintf(file, ")\nset xrange [0.4:%d.6]\nset boxwidth %g\n", e->columns.ngroup,
            trained != NULL ? 0.3 : 0.5);
    write_log_axis(file, "relative L_2 error, %");
    for (int k = 0; k < 2; ++k) {
        const int states = k == 0 ? 1 : e->truth->ntime - 1;
        const char *word = k == 0 ? "trajectory" : "snapshot";
        const char *data = k == 0 ? "trajectories.txt" : "snapshots.txt";
        if (trained == NULL) {
            fprintf(file, "set title 'per %s (%d)'\nplot ", word, e->count * states);
            write_boxes(file, e, data, 0, 0.35);
        } else {
            char seen[64];
            snprintf(seen, sizeof seen, "trained_%s", data);
            fprintf(file, "set title 'per %s: train (%d, pale), test (%d)'\nplot ", word,
                    trained->count * states, e->count * states);
            write_boxes(file, trained, seen, -0.18, 0.1);
            fputs(", ", file);
            write_boxes(file, e, data, 0.18, 0.5);
        }
        fputc('\n', file);
    }
    return pm_plot_close(file, folder);
}

// Draws predictions as lines and true states as points, in one panel for each group.
static pm_status draw_states(const pm_evaluation *e, const char *folder) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, "states.txt"));
    for (int j = 0; j < e->rollout[0].length; ++j) {
        const double *row[2] = {pm_dataset_state(e->truth, e->rollout[0].trajectory, j),
                                pm_dataset_state(e->predicted, 0, j)};
        fprintf(file, "%.9g", e->truth->t[j]);
        for (int i = 0; i < 2 * e->columns.nz; ++i) {
            const int column = e->columns.column[i % e->columns.nz];
            fprintf(file, " %.9g", column < 0 ? 0 : row[i / e->columns.nz][column]);
        }
        fputc('\n', file);
    }
    PM_TRY(pm_plot_close(file, folder));
    const pm_columns *c = &e->columns;
    const int every = e->truth->ntime / MOST_POINTS + 1;
    PM_TRY(pm_plot_open_script(&file, folder, "trajectory", 1000, 50 + 250 * c->ngroup));
    fprintf(file,
            "set multiplot layout %d,1 title 'Trajectory %d: predicted (lines), true (points)'\n"
            "set key outside right top\n"
            "set lmargin 11\n"
            "set rmargin 10\n"
            "set xrange [%.9g:%.9g]\n",
            c->ngroup, e->rollout[0].trajectory, e->truth->t[0], e->truth->t[e->truth->ntime - 1]);
    for (int g = 0; g < c->ngroup; ++g) {
        const pm_scene *scene = e->system->scene;
        const pm_group *group = NULL; // the first group with this name in any subsystem
        for (int i = 0; i < scene->physics.nsubsystem && group == NULL; ++i) {
            group = pm_layout_find(&scene->physics.subsystem[i].layout, c->group_name[g]);
        }
        fprintf(file, "set ylabel '%s, %s'\nset xlabel '%s'\nplot ", c->group_name[g],
                group == NULL ? "" : group->unit, g + 1 < c->ngroup ? "" : "time, s");
        int count = 0;
        for (int i = 0; i < c->nz; ++i) {
            if (c->group[i] == g) {
                const char *colour = pm_plot_colour(count++);
                fprintf(file,
                        "%s'states.txt' every %d using 1:%d with points pointtype 7 pointsize 0.45 "
                        "linecolor '%s', '' using 1:%d with lines linewidth 1.2 linecolor '%s' "
                        "title '%s'",
                        count > 1 ? ", " : "", every, i + 2, colour, c->nz + i + 2, colour,
                        e->truth->column[c->column[i]]);
            }
        }
        fputc('\n', file);
    }
    return pm_plot_close(file, folder);
}

// Draws the median as a line and the range between the quartiles as a band; with `extremes` also
// the range from smallest to largest as a lighter band. `first` is the column of the smallest.
static void write_band(FILE *file, const char *data, int first, const char *colour, bool extremes) {
    if (extremes) {
        fprintf(file,
                "'%s' using 1:%d:%d with filledcurves fillcolor '%s' fillstyle transparent solid "
                "0.12 noborder title 'smallest to largest', ",
                data, first + LOW, first + HIGH, colour);
    }
    fprintf(file,
            "'%s' using 1:%d:%d with filledcurves fillcolor '%s' fillstyle transparent solid 0.3 "
            "noborder title 'quartiles', '' using 1:%d with lines linewidth 1.6 linecolor '%s' "
            "title 'median'\n",
            data, first + FIRST, first + THIRD, colour, first + MEDIAN, colour);
}

static void write_time_axis(FILE *file, const pm_evaluation *e) {
    fprintf(file, "set xlabel 'time, s'\nset xrange [0:%.9g]\n",
            e->truth->t[e->truth->ntime - 1] - e->truth->t[0]);
}

// Draws the errors of states over time; value [count] is work space.
static pm_status draw_growth(const pm_evaluation *e, const char *folder, double *value) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, "growth.txt"));
    const int ngroup = e->columns.ngroup;
    for (int j = 1; j < e->truth->ntime; ++j) {
        fprintf(file, "%.9g", e->truth->t[j] - e->truth->t[0]);
        for (int g = 0; g < ngroup; ++g) {
            int count = 0;
            for (int i = 0; i < e->count; ++i) {
                if (j < e->rollout[i].length) {
                    value[count++] = per_cent(e->rollout[i].snapshot[j * ngroup + g]);
                }
            }
            if (count > 0) {
                write_spread(file, count, value);
            }
        }
        fputc('\n', file);
    }
    PM_TRY(pm_plot_close(file, folder));
    PM_TRY(pm_plot_open_script(&file, folder, "growth", 1000, 60 + 250 * ngroup));
    fprintf(file,
            "set multiplot layout %d,1 title 'Error growth over %d trajectories'\n"
            "set key outside right top\nset lmargin 11\nset rmargin 15\n",
            ngroup, e->count);
    write_time_axis(file, e);
    for (int g = 0; g < ngroup; ++g) {
        char label[128];
        snprintf(label, sizeof label, "relative error of %s, %%", e->columns.group_name[g]);
        write_log_axis(file, label);
        fprintf(file, "set xlabel '%s'\n%splot ", g + 1 < ngroup ? "" : "time, s",
                g == 1 ? "set key off\n" : "");
        write_band(file, "growth.txt", 2 + SPREAD * g, pm_plot_colour(g), false);
    }
    return pm_plot_close(file, folder);
}

// Draws energy and entropy over time; value [count] is work space. At each time, rollouts that are
// no longer finite are left out.
static pm_status draw_laws(const pm_evaluation *e, const char *folder, double *value) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, "laws.txt"));
    for (int j = 1; j < e->truth->ntime; ++j) {
        for (int k = 0; k < 2; ++k) {
            int count = 0;
            for (int i = 0; i < e->count; ++i) {
                const pm_rollout *r = &e->rollout[i];
                const double *total = k == 0 ? r->energy : r->entropy;
                const double change = total[j] - total[0];
                if (j < r->reached) {
                    value[count++] = k == 0 ? fmax(fabs(change), SMALLEST) : change;
                }
            }
            if (count == 0) {
                continue;
            }
            if (k == 0) {
                fprintf(file, "%.9g", e->truth->t[j] - e->truth->t[0]);
            }
            write_spread(file, count, value);
        }
        fputc('\n', file);
    }
    PM_TRY(pm_plot_close(file, folder));
    PM_TRY(pm_plot_open_script(&file, folder, "laws", 1000, 640));
    fprintf(file,
            "set multiplot layout 2,1 title 'Both laws over %d trajectories'\n"
            "set key outside right top\nset lmargin 13\nset rmargin 24\n",
            e->count);
    write_time_axis(file, e);
    fputs("set xlabel ''\nset title 'drift of the total energy'\n", file);
    write_log_axis(file, "|E(t) - E(0)|, J");
    fputs("plot ", file);
    write_band(file, "laws.txt", 2, pm_plot_colour(0), true);
    fputs("unset logscale y\nset format y '%g'\nset xlabel 'time, s'\nset key off\n"
          "set title 'change of the total entropy'\nset ylabel 'S(t) - S(0), J/K'\nplot ",
          file);
    write_band(file, "laws.txt", 2 + SPREAD, pm_plot_colour(2), true);
    return pm_plot_close(file, folder);
}

pm_status pm_evaluation_plot(const pm_evaluation *e, const pm_evaluation *trained,
                             const char *folder) {
    const bool laws = pm_system_without_energy(e->system) < 0;
    PM_TRY(pm_plot_folder(folder));
    double *value = calloc((size_t)e->count, sizeof *value);
    if (value == NULL) {
        return pm_fail(PM_ENOMEM, "plot: out of memory");
    }
    pm_status status;
    PM_TRY_DONE(draw_errors(e, trained, folder));
    PM_TRY_DONE(draw_states(e, folder));
    PM_TRY_DONE(draw_growth(e, folder, value));
    if (laws) {
        PM_TRY_DONE(draw_laws(e, folder, value));
    }
    PM_TRY_DONE(pm_gnuplot_run(folder, "errors.gp"));
    PM_TRY_DONE(pm_gnuplot_run(folder, "trajectory.gp"));
    PM_TRY_DONE(pm_gnuplot_run(folder, "growth.gp"));
    if (laws) {
        PM_TRY_DONE(pm_gnuplot_run(folder, "laws.gp"));
    }
done:
    free(value);
    return status;
}
