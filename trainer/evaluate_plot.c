// Data files, gnuplot scripts, and gnuplot run on them inside the folder.
#include "evaluate_plot.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

static pm_status open_file(FILE **file, const char *folder, const char *name) {
    char path[4096];
    if ((size_t)snprintf(path, sizeof path, "%s/%s", folder, name) >= sizeof path) {
        return pm_fail(PM_EFILE, "%s: the path is too long", folder);
    }
    *file = fopen(path, "w");
    return *file != NULL ? PM_OK : pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
}

static pm_status close_file(FILE *file, const char *folder) {
    const int failed = ferror(file);
    return fclose(file) == 0 && !failed ? PM_OK : pm_fail(PM_EFILE, "%s: cannot write", folder);
}

// --- data ---

// Per cent. The logarithmic axis has no place for 0 and infinity; these stand for them.
static double plotted(double error) {
    return fmin(fmax(100 * error, 1e-12), 1e3);
}

// A row per trajectory, or per state: the errors of all groups.
static pm_status write_errors(const pm_evaluation *e, const char *folder, bool snapshots) {
    FILE *file;
    PM_TRY(open_file(&file, folder, snapshots ? "snapshots.txt" : "trajectories.txt"));
    const int ngroup = e->columns.ngroup;
    for (int i = 0; i < e->count; ++i) {
        const pm_rollout *r = &e->rollout[i];
        for (int j = snapshots ? 1 : 0; j < (snapshots ? e->truth->ntime : 1); ++j) {
            fprintf(file, "%d %.9g", r->trajectory, e->truth->t[j]);
            for (int g = 0; g < ngroup; ++g) {
                fprintf(file, " %.9g",
                        plotted(snapshots ? r->snapshot[j * ngroup + g] : r->error[g]));
            }
            fputc('\n', file);
        }
    }
    return close_file(file, folder);
}

// A row per time: all components of the truth, then all of the prediction, of the first rollout.
static pm_status write_states(const pm_evaluation *e, const char *folder) {
    FILE *file;
    PM_TRY(open_file(&file, folder, "states.txt"));
    for (int j = 0; j < e->truth->ntime; ++j) {
        const double *row[2] = {pm_dataset_state(e->truth, e->rollout[0].trajectory, j),
                                pm_dataset_state(e->predicted, 0, j)};
        fprintf(file, "%.9g", e->truth->t[j]);
        for (int k = 0; k < 2; ++k) {
            for (int i = 0; i < e->columns.nz; ++i) {
                fprintf(file, " %.9g", row[k][e->columns.column[i]]);
            }
        }
        fputc('\n', file);
    }
    return close_file(file, folder);
}

// --- scripts ---

static pm_status script_errors(const pm_evaluation *e, const char *folder) {
    FILE *file;
    PM_TRY(open_file(&file, folder, "errors.gp"));
    fprintf(file, "set terminal png size 900,450\n"
                  "set output 'errors.png'\n"
                  "set multiplot layout 1,2\n"
                  "set style fill solid 0.3 border -1\n"
                  "set style data boxplot\n"
                  "set boxwidth 0.5\n"
                  "set logscale y\n"
                  "set format y '%%g'\n"
                  "set grid y\n"
                  "set ylabel 'relative L2 error, %%'\n"
                  "unset key\n"
                  "set xtics (");
    for (int g = 0; g < e->columns.ngroup; ++g) {
        fprintf(file, "%s'%s' %d", g > 0 ? ", " : "", e->columns.group_name[g], g + 1);
    }
    fprintf(file, ")\nset xrange [0.4:%d.6]\n", e->columns.ngroup);
    for (int k = 0; k < 2; ++k) {
        const char *what = k == 0 ? "trajectory" : "snapshot";
        const char *data = k == 0 ? "trajectories.txt" : "snapshots.txt";
        fprintf(file, "set title 'per %s'\nplot ", what);
        for (int g = 0; g < e->columns.ngroup; ++g) {
            fprintf(file, "%s'%s' using (%d):%d pointtype 7 pointsize 0.4", g > 0 ? ", " : "", data,
                    g + 1, g + 3);
        }
        fputc('\n', file);
    }
    return close_file(file, folder);
}

// The unit of a group, wherever it is.
static const char *unit_of(const pm_scene *scene, const char *group) {
    for (int i = 0; i < scene->nsubsystem; ++i) {
        const pm_group *found = pm_layout_find(&scene->subsystem[i].layout, group);
        if (found != NULL) {
            return found->unit;
        }
    }
    return "";
}

static pm_status script_states(const pm_evaluation *e, const char *folder) {
    FILE *file;
    PM_TRY(open_file(&file, folder, "trajectory.gp"));
    const pm_columns *c = &e->columns;
    fprintf(file,
            "set terminal png size 900,%d\n"
            "set output 'trajectory.png'\n"
            "set multiplot layout %d,1 title 'trajectory %d: predicted (lines), true (points)'\n"
            "set key outside right\n"
            "set lmargin 12\n"
            "set grid\n",
            60 + 260 * c->ngroup, c->ngroup, e->rollout[0].trajectory);
    for (int g = 0; g < c->ngroup; ++g) {
        fprintf(file, "set ylabel '%s, %s'\nset xlabel '%s'\nplot ", c->group_name[g],
                unit_of(e->system->scene, c->group_name[g]), g + 1 < c->ngroup ? "" : "time, s");
        int colour = 0;
        for (int i = 0; i < c->nz; ++i) {
            if (c->group[i] == g) {
                ++colour;
                fprintf(file,
                        "%s'states.txt' using 1:%d with points pointtype 7 pointsize 0.4 "
                        "linecolor %d notitle, '' using 1:%d with lines linecolor %d title '%s'",
                        colour > 1 ? ", " : "", i + 2, colour, c->nz + i + 2, colour,
                        e->truth->column[c->column[i]]);
            }
        }
        fputc('\n', file);
    }
    return close_file(file, folder);
}

// --- gnuplot ---

static pm_status run_gnuplot(const char *folder, const char *script) {
    const pid_t child = fork();
    if (child == 0) {
        if (chdir(folder) == 0) {
            execlp("gnuplot", "gnuplot", script, (char *)NULL);
        }
        _exit(127);
    }
    int code = 0;
    pid_t ended;
    do {
        ended = waitpid(child, &code, 0);
    } while (ended < 0 && errno == EINTR);
    if (child < 0 || ended < 0) {
        return pm_fail(PM_EFILE, "gnuplot: %s", strerror(errno));
    }
    if (WIFEXITED(code) && WEXITSTATUS(code) == 127) {
        return pm_fail(PM_EFILE, "gnuplot is not installed (Debian: gnuplot-nox); %s/%s is written",
                       folder, script);
    }
    return code == 0 ? PM_OK : pm_fail(PM_EFILE, "gnuplot failed on %s/%s", folder, script);
}

pm_status pm_evaluation_plot(const pm_evaluation *e, const char *folder) {
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
    }
    PM_TRY(write_errors(e, folder, false));
    PM_TRY(write_errors(e, folder, true));
    PM_TRY(write_states(e, folder));
    PM_TRY(script_errors(e, folder));
    PM_TRY(script_states(e, folder));
    PM_TRY(run_gnuplot(folder, "errors.gp"));
    return run_gnuplot(folder, "trajectory.gp");
}
