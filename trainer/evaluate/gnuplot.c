// Runs gnuplot as a child process.
#include "evaluate/gnuplot.h"

#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/child.h"

pm_status pm_gnuplot_run(const char *folder, const char *script) {
    const pid_t child = fork();
    if (child == 0) {
        if (chdir(folder) == 0) {
            execlp("gnuplot", "gnuplot", script, (char *)NULL);
        }
        _exit(127);
    }
    int code = 0;
    const int error = pm_child_wait(child, &code);
    if (error != 0) {
        return pm_fail(PM_EFILE, "gnuplot: %s", strerror(error));
    }
    if (WIFEXITED(code) && WEXITSTATUS(code) == 127) {
        return pm_fail(PM_EFILE, "gnuplot is not installed (Debian: gnuplot-nox); %s/%s is written",
                       folder, script);
    }
    return code == 0 ? PM_OK : pm_fail(PM_EFILE, "gnuplot failed on %s/%s", folder, script);
}
