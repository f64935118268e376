// Writes the errors and the script that draws them.
#include "body/solid_plot.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "evaluate/evaluate_plot.h"
#include "evaluate/evaluate_plot_data.h"
#include "evaluate/gnuplot.h"

static const char *const names[PM_SOLID_NSCORE] = {"displacement", "stress", "stored",
                                                   "dissipated"};

static pm_status write_numbers(int nscore, int count, const pm_solid_response *response,
                               const char *folder) {
    FILE *file;
    PM_TRY(pm_plot_open(&file, folder, "errors.txt"));
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < nscore; ++k) {
            fprintf(file, "%.6g%s", 100 * response[i].error[k], k + 1 < nscore ? " " : "\n");
        }
    }
    return pm_plot_close(file, folder);
}

static pm_status write_script(int nscore, int count, const char *folder) {
    FILE *file;
    PM_TRY(pm_plot_open_script(&file, folder, "errors", 600, 450));
    fprintf(file,
            "set style data boxplot\nset key noautotitle\nset logscale y\nset boxwidth 0.5\n"
            "set ylabel 'relative L_2 error, %%'\nset xrange [0.4:%g]\n"
            "set title 'per trajectory, %d of them'\nset xtics scale 0 (",
            nscore + 0.6, count);
    for (int k = 0; k < nscore; ++k) {
        fprintf(file, "%s'%s' %d", k > 0 ? ", " : "", names[k], k + 1);
    }
    fputs(")\nplot ", file);
    for (int k = 0; k < nscore; ++k) {
        fprintf(
            file,
            "%s'errors.txt' using (%d):%d pointtype 7 pointsize 0.3 linewidth 1.2 linecolor '%s' "
            "fillstyle solid 0.5",
            k > 0 ? ", " : "", k + 1, k + 1, pm_plot_colour(k));
    }
    fputc('\n', file);
    return pm_plot_close(file, folder);
}

pm_status pm_solid_plot(int nscore, int count, const pm_solid_response *response,
                        const char *folder) {
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
    }
    PM_TRY(write_numbers(nscore, count, response, folder));
    PM_TRY(write_script(nscore, count, folder));
    return pm_gnuplot_run(folder, "errors.gp");
}
