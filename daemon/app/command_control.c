// portmetd start, pause, resume, advance, set, reset, stop and query: one request each to the
// coordinator of `portmetd serve`.
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "app/command.h"
#include "app/connect.h"
#include "base/arena.h"
#include "base/progress.h"
#include "lockstep/codec.h"
#include "lockstep/coordinator.h"
#include "transport/channel.h"

#define PATIENCE 10.0  // s without any reply, after which the command gives up
#define ASK_FIRST 0.02 // s until the request is repeated; each time takes twice as long
#define ASK_LAST 1.0   // s

typedef struct asker {
    pm_scene *scene;
    pm_transport *transport;
    pm_arena arena;
    char channel[PM_CHANNEL_SIZE];
    portmet_control_t request;
    portmet_control_reply_t reply, next; // the last one to this client; the one being decoded
    char text[PM_TEXT_MAX + 1], owner[PM_TEXT_MAX + 1]; // of `reply`
    double heard;                                       // s, when it came
} asker;

static void on_reply(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    asker *a = context;
    portmet_control_reply_t *next = &a->next;
    next->npart = a->scene->physics.nsubsystem;
    next->nend = 2 * a->scene->physics.nport;
    next->nz = a->scene->physics.nz;
    if (pm_control_reply_decode(next, data, size) != PM_KEEP || next->client != a->request.client ||
        next->nonce != a->request.nonce) {
        return;
    }
    const portmet_control_reply_t before = a->reply; // they trade places, arrays included
    a->reply = *next;
    *next = before;
    snprintf(a->text, sizeof a->text, "%s", a->reply.text);
    snprintf(a->owner, sizeof a->owner, "%s", a->reply.owner);
    a->heard = pm_clock();
}

// Sends a request, and repeats it until it is done, or as soon as it is accepted if `wait` is
// false. PM_ETIMEOUT: nobody replies.
static pm_status ask(asker *a, int8_t kind, bool wait, const volatile sig_atomic_t *stop) {
    a->request.kind = kind;
    a->request.nonce += 1;
    a->heard = pm_clock();
    bool replied = false;
    const size_t capacity = pm_control_size(&a->request);
    unsigned char *data = pm_arena_alloc(&a->arena, capacity);
    PM_TRY(pm_arena_status(&a->arena, "a request"));
    for (double pause = ASK_FIRST, again = 0, now = pm_clock();; now = pm_clock()) {
        if (now >= again) {
            const size_t size = pm_control_encode(&a->request, data, capacity);
            PM_TRY(size > 0 ? PM_OK : pm_fail(PM_EUSAGE, "a value is not finite"));
            PM_TRY(pm_transport_publish(a->transport, a->channel, data, size));
            again = now + pause;
            pause = fmin(2 * pause, ASK_LAST);
        }
        const double before = a->heard;
        PM_TRY(pm_transport_wait(a->transport, fmin(again - now, 0.1), NULL));
        PM_TRY(*stop ? pm_fail(PM_EINTERRUPTED, "interrupted") : PM_OK);
        const bool heard = a->heard > before;
        replied = replied || heard;
        if (heard && a->reply.kind == PORTMET_CONTROL_REPLY_T_AGAIN) {
            const bool news =
                a->reply.ticket != a->request.ticket || a->reply.last >= a->request.nonce;
            again = news ? 0 : again;
            a->request.ticket = a->reply.ticket;
            if (a->reply.last >= a->request.nonce) { // somebody forged a request of this client
                a->request.nonce = a->reply.last + 1;
            }
            continue;
        }
        if (heard && a->reply.kind == PORTMET_CONTROL_REPLY_T_REFUSED) {
            return pm_fail(pm_endpoint_code(a->reply.code), "refused: %s", a->text);
        }
        if (heard && (!wait || a->reply.kind == PORTMET_CONTROL_REPLY_T_DONE)) {
            return a->reply.code == 0 ? PM_OK
                                      : pm_fail(pm_endpoint_code(a->reply.code), "%s", a->text);
        }
        if (now > a->heard + PATIENCE) {
            return pm_fail(PM_ETIMEOUT, "%s of scene %s answers within %g s",
                           replied ? "the service no longer" : "no service, or not all processes,",
                           a->scene->name, PATIENCE);
        }
    }
}

