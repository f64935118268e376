// What a service manager is told, on a socket of this test.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "app/notify.h"
#include "tests/support/unit.h"

#define PATIENCE 5 // s, for a datagram on one host

// Binds a socket to `path`; '@' stands for the zero byte of an abstract one. Names it in the
// environment.
static int listen_at(const char *path) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const struct timeval patience = {.tv_sec = PATIENCE};
    const int file = socket(AF_UNIX, SOCK_DGRAM, 0);
    assert_true(file >= 0);
    strcpy(address.sun_path, path);
    address.sun_path[0] = path[0] == '@' ? 0 : path[0];
    const size_t size = offsetof(struct sockaddr_un, sun_path) + strlen(path);
    assert_int_equal(bind(file, (const struct sockaddr *)&address, (socklen_t)size), 0);
    assert_int_equal(setsockopt(file, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience), 0);
    assert_int_equal(setenv("NOTIFY_SOCKET", path, 1), 0);
    return file;
}

static void assert_told(int file, const char *expected) {
    char text[1024] = "";
    const ssize_t size = recv(file, text, sizeof text - 1, 0);
    assert_true(size >= 0);
    assert_string_equal(text, expected);
}

static void assert_nothing_told(int file) {
    char byte;
    assert_int_equal(recv(file, &byte, 1, MSG_DONTWAIT), -1);
}

static void test_sockets(void **state) {
    (void)state;
    char folder[] = "/tmp/notify.XXXXXX", path[64], abstract[64];
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/socket", folder);
    snprintf(abstract, sizeof abstract, "@portmet-test-%ld", (long)getpid());
    const char *const paths[] = {path, abstract};
    for (int i = 0; i < 2; ++i) {
        const int file = listen_at(paths[i]);
        pm_notify("READY=1");
        assert_told(file, "READY=1");
        pm_notify("WATCHDOG=1\nSTATUS=step %d of %d", 3, 200);
        assert_told(file, "WATCHDOG=1\nSTATUS=step 3 of 200");
        assert_nothing_told(file);
        close(file);
    }
    unlink(path);
    rmdir(folder);
}

// Without a service manager, with one that is gone, or with a name that is none, nothing happens.
static void test_nobody(void **state) {
    (void)state;
    char longer[200];
    memset(longer, 'x', sizeof longer - 1);
    longer[0] = '/';
    longer[sizeof longer - 1] = 0;
    const char *const paths[] = {"/nowhere/socket", "relative", "", longer};
    for (size_t i = 0; i < sizeof paths / sizeof paths[0]; ++i) {
        assert_int_equal(setenv("NOTIFY_SOCKET", paths[i], 1), 0);
        pm_notify("READY=1");
    }
    unsetenv("NOTIFY_SOCKET");
    pm_notify("READY=1");
}

// A manager that does not read does not hold the run, and a long text is cut.
static void test_manager_that_does_not_read(void **state) {
    (void)state;
    char name[64], text[2000], expected[512];
    snprintf(name, sizeof name, "@portmet-test-%ld-full", (long)getpid());
    const int file = listen_at(name);
    memset(text, 's', sizeof text - 1);
    text[sizeof text - 1] = 0;
    memset(expected, 's', sizeof expected - 1);
    expected[sizeof expected - 1] = 0;
    for (int i = 0; i < 10000; ++i) {
        pm_notify("%s", text);
    }
    assert_told(file, expected);
    close(file);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_sockets),
        cmocka_unit_test(test_nobody),
        cmocka_unit_test(test_manager_that_does_not_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
