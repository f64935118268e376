// Starts, watches and reaps children, with one pm_child for each.
#include "app/launch.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
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

#include "base/presence.h"
#include "base/progress.h"
#include "base/subcommand.h"

#define TERM_GRACE 2.0        // s from SIGTERM to SIGKILL
#define POLL_INTERVAL 2000000 // ns between two looks at the children
#define LINE 1024             // longest part of a line that is printed, in bytes
#define HOLD 1.0              // s until a line is printed; a child that fails ends sooner
#define MAX_DEATHS 6          // of a child, in a row, without progress
#define LIVED 10.0            // s after which a child has made progress
#define PAUSE 0.005           // s from a death to the new start; up to MAX_DEATHS deaths double it

typedef struct pm_child {
    const char *name;
    pm_launch_program program;
    pid_t pid;
    bool running;
    int wait_status;      // from waitpid, after the child has ended
    FILE *output;         // its standard error, a file in memory
    off_t size, shown;    // bytes of that file, and those already printed
    double grown;         // s of pm_clock when the child last wrote
    const char *progress; // a file that changes while it progresses; NULL: it is not started again
    struct timespec seen; // time of that file at the last death
    int deaths;           // since that file last changed
    double started;       // s of pm_clock
    int killed;           // times that a signal killed it
    double restart_at;    // s of pm_clock when the child starts again; 0: never
} pm_child;

struct pm_launch {
    int count, capacity;
    const pm_journal *log;
    pm_child child[];
};

pm_status pm_launch_open(pm_launch **launch, int capacity, const pm_journal *log) {
    pm_launch *opened = calloc(1, sizeof *opened + (size_t)capacity * sizeof opened->child[0]);
    PM_TRY(pm_allocated(opened, "a launch"));
    opened->capacity = capacity;
    opened->log = log;
    *launch = opened;
    return PM_OK;
}

static pm_status start(pm_child *child) {
    const pid_t parent = getpid();
    const int output = fileno(child->output);
    child->restart_at = 0;
    child->started = pm_clock();
    fflush(NULL); // else the child would print what is in the buffers, too
    child->pid = fork();
    if (child->pid == 0) { // the life of the child
        prctl(PR_SET_PDEATHSIG, SIGTERM);
        // The parent may have died before the line above took effect.
        if (getppid() != parent || dup2(output, STDERR_FILENO) < 0) {
            _exit(PM_EFILE);
        }
        prctl(PR_SET_NAME, child->name);
        // Closes the files that a new program would not inherit.
        DIR *folder = opendir("/proc/self/fd");
        const struct dirent *entry;
        while (folder != NULL && (entry = readdir(folder)) != NULL) {
            const int file = atoi(entry->d_name);
            const int flags =
                file > STDERR_FILENO && file != dirfd(folder) ? fcntl(file, F_GETFD) : -1;
            if (flags >= 0 && (flags & FD_CLOEXEC) != 0) {
                close(file);
            }
        }
        if (folder != NULL) {
            closedir(folder);
        }
        const pm_status status = child->program.run(child->program.context, child->name);
        const int code = pm_subcommand_end("portmetd", status);
        fflush(stderr);
        _exit(code);
    }
    child->running = child->pid > 0;
    return child->running
               ? PM_OK
               : pm_fail(PM_ENOMEM, "process %s: fork: %s", child->name, strerror(errno));
}

pm_status pm_launch_start(pm_launch *launch, const char *name, pm_launch_program program,
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
    *child = (pm_child){.name = name, .program = program, .output = output, .progress = progress};
    return start(child);
}

// Reaps the child if it has ended, and decides when one that a signal has killed starts again.
static void reap(pm_child *child, const pm_journal *log) {
    if (!child->running || waitpid(child->pid, &child->wait_status, WNOHANG) == 0) {
        return;
    }
    child->running = false;
    child->killed += WIFSIGNALED(child->wait_status) ? 1 : 0;
    if (!WIFSIGNALED(child->wait_status) || child->progress == NULL) {
        return;
    }
    struct stat file = {0};
    (void)stat(child->progress, &file);
    const bool progressed = file.st_mtim.tv_sec != child->seen.tv_sec ||
                            file.st_mtim.tv_nsec != child->seen.tv_nsec ||
                            pm_clock() - child->started > LIVED;
    child->seen = file.st_mtim;
    child->deaths = progressed ? 1 : child->deaths + 1;
    if (child->deaths <= MAX_DEATHS || child->program.stays) {
        const int doubled = child->deaths < MAX_DEATHS ? child->deaths : MAX_DEATHS;
        const int number = WTERMSIG(child->wait_status);
        char line[LINE];
        child->restart_at = pm_clock() + PAUSE * (1 << doubled);
        snprintf(line, sizeof line, "killed by signal %d (%s), started again", number,
                 strsignal(number));
        pm_journal_pass_on(log, child->name, line);
    }
}

