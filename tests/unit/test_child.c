// Child processes: exit codes, signals, programs that cannot be run, and waits that signals
// interrupt.
#include <errno.h>
#include <signal.h>
#include <sys/time.h>
#include <unistd.h>

#include "base/child.h"
#include "tests/support/unit.h"

static volatile sig_atomic_t interrupted;

static void interrupt(int signal) {
    (void)signal;
    ++interrupted;
}

static int run_shell(const char *command, int *code) {
    char *argv[] = {"sh", "-c", (char *)command, NULL};
    return pm_child_run(argv, true, code);
}

static void test_ends(void **state) {
    (void)state;
    int code = -2;
    assert_int_equal(run_shell("exit 0", &code), 0);
    assert_int_equal(code, 0);
    assert_int_equal(run_shell("exit 7", &code), 0);
    assert_int_equal(code, 7);
    assert_int_equal(run_shell("kill -KILL $$", &code), 0);
    assert_int_equal(code, -1);
    char *missing[] = {"/no/such/program", NULL};
    assert_int_equal(pm_child_run(missing, false, &code), ENOENT);
    errno = EAGAIN;
    assert_int_equal(pm_child_wait(-1, &code), EAGAIN); // what fork has left
}

// Standard output of a quiet child goes to /dev/null, and that of another one to the parent's.
static void test_quiet(void **state) {
    (void)state;
    int pair[2], code;
    char *argv[] = {"echo", "word", NULL};
    char text[16] = "";
    assert_int_equal(pipe(pair), 0);
    const int saved = dup(STDOUT_FILENO);
    dup2(pair[1], STDOUT_FILENO);
    const int quiet = pm_child_run(argv, true, &code), loud = pm_child_run(argv, false, &code);
    dup2(saved, STDOUT_FILENO);
    close(saved);
    close(pair[1]);
    assert_int_equal(quiet, 0);
    assert_int_equal(loud, 0);
    assert_int_equal(read(pair[0], text, sizeof text), 5);
    assert_string_equal(text, "word\n");
    close(pair[0]);
}

// A signal that the caller handles does not end the wait.
static void test_interrupted(void **state) {
    (void)state;
    const struct sigaction action = {.sa_handler = interrupt}; // waitpid does not start again
    const struct itimerval often = {{0, 5000}, {0, 5000}}, never = {{0, 0}, {0, 0}};
    struct sigaction before;
    int code = -2;
    assert_int_equal(sigaction(SIGALRM, &action, &before), 0);
    assert_int_equal(setitimer(ITIMER_REAL, &often, NULL), 0);
    const int error = run_shell("sleep 0.3; exit 5", &code);
    assert_int_equal(setitimer(ITIMER_REAL, &never, NULL), 0);
    assert_int_equal(sigaction(SIGALRM, &before, NULL), 0);
    assert_int_equal(error, 0);
    assert_int_equal(code, 5);
    assert_true(interrupted > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_ends),
        cmocka_unit_test(test_quiet),
        cmocka_unit_test(test_interrupted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
