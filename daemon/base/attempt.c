// Starts the child process and reads how it ended.
#include "base/attempt.h"

#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/child.h"

#define CPU_LIMIT 20 // s; work that takes longer hangs

static void limit(int resource, rlim_t most) {
    struct rlimit now;
    if (getrlimit((__rlimit_resource_t)resource, &now) == 0 && now.rlim_cur > most) {
        now.rlim_cur = most;
        setrlimit((__rlimit_resource_t)resource, &now);
    }
}

// Returns the machine's memory in bytes. A process that asks for more would take others down with
// it.
static rlim_t all_memory(void) {
    const long pages = sysconf(_SC_PHYS_PAGES), size = sysconf(_SC_PAGESIZE);
    return pages > 0 && size > 0 ? (rlim_t)pages * (rlim_t)size : RLIM_INFINITY;
}

pm_status pm_attempt(void (*work)(const void *context), const void *context, pm_status code,
                     const char *what) {
    const pid_t child = fork();
    if (child == 0) {
        limit(RLIMIT_CPU, CPU_LIMIT);
        limit(RLIMIT_CORE, 0);
        if (PM_ATTEMPT_LIMITS_MEMORY) {
            limit(RLIMIT_AS, all_memory());
        }
        work(context);
        _exit(0);
    }
    int end = 0;
    const int error = pm_child_wait(child, &end);
    if (error != 0) {
        return pm_fail(PM_ENOMEM, "%s: cannot start a child process to open it: %s", what,
                       strerror(error));
    }
    if (WIFSIGNALED(end)) {
        return pm_fail(code, "%s (%s)", what, strsignal(WTERMSIG(end)));
    }
    return WEXITSTATUS(end) == 0 ? PM_OK : pm_fail(code, "%s", what);
}
