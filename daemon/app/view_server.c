// HTTP and websockets by libwebsockets, whose event loop runs in pm_view_server_serve.
#include "app/view_server.h"

#include "base/arena.h"

#ifdef PM_WEBSOCKETS
#include <arpa/inet.h>
#include <libwebsockets.h>
#include <stdlib.h>
#include <string.h>

// The files of the page (daemon/view), which the build embeds as arrays of lines that end with
// NULL.
extern const char *const pm_view_html[];
extern const char *const pm_view_css[];
extern const char *const pm_view_js[];

enum { NFILE = 3, HEADER_SIZE = 1024, HOST_SIZE = 256, RECEIVE_SIZE = 512 };

// A file of the page. `text` has LWS_PRE bytes of room before its `size` bytes.
typedef struct page_file {
    const char *path, *type;
    const char *const *line;
    unsigned char *text;
    size_t size;
} page_file;

struct pm_view_server {
    struct lws_context *context;
    const struct lws_protocols *protocol;
    page_file file[NFILE];
    pm_view_next *next;
    pm_view_hear *hear;
    void *next_context;
    int nclient;
    struct lws *client[PM_VIEW_CLIENTS + 1]; // [nclient] the websockets, the oldest first
    lws_sorted_usec_list_t timer;
    bool due; // the time to serve is over
};

// The library keeps one of these for each connection, with zeros at the start.
typedef struct connection {
    const page_file *file;
    pm_view_progress progress;
} connection;

// --- who may ask ---

// Copies a header; returns false if it is absent or too long.
static bool get_header(struct lws *wsi, enum lws_token_indexes token, char *text) {
    return lws_hdr_total_length(wsi, token) > 0 && lws_hdr_copy(wsi, text, HOST_SIZE, token) > 0;
}

// Returns true if the host of the request is an address or "localhost".
static bool has_good_host(struct lws *wsi) {
    char host[HOST_SIZE];
    struct in_addr address;
    if (!get_header(wsi, WSI_TOKEN_HOST, host)) {
        return false;
    }
    host[strcspn(host, ":")] = 0;
    return strcmp(host, "localhost") == 0 || inet_pton(AF_INET, host, &address) == 1;
}

// Returns true if the request comes from the page itself, or from no page at all.
static bool has_good_origin(struct lws *wsi) {
    static const char scheme[] = "http://";
    char host[HOST_SIZE], origin[HOST_SIZE];
    if (lws_hdr_total_length(wsi, WSI_TOKEN_ORIGIN) == 0) {
        return true;
    }
    return get_header(wsi, WSI_TOKEN_HOST, host) && get_header(wsi, WSI_TOKEN_ORIGIN, origin) &&
           strncmp(origin, scheme, sizeof scheme - 1) == 0 &&
           strcmp(origin + sizeof scheme - 1, host) == 0;
}

// --- HTTP ---

// Answers with a status alone, and closes the connection.
static int refuse(struct lws *wsi, unsigned code, const char *why) {
    (void)lws_return_http_status(wsi, code, why);
    return -1;
}

// Refuses a request, or begins to answer it with a file.
static int on_request(const pm_view_server *s, struct lws *wsi, connection *c, const char *path) {
    if (!has_good_host(wsi)) {
        return refuse(wsi, HTTP_STATUS_FORBIDDEN, "Use the address of this host, or localhost.");
    }
    if (lws_hdr_total_length(wsi, WSI_TOKEN_GET_URI) == 0) {
        return refuse(wsi, HTTP_STATUS_METHOD_NOT_ALLOWED, "Only GET is answered.");
    }
    const page_file *file = s->file;
    while (file < s->file + NFILE && strcmp(path, file->path) != 0) {
        ++file;
    }
    if (file == s->file + NFILE) {
        return refuse(wsi, HTTP_STATUS_NOT_FOUND, "The page is at /.");
    }
    unsigned char header[LWS_PRE + HEADER_SIZE], *start = header + LWS_PRE, *at = start;
    unsigned char *end = header + sizeof header - 1;
    static const char keep[] = "no-store";
    if (lws_add_http_common_headers(wsi, HTTP_STATUS_OK, file->type, file->size, &at, end) != 0 ||
        lws_add_http_header_by_token(wsi, WSI_TOKEN_HTTP_CACHE_CONTROL, (const unsigned char *)keep,
                                     sizeof keep - 1, &at, end) != 0 ||
        lws_finalize_write_http_header(wsi, start, &at, end) != 0) {
        return -1;
    }
    c->file = file;
    lws_callback_on_writable(wsi);
    return 0;
}

