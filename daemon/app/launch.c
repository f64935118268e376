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
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"

#define TERM_GRACE 2.0        // s from SIGTERM to SIGKILL
#define POLL_INTERVAL 2000000 // ns between two looks at the children
#define LINE 1024             // bytes kept of a line
#define HOLD 1.0              // s until a child's line is shown: an error ends it before that
#define MAX_DEATHS 6          // of a child, in a row, without its getting on
#define PAUSE 0.005           // s from a death to the new start, doubled by every death

typedef struct pm_child {
    const char *name;
    const char *const *argv;
    pid_t pid;
    bool running;
    int wait_status;      // of waitpid, once it has ended
    FILE *output;         // its standard error: a file in memory
    off_t size, shown;    // bytes of that, and of these printed
    double grown;         // s, when it last wrote
    const char *progress; // NULL: it is not started again
    struct timespec seen; // when that file was written, as of the last death
    int deaths;           // since
    double back;          // s, when it is to be started again; 0: never
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

static pm_status start(pm_child *child) {
    const pid_t parent = getpid();
    const int output = fileno(child->output);
    child->back = 0;
    child->pid = fork();
    if (child->pid == 0) {
        // exec does not write to argv; its prototype is older than const.
        become(parent, output, (char *const *)child->argv);
    }
    child->running = child->pid > 0;
    return child->running
               ? PM_OK
               : pm_fail(PM_ENOMEM, "process %s: fork: %s", child->name, strerror(errno));
}

pm_status pm_launch_start(pm_launch *launch, const char *name, const char *const *argv,
                          const char *progress) {
    if (launch->count == launch->capacity) {
        return pm_fail(PM_ENOMEM, "launch: more than %d processes", launch->capacity);
    }
    const int fd = memfd_create(name, MFD_CLOEXEC);
    FILE *output = fd < 0 ? NULL : fdopen(fd, "r+");
    if (output == NULL) {
        return pm_fail(PM_ENOMEM, "process %s: memory for its messages: %s", name, strerror(errno));
    }
    pm_child *child = &launch->child[launch->count++];
    *child = (pm_child){.name = name, .argv = argv, .output = output, .progress = progress};
    return start(child);
}

// A signal killed the child: when does it come back?
static void mourn(pm_child *child) {
    struct stat file = {0};
    (void)stat(child->progress, &file);
    const bool got_on =
        file.st_mtim.tv_sec != child->seen.tv_sec || file.st_mtim.tv_nsec != child->seen.tv_nsec;
    child->seen = file.st_mtim;
    child->deaths = got_on ? 1 : child->deaths + 1;
    if (child->deaths > MAX_DEATHS) {
        return;
    }
    child->back = pm_clock() + PAUSE * (1 << child->deaths);
    fprintf(stderr, "[%s] killed by signal %d (%s), started again\n", child->name,
            WTERMSIG(child->wait_status), strsignal(WTERMSIG(child->wait_status)));
}

// Reaps the child if it has ended.
static void look(pm_child *child) {
    if (child->running && waitpid(child->pid, &child->wait_status, WNOHANG) != 0) {
        child->running = false;
        if (WIFSIGNALED(child->wait_status) && child->progress != NULL) {
            mourn(child);
        }
    }
}

static void print_line(const pm_child *child, const char *line) {
    if (line[0] != 0) {
        fprintf(stderr, "[%s] %s\n", child->name, line);
    }
}

// What is no error, whatever comes after it: shown at once.
static bool is_notice(const char *line) {
    static const char *const notices[] = {"portmetd: held after ", "portmetd: the run pauses ",
                                          "portmetd: the run goes on"};
    for (size_t i = 0; i < sizeof notices / sizeof notices[0]; ++i) {
        if (strncmp(line, notices[i], strlen(notices[i])) == 0) {
            return true;
        }
    }
    return false;
}

// Prints what the child wrote a while ago, and its notices. Its place in the file is the child's
// too: it stays.
static void show_output(pm_child *child) {
    struct stat file;
    if (fstat(fileno(child->output), &file) != 0 || file.st_size == child->shown) {
        return;
    }
    if (file.st_size != child->size) {
        child->size = file.st_size;
        child->grown = pm_clock();
    }
    char line[LINE];
    while (child->shown < child->size) {
        const ssize_t count = pread(fileno(child->output), line, sizeof line - 1, child->shown);
        if (count <= 0) {
            return;
        }
        line[count] = 0;
        const size_t length = strcspn(line, "\n");
        const bool notice = line[length] == '\n' && is_notice(line);
        if (!notice && pm_clock() - child->grown <= HOLD) {
            return;
        }
        child->shown += (off_t)length + (line[length] == '\n');
        line[length] = 0;
        print_line(child, line);
    }
}

// Prints the rest of what the child wrote but the last line, which `last` [LINE] receives.
static void collect_output(pm_child *child, char *last) {
    char line[LINE];
    last[0] = 0;
    fseeko(child->output, child->shown, SEEK_SET);
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
        return pm_fail(PM_ENET, "process %s was killed by signal %d (%s)%s%s", child->name, number,
                       strsignal(number), separator, last);
    }
    const int code = WEXITSTATUS(child->wait_status);
    const pm_status status =
        code >= PM_EUSAGE && code <= PM_EINTERRUPTED ? (pm_status)code : PM_ENET;
    return pm_fail(status, "process %s ended with exit code %d%s%s", child->name, code, separator,
                   last);
}

pm_status pm_launch_watch(pm_launch *launch) {
    for (int i = 0; i < launch->count; ++i) {
        pm_child *child = &launch->child[i];
        look(child);
        if (child->running) {
            show_output(child);
        }
        if (child->back > 0 && pm_clock() >= child->back) {
            PM_TRY(start(child));
        }
    }
    for (int i = 0; i < launch->count; ++i) {
        pm_child *child = &launch->child[i];
        if (!child->running && child->back == 0 && child->wait_status != 0) {
            return fail_child(child);
        }
    }
    return PM_OK;
}

bool pm_launch_ended_well(const pm_launch *launch, int id) {
    const pm_child *child = &launch->child[id];
    return !child->running && child->back == 0 && child->wait_status == 0;
}

void pm_launch_signal(pm_launch *launch, int id, int signal_number) {
    // A child that was not reaped keeps its process id, so no stranger is hit.
    if (launch->child[id].running) {
        kill(launch->child[id].pid, signal_number);
    }
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
        pm_launch_signal(launch, i, signal_number);
    }
}

// From now on whoever is dead stays dead.
static void stop_reviving(pm_launch *launch) {
    for (int i = 0; i < launch->count; ++i) {
        launch->child[i].progress = NULL;
        launch->child[i].back = 0;
    }
}

pm_status pm_launch_wait(pm_launch *launch, double grace) {
    stop_reviving(launch);
    const bool ended = wait_all(launch, grace);
    PM_TRY(pm_launch_watch(launch));
    for (int i = 0; i < launch->count && !ended; ++i) {
        if (launch->child[i].running) {
            return pm_fail(PM_ETIMEOUT, "process %s did not end within %g s", launch->child[i].name,
                           grace);
        }
    }
    return PM_OK;
}

void pm_launch_close(pm_launch *launch) {
    if (launch == NULL) {
        return;
    }
    stop_reviving(launch);
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
