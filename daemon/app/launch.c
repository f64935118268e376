// fork, exec, waitpid; one pm_child per process.
#include "app/launch.h"

#include <errno.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"

#define TERM_GRACE 2.0        // s from SIGTERM to SIGKILL
#define POLL_INTERVAL 2000000 // ns between two looks at the children
#define LINE 1024             // bytes kept of a line

typedef struct pm_child {
    const char *name;
    pid_t pid;
    bool running;
    int wait_status; // of waitpid, once it has ended
    FILE *output;    // its standard error: a file in memory
} pm_child;

struct pm_launch {
    int count, capacity;
    pm_child child[];
};

pm_status pm_launch_open(pm_launch **launch, int capacity) {
    pm_launch *opened = calloc(1, sizeof *opened + (size_t)capacity * sizeof opened->child[0]);
    if (opened == NULL) {
        return pm_fail(PM_ENOMEM, "launch: out of memory");
    }
    opened->capacity = capacity;
    *launch = opened;
    return PM_OK;
}

// In the child, between fork and exec.
static void become(pid_t parent, int output, char *const *argv) {
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    // The parent may have died before the line above.
    if (getppid() == parent && dup2(output, STDERR_FILENO) >= 0) {
        execv("/proc/self/exe", argv);
        dprintf(STDERR_FILENO, "cannot start %s: %s\n", argv[0], strerror(errno));
    }
    _exit(PM_EFILE);
}

pm_status pm_launch_start(pm_launch *launch, const char *name, const char *const *argv) {
    if (launch->count == launch->capacity) {
        return pm_fail(PM_ENOMEM, "launch: more than %d processes", launch->capacity);
    }
    const int fd = memfd_create(name, MFD_CLOEXEC);
    FILE *output = fd < 0 ? NULL : fdopen(fd, "r+");
    if (output == NULL) {
        return pm_fail(PM_ENOMEM, "node %s: memory for its messages: %s", name, strerror(errno));
    }
    const pid_t parent = getpid();
    const pid_t pid = fork();
    if (pid == 0) {
        // exec does not write to argv; its prototype is older than const.
        become(parent, fd, (char *const *)argv);
    }
    if (pid < 0) {
        fclose(output);
        return pm_fail(PM_ENOMEM, "node %s: fork: %s", name, strerror(errno));
    }
    launch->child[launch->count++] =
        (pm_child){.name = name, .pid = pid, .running = true, .output = output};
    return PM_OK;
}

// Reaps the child if it has ended.
static void look(pm_child *child) {
    if (child->running && waitpid(child->pid, &child->wait_status, WNOHANG) != 0) {
        child->running = false;
    }
}

static void print_line(const pm_child *child, const char *line) {
    if (line[0] != 0) {
        fprintf(stderr, "[%s] %s\n", child->name, line);
    }
}

// Prints all that the child wrote but the last line, which `last` [LINE] receives.
static void collect_output(pm_child *child, char *last) {
    char line[LINE];
    last[0] = 0;
    rewind(child->output);
    while (fgets(line, sizeof line, child->output) != NULL) {
        print_line(child, last);
        line[strcspn(line, "\n")] = 0;
        memcpy(last, line, sizeof line);
    }
}

static pm_status fail_child(pm_child *child) {
    char last[LINE];
    collect_output(child, last);
    const char prefix[] = "portmetd: ";
    if (strncmp(last, prefix, sizeof prefix - 1) == 0) {
        memmove(last, last + sizeof prefix - 1, strlen(last + sizeof prefix - 1) + 1);
    }
    const char *separator = last[0] == 0 ? "" : ": ";
    if (WIFSIGNALED(child->wait_status)) {
        const int number = WTERMSIG(child->wait_status);
        return pm_fail(PM_ENET, "node %s was killed by signal %d (%s)%s%s", child->name, number,
                       strsignal(number), separator, last);
    }
    const int code = WEXITSTATUS(child->wait_status);
    const pm_status status =
        code >= PM_EUSAGE && code <= PM_EINTERRUPTED ? (pm_status)code : PM_ENET;
    return pm_fail(status, "node %s ended with exit code %d%s%s", child->name, code, separator,
                   last);
}

pm_status pm_launch_watch(pm_launch *launch) {
    for (int i = 0; i < launch->count; ++i) {
        look(&launch->child[i]);
    }
    for (int i = 0; i < launch->count; ++i) {
        pm_child *child = &launch->child[i];
        if (!child->running && child->wait_status != 0) {
            return fail_child(child);
        }
    }
    return PM_OK;
}

static bool any_running(pm_launch *launch) {
    bool running = false;
    for (int i = 0; i < launch->count; ++i) {
        look(&launch->child[i]);
        running = running || launch->child[i].running;
    }
    return running;
}

// True if all have ended within `seconds`.
static bool wait_all(pm_launch *launch, double seconds) {
    const double deadline = pm_clock() + seconds;
    while (any_running(launch)) {
        if (pm_clock() > deadline) {
            return false;
        }
        nanosleep(&(struct timespec){.tv_nsec = POLL_INTERVAL}, NULL);
    }
    return true;
}

static void signal_all(pm_launch *launch, int signal_number) {
    for (int i = 0; i < launch->count; ++i) {
        // A child that was not reaped keeps its process id, so no stranger is hit.
        if (launch->child[i].running) {
            kill(launch->child[i].pid, signal_number);
        }
    }
}

pm_status pm_launch_wait(pm_launch *launch, double grace) {
    const bool ended = wait_all(launch, grace);
    PM_TRY(pm_launch_watch(launch));
    for (int i = 0; i < launch->count && !ended; ++i) {
        if (launch->child[i].running) {
            return pm_fail(PM_ETIMEOUT, "node %s did not end within %g s", launch->child[i].name,
                           grace);
        }
    }
    return PM_OK;
}

void pm_launch_close(pm_launch *launch) {
    if (launch == NULL) {
        return;
    }
    if (any_running(launch)) {
        signal_all(launch, SIGTERM);
        if (!wait_all(launch, TERM_GRACE)) {
            signal_all(launch, SIGKILL);
            wait_all(launch, TERM_GRACE);
        }
    }
    for (int i = 0; i < launch->count; ++i) {
        pm_child *child = &launch->child[i];
        // Warnings of a child that ended well; of the others one error is enough.
        if (child->wait_status == 0) {
            char last[LINE];
            collect_output(child, last);
            print_line(child, last);
        }
        fclose(child->output);
    }
    free(launch);
}
