// Writes one gnuplot script for each picture of an evaluation, and runs gnuplot on them.
#include "evaluate/evaluate_plot.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>

#include "evaluate/evaluate_plot_data.h"
#include "evaluate/gnuplot.h"

// The colours of Okabe and Ito, which remain distinguishable with colour blindness.
static const char *const colours[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                      "#e69f00", "#56b4e9", "#666666"};

const char *pm_plot_colour(int i) {
    return colours[i % (int)(sizeof colours / sizeof *colours)];
}

// The most points of a true trajectory; more would overlap.
#define MOST_POINTS 250

// --- scripts ---

pm_status pm_plot_open_script(FILE **file, const char *folder, const char *name, int width,
                              int height) {
    char path[64];
    snprintf(path, sizeof path, "%s.gp", name);
    PM_TRY(pm_plot_open(file, folder, path));
    fprintf(*file,
            "set terminal pngcairo size %d,%d font 'DejaVu Sans,11' background 'white'\n"
            "set output '%s.png'\n"
            "set border 3 linecolor '#555555'\n"
            "set tics nomirror out textcolor '#222222'\n"
            "set grid linetype 1 linecolor '#e4e4e4'\n"
            "set key noautotitle samplen 2 spacing 1.1\n",
            width, height, name);
    return PM_OK;
}

// Returns the unit of the first group with this name in any subsystem.
static const char *unit_of(const pm_scene *scene, const char *group) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_group *found = pm_layout_find(&scene->subsystem[i].layout, group);
        if (found != NULL) {
            return found->unit;
        }
    }
    return "";
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

static pm_status script_errors(const pm_evaluation *e, const pm_evaluation *trained,
                               const char *folder) {
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
static pm_status script_states(const pm_evaluation *e, const char *folder) {
    FILE *file;
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
        fprintf(file, "set ylabel '%s, %s'\nset xlabel '%s'\nplot ", c->group_name[g],
                unit_of(e->system->scene, c->group_name[g]), g + 1 < c->ngroup ? "" : "time, s");
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
                data, first + PM_PLOT_LOW, first + PM_PLOT_HIGH, colour);
    }
    fprintf(file,
            "'%s' using 1:%d:%d with filledcurves fillcolor '%s' fillstyle transparent solid 0.3 "
            "noborder title 'quartiles', '' using 1:%d with lines linewidth 1.6 linecolor '%s' "
            "title 'median'\n",
            data, first + PM_PLOT_FIRST, first + PM_PLOT_THIRD, colour, first + PM_PLOT_MEDIAN,
            colour);
}

static void write_time_axis(FILE *file, const pm_evaluation *e) {
    fprintf(file, "set xlabel 'time, s'\nset xrange [0:%.9g]\n",
            e->truth->t[e->truth->ntime - 1] - e->truth->t[0]);
}

static pm_status script_growth(const pm_evaluation *e, const char *folder) {
    FILE *file;
    const int ngroup = e->columns.ngroup;
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
        write_band(file, "growth.txt", 2 + PM_PLOT_SPREAD * g, pm_plot_colour(g), false);
    }
    return pm_plot_close(file, folder);
}

static pm_status script_laws(const pm_evaluation *e, const char *folder) {
    FILE *file;
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
    write_band(file, "laws.txt", 2 + PM_PLOT_SPREAD, pm_plot_colour(2), true);
    return pm_plot_close(file, folder);
}

// --- all pictures ---

pm_status pm_evaluation_plot(const pm_evaluation *e, const pm_evaluation *trained,
                             const char *folder) {
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
    }
    PM_TRY(pm_plot_write_data(e, trained, folder));
    PM_TRY(script_errors(e, trained, folder));
    PM_TRY(script_states(e, folder));
    PM_TRY(script_growth(e, folder));
    PM_TRY(pm_gnuplot_run(folder, "errors.gp"));
    PM_TRY(pm_gnuplot_run(folder, "trajectory.gp"));
    PM_TRY(pm_gnuplot_run(folder, "growth.gp"));
    if (pm_system_without_energy(e->system) >= 0) {
        return PM_OK;
    }
    PM_TRY(script_laws(e, folder));
    return pm_gnuplot_run(folder, "laws.gp");
}