// --- websockets ---

static int on_event(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in,
                    size_t length) {
    pm_view_server *s = lws_context_user(lws_get_context(wsi));
    connection *c = user;
    switch ((int)reason) {
    case LWS_CALLBACK_HTTP:
        return on_request(s, wsi, c, in);
    case LWS_CALLBACK_HTTP_WRITEABLE: {
        if (c->file == NULL) {
            return 0;
        }
        const page_file *file = c->file;
        c->file = NULL;
        return lws_write(wsi, file->text + LWS_PRE, file->size, LWS_WRITE_HTTP_FINAL) < 0
                   ? -1
                   : lws_http_transaction_completed(wsi);
    }
    case LWS_CALLBACK_HTTP_CONFIRM_UPGRADE:
        // 0: the client may have a websocket; 1: it was refused.
        return has_good_host(wsi) && has_good_origin(wsi)
                   ? 0
                   : -refuse(wsi, HTTP_STATUS_FORBIDDEN, "This page must not listen here.");
    case LWS_CALLBACK_ESTABLISHED:
        if (s->nclient == PM_VIEW_CLIENTS + 1) { // those that are to be closed are still there
            return -1;
        }
        s->client[s->nclient++] = wsi;
        if (s->nclient > PM_VIEW_CLIENTS) {
            // The client that came first makes room, so that idle clients lock nobody out.
            lws_set_timeout(s->client[0], PENDING_TIMEOUT_USER_OK, LWS_TO_KILL_ASYNC);
        }
        lws_callback_on_writable(wsi);
        return 0;
    case LWS_CALLBACK_CLOSED:
        for (int i = 0; i < s->nclient; ++i) {
            if (s->client[i] == wsi) {
                s->nclient -= 1;
                memmove(&s->client[i], &s->client[i + 1], (size_t)(s->nclient - i) * sizeof wsi);
            }
        }
        return 0;
    case LWS_CALLBACK_SERVER_WRITEABLE: {
        // Sends the next message to a client, if there is one, and asks for the time of another.
        char *text = NULL;
        size_t size = 0;
        FILE *file = open_memstream(&text, &size);
        if (file == NULL) {
            return -1;
        }
        fprintf(file, "%*s", LWS_PRE, "");
        const bool more = s->next(s->next_context, &c->progress, file);
        bool good = fclose(file) == 0;
        if (good && more) {
            good = lws_write(wsi, (unsigned char *)text + LWS_PRE, size - LWS_PRE,
                             LWS_WRITE_TEXT) >= 0;
            lws_callback_on_writable(wsi);
        }
        free(text);
        return good ? 0 : -1;
    }
    case LWS_CALLBACK_RECEIVE: {
        char word[PM_VIEW_WORD] = "";
        if (length < sizeof word && lws_is_first_fragment(wsi) && lws_is_final_fragment(wsi)) {
            memcpy(word, in, length);
            s->hear(s->next_context, word);
        }
        return 0;
    }
    default:
        return 0;
    }
}

// --- opening ---

