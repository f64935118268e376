// Looks for modules beside the running program.
#include "base/plugin.h"

#include <dlfcn.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

// From the folder of the program: where `cmake --install` puts it, and in the tree of the build.
static const char *const places[] = {PM_PLUGINS_FROM_BIN, "..", "../.."};

pm_status pm_plugin_find(const char *file, const char *name, const void **table) {
    char own[PATH_MAX], path[2 * PATH_MAX];
    const ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    own[length > 0 ? length : 0] = '\0';
    const char *slash = strrchr(own, '/');
    void *module = NULL;
    for (size_t i = 0; i < sizeof places / sizeof *places && slash != NULL && module == NULL; ++i) {
        snprintf(path, sizeof path, "%.*s/%s/%s", (int)(slash - own), own, places[i], file);
        // Open MPI loads further libraries, which look for its symbols.
        module = access(path, R_OK) == 0 ? dlopen(path, RTLD_LAZY | RTLD_GLOBAL) : NULL;
    }
    *table = module == NULL ? NULL : dlsym(module, name);
    if (*table == NULL) {
        const char *why = slash == NULL ? "/proc is needed" : dlerror();
        return pm_fail(PM_ECONFIG, "%s cannot be loaded (Debian: portmet-mpi): %s", file,
                       why == NULL ? "it is not installed, or was not built" : why);
    }
    return PM_OK;
}
