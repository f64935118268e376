// Child processes, which are copies of this one.
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "app/launch.h"
#include "base/progress.h"
#include "tests/support/unit.h"

#define SLEEP 30 // s, longer than any test takes

static const pm_journal plain = {.program = "portmetd"};

// --- what a child does ---

typedef struct role {
    pm_status (*act)(const struct role *own);
    int file; // open when the child was started; 0: none
} role;

static pm_status act(void *context, const char *name) {
    const role *own = context;
    char title[32] = "";
    prctl(PR_GET_NAME, title);
    return strcmp(title, name) == 0 ? own->act(own) : pm_fail(PM_EUSAGE, "called %s", title);
}

static pm_status end_well(const role *own) {
    (void)own;
    return PM_OK;
}

static pm_status fail_numerically(const role *own) {
    (void)own;
    return pm_fail(PM_ENUMERIC, "q[0] is nan");
}

static pm_status end_otherwise(const role *own) {
    (void)own;
    _exit(99);
}

static pm_status be_killed(const role *own) {
    (void)own;
    raise(SIGKILL);
    return PM_OK;
}

// Writes to the file, if there is one, and stays until SIGTERM ends the sleep.
static pm_status stay(const role *own) {
    if (own->file != 0 && write(own->file, "r", 1) != 1) {
        return pm_fail(PM_EFILE, "not inherited");
    }
    sleep(SLEEP);
    return PM_OK;
}

static pm_status stay_stubbornly(const role *own) {
    signal(SIGTERM, SIG_IGN);
    return stay(own);
}

// Succeeds if the file is open.
static pm_status look_at_file(const role *own) {
    return fcntl(own->file, F_GETFD) >= 0 ? PM_OK : pm_fail(PM_EFILE, "not inherited");
}

static pm_launch *start_role(const role *r) {
    pm_launch *launch = NULL;
    assert_int_equal(pm_launch_open(&launch, 2, &plain), PM_OK);
    const pm_launch_program program = {act, (void *)(uintptr_t)r, false};
    assert_int_equal(pm_launch_start(launch, "lower", program, NULL), PM_OK);
    return launch;
}

// The child has its own copy of the role.
static pm_launch *start(pm_status (*action)(const role *own)) {
    const role r = {.act = action};
    return start_role(&r);
}

// Returns when the child is what its role says.
static pm_launch *start_and_wait(pm_status (*action)(const role *own)) {
    int file[2];
    char word;
    assert_int_equal(pipe(file), 0);
    const role r = {action, file[1]};
    pm_launch *launch = start_role(&r);
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
    pm_launch *launch = start(end_well);
    assert_int_equal(pm_launch_wait(launch, SLEEP), PM_OK);
    pm_launch_close(launch);
    assert_none_left();
}

static void test_failure_is_named_with_its_code_and_line(void **state) {
    (void)state;
    pm_launch *launch = start(fail_numerically);
    role sleeper = {.act = stay};
    const pm_launch_program program = {act, &sleeper, false};
    assert_int_equal(pm_launch_start(launch, "upper", program, NULL), PM_OK);
    const double begin = pm_clock();
    pm_status status = PM_OK;
    while (status == PM_OK && pm_clock() - begin < SLEEP) {
        status = pm_launch_watch(launch, NULL);
    }
    assert_int_equal(status, PM_ENUMERIC);
    assert_string_equal(pm_error(), "process lower ended with exit code 9: q[0] is nan");
    pm_launch_close(launch);
    assert_none_left();
}

static void test_foreign_code_and_signal_are_transport_failures(void **state) {
    (void)state;
    pm_launch *launch = start(end_otherwise);
    assert_int_equal(pm_launch_wait(launch, SLEEP), PM_ENET);
    assert_string_equal(pm_error(), "process lower ended with exit code 99");
    pm_launch_close(launch);
    launch = start(be_killed);
    assert_int_equal(pm_launch_wait(launch, SLEEP), PM_ENET);
    assert_string_equal(pm_error(), "process lower was killed by signal 9 (Killed)");
    pm_launch_close(launch);
    assert_none_left();
}

