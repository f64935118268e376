// Runs portmet-train, and reads the states that it writes to a temporary file.
#include "library/estimated_start.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/child.h"

// Writes the path of portmet-train beside the running program, or its name alone if there is none.
static void find_program(char *path, size_t size) {
    static const char name[] = "portmet-train";
    const ssize_t length = readlink("/proc/self/exe", path, size - sizeof name - 1);
    path[length > 0 ? length : 0] = '\0';
    char *slash = strrchr(path, '/');
    if (slash != NULL) {
        memcpy(slash + 1, name, sizeof name);
    }
    if (slash == NULL || access(path, X_OK) != 0) {
        memcpy(path, name, sizeof name);
    }
}

// Runs portmet-train with the arguments argv.
static pm_status run_trainer(const char *at, char **argv) {
    int code;
    const int error = pm_child_run(argv, true, &code);
    if (error != 0) {
        return pm_fail(PM_EFILE, "%s: `estimate` needs the program portmet-train: %s", at,
                       strerror(error));
    }
    return code == 0
               ? PM_OK
               : pm_fail(PM_EDATA, "%s: portmet-train evaluate --estimate failed, see above", at);
}

pm_status pm_estimated_start(const pm_scene *scene, const char *weights, pm_dataset **states) {
    const char *folder = getenv("TMPDIR");
    char program[4096], output[4096], seconds[40], trajectory[40];
    find_program(program, sizeof program);
    snprintf(output, sizeof output, "%s/portmet-start-XXXXXX", folder == NULL ? "/tmp" : folder);
    const int file = mkstemp(output);
    if (file < 0) {
        return pm_fail(PM_EFILE, "%s: cannot be made", output);
    }
    close(file);
    snprintf(seconds, sizeof seconds, "%.17g", scene->reference_estimate);
    snprintf(trajectory, sizeof trajectory, "%d", scene->reference_trajectory);
    char *argv[] = {program,
                    "evaluate",
                    (char *)scene->path,
                    "--data",
                    (char *)scene->reference,
                    "--estimate",
                    seconds,
                    "--trajectories",
                    trajectory,
                    "--states",
                    output,
                    weights == NULL ? NULL : "--weights",
                    (char *)weights,
                    NULL};
    pm_status status = run_trainer(scene->reference_at, argv);
    if (status == PM_OK) {
        status = pm_dataset_load(states, output);
    }
    unlink(output);
    return status;
}
