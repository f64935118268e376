// Requests and replies of a client.
#include "lockstep/remote.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/progress.h"
#include "lockstep/coordinator.h"
#include "store/yaml.h"

#define ASK_FIRST 0.02 // s until a request is repeated; each time takes twice as long
#define ASK_LAST 1.0   // s
#define ASKS 4.0       // times at least that a request is repeated before it fails
#define LOOK 0.1       // s between two looks at the stop flag
#define MOST_PAGES 2000

struct pm_client {
    pm_arena arena;
    pm_transport *transport;
    pm_remote_options options;
    pm_served served;
    char channel[PM_CHANNEL_SIZE];
    portmet_control_t request;
    portmet_control_reply_t reply, next; // the last one to this client; the one being decoded
    char text[PM_TEXT_MAX + 1], owner[PM_TEXT_MAX + 1]; // of `reply`
    double heard;                                       // s, when it came
    // The present request: whether it waits until it is done, whether there was a reply to it, when
    // it is repeated and how long after that again (s), and since when (s) the run has waited for a
    // live input after which step.
    bool whole, replied, starved; // starved: it has failed, since nobody gives the input
    double again, pause, awaited;
    int64_t awaited_step;
    double slice;        // s of waiting at a time; 0: any
    int64_t digest;      // of what is served; 0: not known yet
    unsigned char *data; // [capacity] the encoded request
    size_t capacity;
};

static void on_reply(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_client *r = context;
    portmet_control_reply_t *next = &r->next;
    next->npart = r->served.nsubsystem;
    next->nend = 2 * r->served.nport;
    next->nz = r->served.nz;
    if (pm_control_reply_decode(next, data, size) != PM_KEEP || next->client != r->request.client ||
        next->nonce != r->request.nonce) {
        return;
    }
    const portmet_control_reply_t before = r->reply; // they trade places, arrays included
    r->reply = *next;
    *next = before;
    snprintf(r->text, sizeof r->text, "%s", r->reply.text);
    snprintf(r->owner, sizeof r->owner, "%s", r->reply.owner);
    r->reply.text = r->text;
    r->reply.owner = r->owner;
    r->heard = pm_clock();
}

pm_status pm_remote_ask(pm_client *r, const portmet_control_t *request, bool wait) {
    const int64_t client = r->request.client, nonce = r->request.nonce, ticket = r->request.ticket;
    r->request = *request;
    r->request.client = client;
    r->request.nonce = nonce + 1;
    r->request.ticket = ticket;
    r->request.session = r->options.session;
    r->request.sender = (char *)r->options.sender;
    r->request.file = request->file == NULL ? "" : request->file;
    r->heard = pm_clock();
    r->whole = wait;
    r->replied = r->starved = false;
    r->again = 0;
    r->pause = ASK_FIRST;
    r->awaited = INFINITY;
    return pm_remote_wait(r);
}

// Fails once the run has waited for a live input, after the same step, for as long as the client
// waits for an answer.
static pm_status check_awaited(pm_client *r, double now) {
    if (r->reply.kind != PORTMET_CONTROL_REPLY_T_PENDING || r->text[0] == '\0') {
        r->awaited = INFINITY;
    } else if (!isfinite(r->awaited) || r->awaited_step != r->reply.step) {
        r->awaited = now;
        r->awaited_step = r->reply.step;
    } else if (now > r->awaited + r->options.patience) {
        r->starved = true;
        return pm_fail(PM_ETIMEOUT, "scene %s: %s, and none has come within %g s", r->options.scene,
                       r->reply.text, r->options.patience);
    }
    return PM_OK;
}

