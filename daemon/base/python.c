// Finds the Python package from the folder of the running program.
#include "base/python.h"

#include <dirent.h>
#include <errno.h>
#include <fnmatch.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/child.h"
#include "base/files.h"

// The package, from the folder of the running program: in the tree of the build, for programs of
// tests there, and where `cmake --install` puts it.
static const char *const places[] = {"../daemon/python/portmet", "../../daemon/python/portmet",
                                     PM_PYTHON_FROM_BIN};

const pm_python_program pm_python_pictures = {
    "pictures", "pictures: python3 or gnuplot is not installed (Debian: python3 python3-h5py "
                "gnuplot-nox)"};

// The files that the pictures of a kind replace: a pattern of fnmatch for what follows the
// beginning of the path, which is that of a folder or of the files.
static const struct {
    const char *kind;
    bool in_folder;
    const char *pattern;
} drawn[] = {
    {"fit", true, "fit.@(gp|png)"},
    {"evaluation", true,
     "@(?(trained_)@(trajectories|snapshots).txt|states.txt|@(growth|laws).txt|"
     "@(errors|trajectory|growth|laws).@(gp|png))"},
    {"estimate", true, "@(predictions.h5|@(coverage|prediction_+([0-9])).@(txt|gp|png))"},
    {"columns", true, "measured.@(txt|gp|png)"},
    {"boxes", true, "@(errors.@(txt|gp|png)|test.txt|trained.txt)"},
    {"bench", false, ".@(txt|gp|png|svg)"},
    {"stress", false, ".@(txt|gp|png|svg)"},
    {"bodies", false, ".gp"},
    {"xdmf", false, ".xdmf"},
};

pm_status pm_python_run(const pm_python_program *program, const char *const *argument, bool quiet) {
    char path[2 * PATH_MAX + 64] = "/proc is needed", own[PATH_MAX];
    int count = 0, code = 0;
    bool found = false;
    const ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    own[length > 0 ? length : 0] = '\0';
    const char *slash = strrchr(own, '/');
    for (size_t i = 0; i < sizeof places / sizeof *places && slash != NULL && !found; ++i) {
        snprintf(path, sizeof path, "%.*s/%s/%s", (int)(slash - own), own, places[i],
                 program->folder);
        found = access(path, R_OK) == 0;
    }
    if (!found) {
        return pm_fail(PM_EFILE,
                       "%s: the Python package of portmet is not where it was built or installed: "
                       "%s",
                       program->folder, path);
    }
    while (argument[count] != NULL) {
        ++count;
    }
    char **argv = calloc((size_t)count + 4, sizeof *argv);
    PM_TRY(pm_allocated(argv, "%s", program->folder));
    argv[0] = "python3";
    argv[1] = "-B"; // leaves no compiled files in folders of the system
    argv[2] = path;
    memcpy(argv + 3, argument, (size_t)count * sizeof *argv);
    fflush(stdout);
    const int error = pm_child_run(argv, quiet, &code);
    free(argv);
    if (error != 0) {
        return error == ENOENT ? pm_fail(PM_EFILE, "%s", program->missing)
                               : pm_fail(PM_EFILE, "%s: python3 cannot be started: %s",
                                         program->folder, strerror(error));
    }
    switch (code) {
    case 0:
        return PM_OK;
    case PM_EUSAGE:
    case PM_EFILE:
    case PM_EDATA:
    case PM_ENOMEM:
    case PM_EINTERRUPTED:
        return pm_fail((pm_status)code, "%s", "");
    default:
        return pm_fail(PM_EFILE, "%s: the program in Python ended with the code %d",
                       program->folder, code);
    }
}

pm_status pm_python_folder(const char *folder) {
    return mkdir(folder, 0777) == 0 || errno == EEXIST
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
}

pm_status pm_python_check_pictures(const char *kind, const char *start) {
    size_t k = 0;
    while (strcmp(drawn[k].kind, kind) != 0) {
        ++k;
    }
    const char *slash = drawn[k].in_folder ? start + strlen(start) : strrchr(start, '/');
    const char *base = drawn[k].in_folder ? "" : slash == NULL ? start : slash + 1;
    const int length = slash == NULL ? 0 : (int)(slash - start);
    char path[PATH_MAX];
    if (snprintf(path, sizeof path, "%.*s/", length, start) >= (int)sizeof path) {
        return pm_fail(PM_EFILE, "%s: the path is too long", start);
    }
    DIR *folder = opendir(slash == NULL ? "." : path);
    if (folder == NULL) { // of one that is not there nothing is replaced
        return errno == ENOENT
                   ? PM_OK
                   : pm_fail(PM_EFILE, "%s: %s", slash == NULL ? "." : path, strerror(errno));
    }
    pm_status status = PM_OK;
    const struct dirent *entry;
    while (status == PM_OK && (entry = readdir(folder)) != NULL) {
        const char *name = entry->d_name;
        if (strncmp(name, base, strlen(base)) != 0 ||
            fnmatch(drawn[k].pattern, name + strlen(base), FNM_EXTMATCH) != 0) {
            continue;
        }
        const bool numbers = fnmatch("*.h5", name, 0) == 0;
        if (snprintf(path, sizeof path, "%.*s%s%s", length, start, slash == NULL ? "" : "/",
                     name) >= (int)sizeof path) {
            status = pm_fail(PM_EFILE, "%s: the path is too long", start);
        } else {
            status = pm_files_check_output(path, numbers ? PM_FILES_HDF5 : PM_FILES_PICTURE);
        }
    }
    closedir(folder);
    return status;
}

pm_status pm_python_table(FILE **file, const char *start, const char *end) {
    char path[PATH_MAX];
    if ((size_t)snprintf(path, sizeof path, "%s%s", start, end) >= sizeof path) {
        return pm_fail(PM_EFILE, "%s: the path is too long", start);
    }
    PM_TRY(pm_files_create(file, path, PM_FILES_PICTURE));
    fputs(PM_FILES_PICTURE "\n", *file);
    return PM_OK;
}

pm_status pm_python_table_close(FILE *file, const char *folder) {
    const int failed = ferror(file);
    return fclose(file) == 0 && !failed ? PM_OK : pm_fail(PM_EFILE, "%s: cannot write", folder);
}