// A child inherits the files that a new program would.
static void test_child_closes_private_files(void **state) {
    (void)state;
    int file[2];
    assert_int_equal(pipe(file), 0);
    const role r = {look_at_file, file[0]};
    pm_launch *launch = start_role(&r);
    assert_int_equal(pm_launch_wait(launch, SLEEP), PM_OK);
    pm_launch_close(launch);
    assert_int_equal(fcntl(file[0], F_SETFD, FD_CLOEXEC), 0);
    launch = start_role(&r);
    assert_int_equal(pm_launch_wait(launch, SLEEP), PM_EFILE);
    assert_non_null(strstr(pm_error(), "not inherited"));
    pm_launch_close(launch);
    close(file[0]);
    close(file[1]);
}

// A child that is killed again and again is started again after growing pauses, then given up,
// unless it is to stay.
static void test_child_that_keeps_dying_is_given_up(void **state) {
    (void)state;
    pm_launch *launch = NULL;
    assert_int_equal(pm_launch_open(&launch, 1, &plain), PM_OK);
    role victim = {.act = be_killed};
    const pm_launch_program program = {act, &victim, false};
    assert_int_equal(pm_launch_start(launch, "lower", program, "/nowhere/x"), PM_OK);
    const double begin = pm_clock();
    pm_status status = PM_OK;
    while (status == PM_OK && pm_clock() - begin < SLEEP) {
        status = pm_launch_watch(launch, NULL);
        assert_false(pm_launch_ended_well(launch, 0));
    }
    assert_int_equal(status, PM_ENET);
    assert_string_equal(pm_error(), "process lower was killed by signal 9 (Killed)");
    const double given_up = pm_clock() - begin;
    assert_true(given_up > 0.5);
    pm_launch_close(launch);
    assert_none_left();

    const pm_launch_program service = {act, &victim, true};
    int deaths = 0;
    assert_int_equal(pm_launch_open(&launch, 1, &plain), PM_OK);
    assert_int_equal(pm_launch_start(launch, "lower", service, "/nowhere/x"), PM_OK);
    // The pauses of two processes of which one is killed every second are shorter than a second, so
    // that both are there from time to time.
    double died = 0, pause = SLEEP;
    for (const double end = pm_clock() + 4 * SLEEP; deaths < 12 && pm_clock() < end;) {
        const int before = deaths;
        assert_int_equal(pm_launch_watch(launch, &deaths), PM_OK);
        if (deaths > before) {
            pause = deaths > 8 && pm_clock() - died < pause ? pm_clock() - died : pause;
            died = pm_clock();
        }
    }
    assert_int_equal(deaths, 12);
    assert_true(pause < 0.5);
    pm_launch_close(launch);
    assert_none_left();
}

static void test_child_that_stays_is_a_timeout_and_gets_ended(void **state) {
    (void)state;
    pm_launch *launch = start(stay);
    assert_int_equal(pm_launch_wait(launch, 0.05), PM_ETIMEOUT);
    assert_non_null(strstr(pm_error(), "lower"));
    const double begin = pm_clock();
    pm_launch_close(launch);
    assert_true(pm_clock() - begin < SLEEP / 2.0);
    assert_none_left();
}

static void test_child_that_ignores_sigterm_is_killed(void **state) {
    (void)state;
    pm_launch *launch = start_and_wait(stay_stubbornly);
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
        start_and_wait(stay); // it has asked for the signal
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_child_that_ends_well),
        cmocka_unit_test(test_failure_is_named_with_its_code_and_line),
        cmocka_unit_test(test_foreign_code_and_signal_are_transport_failures),
        cmocka_unit_test(test_child_closes_private_files),
        cmocka_unit_test(test_child_that_keeps_dying_is_given_up),
        cmocka_unit_test(test_child_that_stays_is_a_timeout_and_gets_ended),
        cmocka_unit_test(test_child_that_ignores_sigterm_is_killed),
        cmocka_unit_test(test_children_die_with_their_parent),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