pm_status pm_remote_wait(pm_client *r) {
    const double begin = pm_clock();
    // A client with little patience asks often enough to hear that somebody is there.
    const double longest = fmin(ASK_LAST, r->options.patience / ASKS);
    for (double now = begin;; now = pm_clock()) {
        if (now >= r->again) {
            const size_t size = pm_control_encode(&r->request, r->data, r->capacity);
            PM_TRY(size > 0 ? PM_OK
                            : pm_fail(PM_EUSAGE, "a number is not finite, or there are too many"));
            PM_TRY(pm_transport_publish(r->transport, r->channel, r->data, size));
            r->again = now + r->pause;
            r->pause = fmin(2 * r->pause, longest);
        }
        const double before = r->heard;
        PM_TRY(pm_transport_wait(r->transport, fmin(r->again - now, LOOK), NULL));
        if (r->options.stop != NULL && *r->options.stop != 0) {
            return pm_fail(PM_EINTERRUPTED, "interrupted");
        }
        const portmet_control_reply_t *reply = &r->reply;
        if (r->heard == before) {
            if (r->slice > 0 && now > begin + r->slice) {
                return pm_fail(PM_EINTERRUPTED, "no answer yet");
            }
            if (now > r->heard + r->options.patience) {
                const bool known = r->replied || r->digest == 0;
                return pm_fail(PM_ETIMEOUT, "no service of scene %s answers within %g s%s%s",
                               r->options.scene, r->options.patience,
                               known ? "" : ", or not all of its processes are there",
                               pm_transport_reach(r->transport));
            }
            continue;
        }
        r->replied = true;
        PM_TRY(check_awaited(r, now));
        if (reply->kind == PORTMET_CONTROL_REPLY_T_AGAIN) {
            if (reply->ticket != r->request.ticket || reply->last >= r->request.nonce) {
                r->again = 0;
            }
            r->request.ticket = reply->ticket;
            if (reply->last >= r->request.nonce) { // somebody forged a request of this client
                r->request.nonce = reply->last + 1;
            }
        } else if (r->digest != 0 && reply->digest != r->digest) {
            return pm_fail(PM_ECONFIG, "scene %s was read again meanwhile, and is another one now",
                           r->options.scene);
        } else if (reply->kind == PORTMET_CONTROL_REPLY_T_REFUSED) {
            return pm_fail(pm_endpoint_code(reply->code), "refused: %s", reply->text);
        } else if (reply->kind == PORTMET_CONTROL_REPLY_T_DONE ||
                   (reply->kind == PORTMET_CONTROL_REPLY_T_ACCEPTED && !r->whole)) {
            return reply->code == 0 ? PM_OK
                                    : pm_fail(pm_endpoint_code(reply->code), "%s",
                                              reply->text[0] == '\0' ? "the service gives no reason"
                                                                     : reply->text);
        }
    }
}

// --- what is served ---

// Makes an array of `count` texts.
static const char **texts(pm_client *r, int count) {
    return pm_arena_array(&r->arena, (size_t)count, sizeof(char *));
}

// Reads the names of a state's variables and their units: "groups": [[name, unit, size], ...].
static pm_status read_groups(pm_client *r, const char *owner, pm_yaml groups, bool counts) {
    for (int g = 0; g < pm_yaml_count(groups); ++g) {
        const pm_yaml group = pm_yaml_item(groups, g);
        const char *name, *unit;
        int size;
        PM_TRY(pm_yaml_text(pm_yaml_item(group, 0), &r->arena, &name));
        PM_TRY(pm_yaml_text(pm_yaml_item(group, 1), &r->arena, &unit));
        PM_TRY(pm_yaml_int(pm_yaml_item(group, 2), 1, PM_SCENE_MOST_STATE - r->served.nz, &size));
        for (int i = 0; i < size && !counts; ++i) {
            r->served.variable[r->served.nz + i] =
                pm_arena_printf(&r->arena, "%s.%s[%d]", owner, name, i);
            r->served.unit[r->served.nz + i] = unit;
        }
        r->served.nz += size;
    }
    return PM_OK;
}

// Reads what the client needs of the description.
static pm_status read_description(pm_client *r, pm_yaml root) {
    pm_served *s = &r->served;
    pm_yaml subsystems, ports, inputs, value;
    PM_TRY(pm_yaml_require(root, "dt", &value));
    PM_TRY(pm_yaml_double(value, 0, INFINITY, &s->dt));
    PM_TRY(pm_yaml_require(root, "steps", &value));
    PM_TRY(pm_yaml_int(value, 0, INT_MAX, &s->steps));
    PM_TRY(pm_yaml_require(root, "subsystems", &subsystems));
    PM_TRY(pm_yaml_require(root, "ports", &ports));
    PM_TRY(pm_yaml_require(root, "inputs", &inputs));
    s->nsubsystem = pm_yaml_count(subsystems);
    s->nport = pm_yaml_count(ports);
    s->nlive = pm_yaml_count(inputs);
    s->subsystem = texts(r, s->nsubsystem);
    s->port = texts(r, s->nport);
    s->end_a = texts(r, s->nport);
    s->end_b = texts(r, s->nport);
    s->live = texts(r, s->nlive);
    s->live_unit = texts(r, s->nlive);
    PM_TRY(pm_arena_status(&r->arena, "what is served"));
    for (int pass = 0; pass < 2; ++pass) { // the first one counts
        s->variable = texts(r, s->nz);
        s->unit = texts(r, s->nz);
        PM_TRY(pm_arena_status(&r->arena, "what is served"));
        s->nz = 0;
        for (int i = 0; i < s->nsubsystem; ++i) {
            const pm_yaml subsystem = pm_yaml_item(subsystems, i);
            PM_TRY(pm_yaml_text(pm_yaml_get(subsystem, "name"), &r->arena, &s->subsystem[i]));
            PM_TRY(read_groups(r, s->subsystem[i], pm_yaml_get(subsystem, "groups"), pass == 0));
        }
    }
    for (int i = 0; i < s->nport; ++i) {
        const pm_yaml port = pm_yaml_item(ports, i), ends = pm_yaml_get(port, "ends");
        PM_TRY(pm_yaml_text(pm_yaml_get(port, "name"), &r->arena, &s->port[i]));
        PM_TRY(pm_yaml_text(pm_yaml_item(ends, 0), &r->arena, &s->end_a[i]));
        PM_TRY(pm_yaml_text(pm_yaml_item(ends, 1), &r->arena, &s->end_b[i]));
    }
    for (int i = 0; i < s->nlive; ++i) {
        const pm_yaml input = pm_yaml_item(inputs, i);
        PM_TRY(pm_yaml_text(pm_yaml_item(input, 0), &r->arena, &s->live[i]));
        PM_TRY(pm_yaml_text(pm_yaml_item(input, 2), &r->arena, &s->live_unit[i]));
    }
    return pm_arena_status(&r->arena, "what is served");
}