// Prints what the child wrote at least HOLD ago, and its notices. Reads with pread, because parent
// and child share the position in the file.
static void show_output(pm_child *child, const pm_journal *log) {
    // A notice is never an error and is printed at once.
    static const char *const notices[] = {"portmetd: held after ", "portmetd: the run pauses ",
                                          "portmetd: the run goes on"};
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
        bool notice = false;
        for (size_t i = 0; i < sizeof notices / sizeof notices[0] && line[length] == '\n'; ++i) {
            notice = notice || strncmp(line, notices[i], strlen(notices[i])) == 0;
        }
        if (!notice && pm_clock() - child->grown <= HOLD) {
            return;
        }
        child->shown += (off_t)length + (line[length] == '\n');
        line[length] = 0;
        pm_journal_pass_on(log, child->name, line);
    }
}

// Prints the rest of what the child wrote, except the last line, which it copies to last [LINE].
static void collect_output(pm_child *child, const pm_journal *log, char *last) {
    char line[LINE];
    last[0] = 0;
    fseeko(child->output, child->shown, SEEK_SET);
    while (fgets(line, sizeof line, child->output) != NULL) {
        pm_journal_pass_on(log, child->name, last);
        line[strcspn(line, "\n")] = 0;
        memcpy(last, line, sizeof line);
    }
}

pm_status pm_launch_watch(pm_launch *launch, int *deaths) {
    int killed = 0;
    siginfo_t ended = {0};
    const bool any = waitid(P_ALL, 0, &ended, WEXITED | WNOHANG | WNOWAIT) != 0 || ended.si_pid > 0;
    for (int i = 0; i < launch->count; ++i) {
        pm_child *child = &launch->child[i];
        if (any) {
            reap(child, launch->log);
        }
        killed += child->killed;
        if (child->running) {
            show_output(child, launch->log);
        }
        if (child->restart_at > 0 && pm_clock() >= child->restart_at) {
            PM_TRY(start(child));
        }
    }
    if (deaths != NULL) {
        *deaths = killed;
    }
    pm_child *child = launch->child, *end = child + launch->count;
    while (child < end && (child->running || child->restart_at != 0 || child->wait_status == 0)) {
        ++child;
    }
    if (child == end) {
        return PM_OK;
    }
    // The child has failed. The last line that it wrote says why.
    static const char prefix[] = "portmetd: ";
    char last[LINE];
    collect_output(child, launch->log, last);
    const char *reason = last + (strncmp(last, prefix, strlen(prefix)) == 0 ? strlen(prefix) : 0);
    const char *separator = *reason == 0 ? "" : ": ";
    if (WIFSIGNALED(child->wait_status)) {
        const int number = WTERMSIG(child->wait_status);
        return pm_fail(PM_ENET, "process %s was killed by signal %d (%s)%s%s", child->name, number,
                       strsignal(number), separator, reason);
    }
    const int code = WEXITSTATUS(child->wait_status);
    const pm_status status =
        code >= PM_EUSAGE && code <= PM_EINTERRUPTED ? (pm_status)code : PM_ENET;
    return pm_fail(status, "process %s ended with exit code %d%s%s", child->name, code, separator,
                   reason);
}

bool pm_launch_ended_well(const pm_launch *launch, int id) {
    const pm_child *child = &launch->child[id];
    return !child->running && child->restart_at == 0 && child->wait_status == 0;
}

void pm_launch_signal(pm_launch *launch, int id, int signal_number) {
    // A child that is not reaped keeps its process id, so the signal reaches no other process.
    if (launch->child[id].running) {
        kill(launch->child[id].pid, signal_number);
    }
}

static bool any_running(pm_launch *launch) {
    bool running = false;
    for (int i = 0; i < launch->count; ++i) {
        reap(&launch->child[i], launch->log);
        running = running || launch->child[i].running;
    }
    return running;
}

// Waits up to `seconds` for all children. Returns true if all have ended.
static bool wait_all(pm_launch *launch, double seconds) {
    pm_presence presence = {0};
    const double deadline = pm_presence_look(&presence, pm_clock()) + seconds;
    while (any_running(launch)) {
        if (pm_presence_look(&presence, pm_clock()) > deadline) {
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

// Ensures that no child is started again from now on.
static void stop_restarting(pm_launch *launch) {
    for (int i = 0; i < launch->count; ++i) {
        launch->child[i].progress = NULL;
        launch->child[i].restart_at = 0;
    }
}

pm_status pm_launch_wait(pm_launch *launch, double grace) {
    stop_restarting(launch);
    const bool ended = wait_all(launch, grace);
    PM_TRY(pm_launch_watch(launch, NULL));
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
    stop_restarting(launch);
    if (any_running(launch)) {
        signal_all(launch, SIGTERM);
        if (!wait_all(launch, TERM_GRACE)) {
            signal_all(launch, SIGKILL);
            wait_all(launch, TERM_GRACE);
        }
    }
    for (int i = 0; i < launch->count; ++i) {
        pm_child *child = &launch->child[i];
        // The last line of a child that succeeded is a warning. For the others one error is enough.
        if (child->wait_status == 0) {
            char last[LINE];
            collect_output(child, launch->log, last);
            pm_journal_pass_on(launch->log, child->name, last);
        }
        fclose(child->output);
    }
    free(launch);
}