// Reads numbers with commas between them into an array of `count`; NULL is allowed.
static pm_status read_numbers(asker *a, const char *name, const char *text, int count,
                              int32_t *found, double **values) {
    if (text == NULL) {
        return PM_OK;
    }
    *values = pm_arena_array(&a->arena, (size_t)count, sizeof **values);
    PM_TRY(pm_arena_status(&a->arena, "%s", name));
    char *at = (char *)text;
    for (*found = 0; *found < count && at != NULL; ++*found) {
        char *end;
        errno = 0;
        (*values)[*found] = strtod(at, &end);
        if (end == at || (*end != ',' && *end != 0)) {
            return pm_fail(PM_EUSAGE, "%s: expected numbers with commas between them, found \"%s\"",
                           name, at);
        }
        at = *end == ',' ? end + 1 : NULL;
    }
    return *found == count && at == NULL
               ? PM_OK
               : pm_fail(PM_EUSAGE, "%s: expected %d numbers", name, count);
}

static pm_status control(const pm_run_options *options, int8_t kind) {
    static const char *const phases[] = {"waits for processes", "idle", "running", "held", "ended"};
    asker a = {0};
    portmet_control_t *r = &a.request;
    const portmet_control_reply_t *reply = &a.reply;
    const char *address;
    char replies[PM_CHANNEL_SIZE], host[64] = "";
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&a.scene, options->scene));
    PM_TRY_DONE(pm_connect_check(a.scene));
    PM_TRY_DONE(pm_connect_listener(a.scene, options->url, &address));
    (void)gethostname(host, sizeof host - 1);
    a.request.client = pm_lockstep_session();
    a.request.record = "";
    a.request.sender = (char *)pm_arena_printf(&a.arena, "%s@%s", options->log.part, host);
    a.reply.npart = a.next.npart = a.scene->physics.nsubsystem;
    a.reply.nend = a.next.nend = 2 * a.scene->physics.nport;
    a.reply.nz = a.next.nz = a.scene->physics.nz;
    PM_TRY_DONE(pm_control_reply_alloc(&a.reply, &a.arena));
    PM_TRY_DONE(pm_control_reply_alloc(&a.next, &a.arena));
    PM_TRY_DONE(pm_connect_open(&a.transport, a.scene, address, options->log.part, &options->log));
    PM_TRY_DONE(pm_channel_scene(a.channel, a.scene, "CONTROL"));
    PM_TRY_DONE(pm_channel_scene(replies, a.scene, "REPLY"));
    PM_TRY_DONE(pm_transport_subscribe(a.transport, replies, on_reply, &a));
    const bool starts = kind == PORTMET_CONTROL_T_START;
    r->steps = options->steps > 0 ? options->steps : starts ? a.scene->run.steps : 1;
    r->steps = options->endless ? 0 : r->steps;
    r->held = options->held;
    r->record = options->record == NULL ? "" : (char *)options->record;
    if (options->pace != NULL) {
        char *end;
        r->pace = strtod(options->pace, &end);
        if (end == options->pace || *end != 0 || r->pace < 0) {
            status = pm_fail(PM_EUSAGE, "--pace: expected a number of at least 0, found \"%s\"",
                             options->pace);
            goto done;
        }
        r->pace = r->pace == 0 ? -1 : r->pace;
    }
    PM_TRY_DONE(read_numbers(&a, "--state", options->state, a.scene->physics.nz, &r->nz, &r->z));
    PM_TRY_DONE(
        read_numbers(&a, "--inputs", options->inputs, a.scene->network.nlive, &r->nlive, &r->live));
    PM_TRY_DONE(ask(&a, kind, !starts || options->wait, options->stop));
    if (!options->quiet) {
        printf("%s: %s", a.scene->name,
               phases[reply->phase < 0 || reply->phase > 4 ? 0 : reply->phase]);
        if (a.owner[0] != 0) {
            printf(", run %lld of %s, step %lld", (long long)reply->run, a.owner,
                   (long long)reply->step);
            if (reply->steps > 0) {
                printf(" of %lld", (long long)reply->steps);
            }
            printf(", %.12g s; energy %.12g J, entropy %.12g J/K, %lld violations", reply->time,
                   reply->energy, reply->entropy, (long long)reply->violations);
        }
        printf("\n");
        if (reply->nz == a.scene->physics.nz) {
            for (int i = 0; i < reply->nz; ++i) {
                printf("%s%.17g", i == 0 ? "state " : ",", reply->z[i]);
            }
            printf("\n");
        }
    }
    while (kind == PORTMET_CONTROL_T_QUERY && r->page < a.reply.pages) {
        printf("%s", a.text);
        r->page += 1;
        if (r->page == a.reply.pages) {
            printf("\n");
        } else {
            PM_TRY_DONE(ask(&a, kind, true, options->stop));
        }
    }