// Asks for all pages of the description.
static pm_status query(pm_client *r) {
    portmet_control_t request = {.kind = PORTMET_CONTROL_T_QUERY};
    char *text = NULL;
    size_t size;
    FILE *file = open_memstream(&text, &size);
    pm_status status = file == NULL ? pm_fail(PM_ENOMEM, "what is served") : PM_OK;
    do {
        status = status == PM_OK ? pm_remote_ask(r, &request, true) : status;
        if (status == PM_OK) {
            fputs(r->reply.text, file);
            r->digest = r->reply.digest;
            request.page += 1;
        }
    } while (status == PM_OK && request.page < r->reply.pages && request.page < MOST_PAGES);
    if (file != NULL) {
        fclose(file);
    }
    if (status == PM_OK) {
        r->served.description = pm_arena_printf(&r->arena, "%s", text);
        status = pm_arena_status(&r->arena, "what is served");
    }
    free(text);
    return status;
}

pm_status pm_remote_open(pm_client **remote, pm_transport *transport,
                         const pm_remote_options *options) {
    char replies[PM_CHANNEL_SIZE];
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status;
    pm_client *r = NULL;
    PM_TRY(PM_NEW(r, "a client"));
    r->transport = transport;
    r->options = *options;
    r->request.client = pm_lockstep_session();
    r->capacity = pm_control_size(&(portmet_control_t){.sender = "", .file = ""}) + PM_TEXT_MAX;
    r->data = pm_arena_alloc(&r->arena, r->capacity);
    PM_TRY_DONE(pm_arena_status(&r->arena, "a client"));
    PM_TRY_DONE(pm_channel_scene(r->channel, options->scene, "CONTROL"));
    PM_TRY_DONE(pm_channel_scene(replies, options->scene, "REPLY"));
    PM_TRY_DONE(pm_transport_subscribe(transport, replies, on_reply, r));
    PM_TRY_DONE(query(r));
    PM_TRY_DONE(pm_yaml_parse(&document, r->served.description, "what is served", &root));
    PM_TRY_DONE(read_description(r, root));
    r->capacity += ((size_t)r->served.nz + (size_t)r->served.nlive) * sizeof(double) + PM_TEXT_MAX;
    r->data = pm_arena_alloc(&r->arena, r->capacity);
    PM_TRY_DONE(pm_arena_status(&r->arena, "a client"));
    r->reply.npart = r->next.npart = r->served.nsubsystem;
    r->reply.nend = r->next.nend = 2 * r->served.nport;
    r->reply.nz = r->next.nz = r->served.nz;
    PM_TRY_DONE(pm_control_reply_alloc(&r->reply, &r->arena));
    PM_TRY_DONE(pm_control_reply_alloc(&r->next, &r->arena));
    *remote = r;
    r = NULL;
done:
    pm_yaml_close(document);
    pm_remote_close(r);
    return status;
}

void pm_remote_close(pm_client *remote) {
    PM_DELETE(remote);
}

void pm_remote_interrupt_after(pm_client *remote, double seconds) {
    remote->slice = seconds;
}

bool pm_remote_awaits_input(const pm_client *remote) {
    return remote->starved;
}

const pm_served *pm_remote_served(const pm_client *remote) {
    return &remote->served;
}

const portmet_control_reply_t *pm_remote_reply(const pm_client *remote) {
    return &remote->reply;
}
