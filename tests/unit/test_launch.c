// Child processes. This program starts itself; with arguments it is the child.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "app/launch.h"
#include "base/progress.h"

#define SLEEP 30 // s, longer than any test takes

// --- what a child does, by its first argument ---

// With `file`, a number of one that it has inherited, it writes to that when it is ready.
static int act_child(const char *role, const char *file) {
    if (strcmp(role, "well") == 0) {
        return 0;
    }
    if (strcmp(role, "numeric") == 0) {
        fputs("portmetd: q[0] is nan\n", stderr);
        return PM_ENUMERIC;
    }
    if (strcmp(role, "foreign") == 0) {
        return 99;
    }
    if (strcmp(role, "killed") == 0) {
        raise(SIGKILL);
    }
    if (strcmp(role, "stubborn") == 0) {
        signal(SIGTERM, SIG_IGN);
    }
    if (file != NULL && write(atoi(file), "r", 1) != 1) {
        return 1;
    }
    // Interrupted by SIGTERM unless stubborn.
    sleep(SLEEP);
    return 0;
}

static const char *launch_argument[] = {"test_launch", NULL, NULL, NULL};

static pm_launch *start(const char *role) {
    pm_launch *launch = NULL;
    assert_int_equal(pm_launch_open(&launch, 2), PM_OK);
    const char **argv = launch_argument;
    argv[1] = role;
    argv[2] = NULL;
    assert_int_equal(pm_launch_start(launch, "lower", argv, NULL), PM_OK);
    return launch;
}

// Returns when the child is what its role says.
static pm_launch *start_and_wait(const char *role) {
    pm_launch *launch = NULL;
    int file[2];
    char number[16], word;
    assert_int_equal(pipe(file), 0);
    snprintf(number, sizeof number, "%d", file[1]);
    assert_int_equal(pm_launch_open(&launch, 2), PM_OK);
    const char **argv = launch_argument;
    argv[1] = role;
    argv[2] = number;
    assert_int_equal(pm_launch_start(launch, "lower", argv, NULL), PM_OK);
    close(file[1]);
    assert_int_equal(read(file[0], &word, 1), 1);
    close(file[0]);
    return launch;
}

static void assert_none_left(void) {
    assert_int_equal(waitpid(-1, NULL, WNOHANG), -1);
    assert_int_equal(errno, ECHILD);
}

static void test_child_that_ends_well(void **state) {
    (void)state;
    pm_launch *launch = start("well");
    assert_int_equal(pm_launch_wait(launch, SLEEP), PM_OK);
    pm_launch_close(launch);
    assert_none_left();
}

static void test_failure_is_named_with_its_code_and_line(void **state) {
    (void)state;
    pm_launch *launch = start("numeric");
    const char *argv[] = {"test_launch", "sleep", NULL};
    assert_int_equal(pm_launch_start(launch, "upper", argv, NULL), PM_OK);
    const double begin = pm_clock();
    pm_status status = PM_OK;
    while (status == PM_OK && pm_clock() - begin < SLEEP) {
        status = pm_launch_watch(launch);
    }
    assert_int_equal(status, PM_ENUMERIC);
    assert_string_equal(pm_error(), "process lower ended with exit code 9: q[0] is nan");
    pm_launch_close(launch);
    assert_none_left();
}

static void test_foreign_code_and_signal_are_transport_failures(void **state) {
    (void)state;
    pm_launch *launch = start("foreign");
    assert_int_equal(pm_launch_wait(launch, SLEEP), PM_ENET);
    assert_string_equal(pm_error(), "process lower ended with exit code 99");
    pm_launch_close(launch);
    launch = start("killed");
    assert_int_equal(pm_launch_wait(launch, SLEEP), PM_ENET);
    assert_string_equal(pm_error(), "process lower was killed by signal 9 (Killed)");
    pm_launch_close(launch);
    assert_none_left();
}

// A child that is killed again and again is started again after growing pauses, then given up.
static void test_child_that_keeps_dying_is_given_up(void **state) {
    (void)state;
    pm_launch *launch = NULL;
    assert_int_equal(pm_launch_open(&launch, 1), PM_OK);
    const char *const argv[] = {"test_launch", "killed", NULL};
    assert_int_equal(pm_launch_start(launch, "lower", argv, "/nowhere/x"), PM_OK);
    const double begin = pm_clock();
    pm_status status = PM_OK;
    while (status == PM_OK && pm_clock() - begin < SLEEP) {
        status = pm_launch_watch(launch);
        assert_false(pm_launch_ended_well(launch, 0));
    }
    assert_int_equal(status, PM_ENET);
    assert_string_equal(pm_error(), "process lower was killed by signal 9 (Killed)");
    assert_true(pm_clock() - begin > 0.5);
    pm_launch_close(launch);
    assert_none_left();
}

static void test_child_that_stays_is_a_timeout_and_gets_ended(void **state) {
    (void)state;
    pm_launch *launch = start("sleep");
    assert_int_equal(pm_launch_wait(launch, 0.05), PM_ETIMEOUT);
    assert_non_null(strstr(pm_error(), "lower"));
    const double begin = pm_clock();
    pm_launch_close(launch);
    assert_true(pm_clock() - begin < SLEEP / 2.0);
    assert_none_left();
}

static void test_child_that_ignores_sigterm_is_killed(void **state) {
    (void)state;
    pm_launch *launch = start_and_wait("stubborn");
    const double begin = pm_clock();
    pm_launch_close(launch);
    assert_true(pm_clock() - begin < SLEEP / 2.0);
    assert_none_left();
}

// A parent that dies without cleaning up leaves a child behind, which this process then inherits.
static void test_children_die_with_their_parent(void **state) {
    (void)state;
    assert_int_equal(prctl(PR_SET_CHILD_SUBREAPER, 1), 0);
    const pid_t parent = fork();
    if (parent == 0) {
        start_and_wait("sleep"); // it has asked for the signal
        _exit(0);
    }
    assert_int_equal(waitpid(parent, NULL, 0), parent);
    const double begin = pm_clock();
    int status = 0;
    assert_true(waitpid(-1, &status, 0) > 0);
    assert_true(pm_clock() - begin < SLEEP / 2.0);
    assert_true(WIFSIGNALED(status));
    assert_int_equal(WTERMSIG(status), SIGTERM);
}

int main(int argc, char **argv) {
    if (argc > 1) {
        return act_child(argv[1], argc > 2 ? argv[2] : NULL);
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_child_that_ends_well),
        cmocka_unit_test(test_failure_is_named_with_its_code_and_line),
        cmocka_unit_test(test_foreign_code_and_signal_are_transport_failures),
        cmocka_unit_test(test_child_that_keeps_dying_is_given_up),
        cmocka_unit_test(test_child_that_stays_is_a_timeout_and_gets_ended),
        cmocka_unit_test(test_child_that_ignores_sigterm_is_killed),
        cmocka_unit_test(test_children_die_with_their_parent),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