done:
    pm_transport_close(a.transport);
    pm_arena_free(&a.arena);
    pm_scene_free(a.scene);
    return status;
}

#define EVERY (PM_OPTION_URL | PM_OPTION_LOG | PM_OPTION_QUIET)
#define CONTROL(word, kind, text, more, accepted)                        \
    static pm_status execute_##word(const pm_run_options *options) {     \
        return control(options, PORTMET_CONTROL_T_##kind);               \
    }                                                                    \
    const pm_command pm_command_##word = {.name = #word,                 \
                                          .summary = text,               \
                                          .arguments = "SCENE",          \
                                          .help = more,                  \
                                          .accepts = EVERY | (accepted), \
                                          .execute = execute_##word};

CONTROL(start, START, "begin a run of a scene that is served",
        "Asks `portmetd serve` to begin a run, and prints the state at its start. Without --steps\n"
        "it has as many steps as the scene says. With --wait the command ends when the run does,\n"
        "with the exit code of the run. While another run is under way it is refused.",
        PM_OPTION_STEPS | PM_OPTION_START | PM_OPTION_STATE | PM_OPTION_INPUTS)
CONTROL(pause, PAUSE, "hold a run that is served",
        "Holds the run after the steps that are granted, and prints the state there.", 0)
CONTROL(resume, RESUME, "let a run that is held go on", "Lets the run go on to its last step.", 0)
CONTROL(advance, ADVANCE, "take steps of a run that is held",
        "Takes one step, or as many as --steps says, and holds the run again. Prints the state.",
        PM_OPTION_STEPS)
CONTROL(set, SET, "set the live inputs of a run that is served",
        "The values hold from the next step on, until others arrive.", PM_OPTION_INPUTS)
CONTROL(
    reset, RESET, "begin a run that is served anew",
    "Takes the run to step 0, at the scene's state or at the one given, with the same steps and\n"
    "pace.",
    PM_OPTION_STATE | PM_OPTION_INPUTS)
CONTROL(stop, STOP, "end a run that is served",
        "Ends the run after the steps that are granted. The service waits for another one.", 0)

CONTROL(
    reload, RELOAD, "let a service read its files again",
    "Between two runs all processes read the scene and its weights again. If they cannot be read,\n"
    "or are of another scene, the command is refused and nothing changes.",
    0)
CONTROL(query, QUERY, "print the state of a service, and what it serves",
        "Prints whether a run is under way, and whose, and what is served as a line of JSON:\n"
        "subsystems with the groups of their states, ports, live inputs, digests of weights.",
        0)
