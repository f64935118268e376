// Starts a program by posix_spawn, and repeats waitpid while signals interrupt it.
#include "base/child.h"

#include <errno.h>
#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

extern char **environ;

int pm_child_wait(pid_t child, int *end) {
    pid_t ended = child;
    do {
        ended = child < 0 ? -1 : waitpid(child, end, 0);
    } while (ended < 0 && child >= 0 && errno == EINTR);
    return ended < 0 ? errno : 0;
}

int pm_child_run(char *const *argv, bool quiet, int *code) {
    posix_spawn_file_actions_t actions;
    pid_t child;
    int end = 0, error = posix_spawn_file_actions_init(&actions);
    if (error != 0) {
        return error;
    }
    if (quiet) {
        error = posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    }
    if (error == 0) {
        error = posix_spawnp(&child, argv[0], &actions, NULL, argv, environ);
    }
    posix_spawn_file_actions_destroy(&actions);
    if (error == 0) {
        error = pm_child_wait(child, &end);
    }
    if (error == 0) {
        *code = WIFEXITED(end) ? WEXITSTATUS(end) : -1;
    }
    return error;
}
