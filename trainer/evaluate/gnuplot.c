// Runs gnuplot as a child process.
#include "evaluate/gnuplot.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/child.h"
#include "base/files.h"

#define NO_PROGRAM 127 // the exit code of a child that could not start gnuplot

pm_status pm_plot_folder(const char *folder) {
    return mkdir(folder, 0777) == 0 || errno == EEXIST
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
}

pm_status pm_plot_open(FILE **file, const char *folder, const char *name) {
    char path[4096];
    if ((size_t)snprintf(path, sizeof path, "%s/%s", folder, name) >= sizeof path) {
        return pm_fail(PM_EFILE, "%s: the path is too long", folder);
    }
    return pm_files_create(file, path);
}

pm_status pm_plot_close(FILE *file, const char *folder) {
    const int failed = ferror(file);
    return fclose(file) == 0 && !failed ? PM_OK : pm_fail(PM_EFILE, "%s: cannot write", folder);
}

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

// The colours of Okabe and Ito, which remain distinguishable with colour blindness.
static const char *const colours[] = {"#0072b2", "#d55e00", "#009e73", "#cc79a7",
                                      "#e69f00", "#56b4e9", "#666666"};

const char *pm_plot_colour(int i) {
    return colours[i % (int)(sizeof colours / sizeof *colours)];
}

pm_status pm_gnuplot_run(const char *folder, const char *script) {
    const pid_t child = fork();
    if (child == 0) {
        if (chdir(folder) == 0) {
            execlp("gnuplot", "gnuplot", script, (char *)NULL);
        }
        _exit(NO_PROGRAM);
    }
    int code = 0;
    const int error = pm_child_wait(child, &code);
    if (error != 0) {
        return pm_fail(PM_EFILE, "gnuplot: %s", strerror(error));
    }
    if (WIFEXITED(code) && WEXITSTATUS(code) == NO_PROGRAM) {
        return pm_fail(PM_EFILE, "gnuplot is not installed (Debian: gnuplot-nox); %s/%s is written",
                       folder, script);
    }
    return code == 0 ? PM_OK : pm_fail(PM_EFILE, "gnuplot failed on %s/%s", folder, script);
}
