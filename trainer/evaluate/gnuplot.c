// Runs gnuplot as a child process.
#include "evaluate/gnuplot.h"

#include <errno.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

pm_status pm_gnuplot_run(const char *folder, const char *script) {
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
