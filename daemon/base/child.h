// Child processes: waiting for one, and running a program as one.
#ifndef PM_BASE_CHILD_H
#define PM_BASE_CHILD_H

#include <stdbool.h>
#include <sys/types.h>

// Waits until the process `child` ends, however many signals interrupt the wait. *end receives how
// it ended, as waitpid tells it. Returns 0, or the errno of waitpid; a negative `child` has failed
// to start, and the function returns errno.
int pm_child_wait(pid_t child, int *end);

// Runs the program argv[0], which is looked for in PATH unless it contains a slash, with the
// arguments argv, whose last entry is NULL, and waits until it ends. With `quiet` nobody sees its
// standard output. *code receives its exit code, or -1 if a signal ended it. Returns 0, or the
// errno for which the program could not be run.
int pm_child_run(char *const *argv, bool quiet, int *code);

#endif