pm_status pm_view_server_open(pm_view_server **server, const char *address, int port,
                              pm_view_next *next, pm_view_hear *hear, void *context) {
    pm_view_server *s = NULL;
    PM_TRY(PM_NEW(s, "the page of a view"));
    const page_file files[NFILE] = {
        {.path = "/", .type = "text/html; charset=utf-8", .line = pm_view_html},
        {.path = "/view.css", .type = "text/css; charset=utf-8", .line = pm_view_css},
        {.path = "/view.js", .type = "text/javascript; charset=utf-8", .line = pm_view_js},
    };
    pm_status status;
    s->next = next;
    s->hear = hear;
    s->next_context = context;
    memcpy(s->file, files, sizeof files);
    for (int i = 0; i < NFILE; ++i) {
        page_file *file = &s->file[i]; // its lines are joined
        for (int k = 0; file->line[k] != NULL; ++k) {
            file->size += strlen(file->line[k]);
        }
        file->text = malloc(LWS_PRE + file->size + 1);
        PM_TRY_DONE(pm_allocated(file->text, "the page of a view"));
        char *at = (char *)file->text + LWS_PRE;
        for (int k = 0; file->line[k] != NULL; ++k) {
            at = stpcpy(at, file->line[k]);
        }
    }
    static const struct lws_protocols protocols[] = {{.name = "portmet",
                                                      .callback = on_event,
                                                      .per_session_data_size = sizeof(connection),
                                                      .rx_buffer_size = RECEIVE_SIZE},
                                                     {.name = NULL}};
    const struct lws_context_creation_info info = {
        .port = port,
        .iface = address,
        .protocols = protocols,
        .gid = -1,
        .uid = -1,
        .user = s,
        .options = LWS_SERVER_OPTION_FAIL_UPON_UNABLE_TO_BIND | LWS_SERVER_OPTION_DISABLE_IPV6 |
                   LWS_SERVER_OPTION_HTTP_HEADERS_SECURITY_BEST_PRACTICES_ENFORCE,
    };
    lws_set_log_level(0, NULL);
    s->protocol = &protocols[0];
    s->context = lws_create_context(&info);
    if (s->context == NULL) {
        PM_TRY_DONE(pm_fail(
            PM_ENET, "cannot listen on port %d of %s: it is in use, or no address of this host",
            port, address));
    }
    *server = s;
    return PM_OK;
done:
    pm_view_server_close(s);
    return status;
}

void pm_view_server_close(pm_view_server *server) {
    if (server == NULL) {
        return;
    }
    if (server->context != NULL) {
        lws_context_destroy(server->context);
    }
    for (int i = 0; i < NFILE; ++i) {
        free(server->file[i].text);
    }
    free(server);
}

// --- serving ---

// Ends the wait of the library, which would otherwise wait on after a timer.
static void on_timer(lws_sorted_usec_list_t *timer) {
    pm_view_server *s = lws_container_of(timer, pm_view_server, timer);
    s->due = true;
    lws_cancel_service(s->context);
}

pm_status pm_view_server_serve(pm_view_server *server, double seconds,
                               const volatile sig_atomic_t *stop) {
    server->due = false;
    lws_callback_on_writable_all_protocol(server->context, server->protocol); // offers new messages
    lws_sul_schedule(server->context, 0, &server->timer, on_timer, (lws_usec_t)(1e6 * seconds));
    while (!server->due && *stop == 0) {
        if (lws_service(server->context, 0) < 0 && *stop == 0) {
            return pm_fail(PM_ENET, "view: the server has failed");
        }
    }
    return PM_OK;
}

#else // a program that was built without libwebsockets has no server

pm_status pm_view_server_open(pm_view_server **server, const char *address, int port,
                              pm_view_next *next, pm_view_hear *hear, void *context) {
    (void)server, (void)address, (void)next, (void)hear, (void)context;
    return pm_fail(PM_ENET,
                   "no page on port %d: this portmetd was built without libwebsockets "
                   "(libwebsockets-dev); --udp works without it",
                   port);
}

void pm_view_server_close(pm_view_server *server) {
    (void)server;
}

pm_status pm_view_server_serve(pm_view_server *server, double seconds,
                               const volatile sig_atomic_t *stop) {
    (void)server, (void)seconds, (void)stop;
    return PM_OK;
}

#endif
