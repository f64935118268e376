// The server of the view must refuse or answer any bytes of a connection, and answer another
// browser afterwards. The bytes are those of a browser: a request, and frames of a websocket if it
// asks for one. The first one says how many of the others arrive in a first piece.
#include <errno.h>
#include <sys/socket.h>
#include <unistd.h>

// The connections arrive through the library's own door for sockets that others have accepted.
#include "app/view_server.c"
#include "tests/fuzz/target.h"

#define MOST_TURNS 100 // of the server for a connection

// Each client is sent two messages.
static bool next_message(void *context, pm_view_progress *progress, FILE *file) {
    (void)context;
    if (progress->frame == 2) {
        return false;
    }
    progress->frame += 1;
    fputs("{\"frame\":{}}", file);
    return true;
}

static void hear_word(void *context, const char *word) {
    (void)context;
    check(memchr(word, 0, PM_VIEW_WORD) != NULL);
}

static void turn(pm_view_server *server) {
    static const volatile sig_atomic_t stop;
    check(pm_view_server_serve(server, 1e-6, &stop) == PM_OK);
}

static int connect_browser(pm_view_server *server) {
    int end[2];
    check(socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0, end) == 0);
    check(lws_adopt_socket(server->context, end[0]) != NULL);
    return end[1];
}

// Sends bytes, and lets the server work until it closes the connection or has no answer.
static void talk(pm_view_server *server, int browser, const void *data, size_t size,
                 const char *expected) {
    char answer[4096];
    bool answered = expected == NULL;
    if (size > 0 && send(browser, data, size, MSG_NOSIGNAL) < 0) {
        return; // the server has closed the connection, or does not read
    }
    for (int i = 0, quiet = 0; i < MOST_TURNS && quiet < 3; ++i) {
        turn(server);
        const ssize_t n = recv(browser, answer, sizeof answer, 0);
        quiet = n > 0 ? 0 : quiet + 1;
        answered = answered || (n > 0 && memmem(answer, (size_t)n, expected, strlen(expected)));
        if (n == 0) {
            break;
        }
    }
    check(answered);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char good[] = "GET /view.css HTTP/1.1\r\nHost: localhost\r\n\r\n";
    static pm_view_server *server;
    if (server == NULL) {
        check(pm_view_server_open(&server, "127.0.0.1", 0, next_message, hear_word, NULL) == PM_OK);
    }
    const size_t first = size == 0 ? 0 : (size - 1) * data[0] / UINT8_MAX;
    int browser = connect_browser(server);
    if (size > 0) {
        talk(server, browser, data + 1, first, NULL);
        talk(server, browser, data + 1 + first, size - 1 - first, NULL);
    }
    close(browser);
    browser = connect_browser(server);
    talk(server, browser, good, sizeof good - 1, "200 OK");
    close(browser);
    for (int i = 0; i < MOST_TURNS && (i == 0 || server->nclient > 0); ++i) {
        turn(server);
    }
    check(server->nclient == 0);
    return 0;
}
