// Subscribes to what a run publishes and assembles samples from it. Reports of different processes
// on one step arrive in any order, so that samples of several steps are incomplete at a time.
#include "lockstep/listener.h"

#include <stdlib.h>

#include "base/progress.h"
#include "lockstep/health.h"
#include "lockstep/lookahead.h"
#include "lockstep/reports.h"

#define MOST_READS 8 // of pm_transport_wait in one pm_listener_read, so that it always returns

typedef struct listened_process {
    struct pm_listener *listener;
    pm_remote_process remote;
} listened_process;

struct pm_listener {
    pm_arena arena;
    pm_transport *transport;
    const pm_scene *scene;
    int64_t wanted, session; // wanted 0: any
    double heard;            // s, when a message of the run last arrived
    bool over, with_state, has_ledger, has_health;
    bool has_state;            // the newest report had the state
    listened_process *process; // [nprocess]
    pm_report_window reports;
    int64_t newest; // step of the newest complete sample; -1: none
    portmet_ledger_t ledger, next_ledger;
    portmet_health_t health, next_health;
    int64_t health_count;
    pm_sample_handler *handler; // NULL: nobody wants every sample
    void *context;              // of the handler
};

// --- which run ---

// Returns true if a message of this session belongs to the run that the listener follows.
static bool follows(pm_listener *l, int64_t session) {
    const double now = pm_clock();
    if (l->wanted != 0 && session != l->wanted) {
        return false;
    }
    if (session != l->session) {
        if (l->session != 0 && !l->over && now - l->heard < PM_LISTENER_SILENT) {
            return false;
        }
        pm_report_window_restart(&l->reports, 0);
        l->newest = -1;
        l->over = l->has_ledger = l->has_health = false;
        l->session = session;
    }
    l->heard = now;
    return true;
}

// --- messages ---

// Reports have the state only if somebody records the run, which a listener cannot know.
static void on_report(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    listened_process *process = context;
    pm_listener *l = process->listener;
    pm_remote_process *remote = &process->remote;
    pm_drop drop = pm_remote_process_decode(remote, data, size, l->with_state);
    if (drop == PM_DROP_COUNT) {
        l->with_state = !l->with_state;
        drop = pm_remote_process_decode(remote, data, size, l->with_state);
    }
    const portmet_report_t *report = &remote->report;
    if (drop != PM_KEEP || report->kind != PORTMET_REPORT_T_DONE || report->step < 0 ||
        report->step > PM_STEPS_MAX || !follows(l, report->session)) {
        return;
    }
    l->has_state = l->with_state;
    for (int row = 0; row < remote->rows && !remote->sums; ++row) {
        const int64_t step = report->step + row;
        if (pm_report_window_reach(&l->reports, step) == l->newest) {
            l->newest = -1; // the newest sample made room, or there was none
        }
        if (pm_report_window_add(&l->reports, remote, row) && step > l->newest &&
            pm_report_window_is_complete(&l->reports, step)) {
            l->newest = step;
            if (l->handler != NULL) {
                l->handler(l->context, pm_report_window_sample(&l->reports, step));
            }
        }
    }
}

static void on_ledger(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_listener *l = context;
    if (pm_ledger_decode(&l->next_ledger, data, size) == PM_KEEP &&
        follows(l, l->next_ledger.session)) {
        l->ledger = l->next_ledger;
        l->has_ledger = true;
    }
}

// The two health messages trade places, arrays included.
static void on_health(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_listener *l = context;
    if (pm_health_decode(&l->next_health, data, size) == PM_KEEP &&
        follows(l, l->next_health.session)) {
        const portmet_health_t before = l->health;
        l->health = l->next_health;
        l->next_health = before;
        l->has_health = true;
        l->health_count += 1;
    }
}

static void on_command(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_listener *l = context;
    portmet_command_t command;
    if (pm_command_decode(&command, data, size) == PM_KEEP &&
        command.kind != PORTMET_COMMAND_T_REFUSE && command.session == l->session) {
        l->over = true;
    }
}

// --- opening ---

pm_status pm_listener_open(pm_listener **listener, pm_transport *transport, const pm_scene *scene,
                           int64_t session) {
    static const struct {
        const char *word;
        pm_message_handler *handler;
    } words[] = {{"LEDGER", on_ledger}, {"HEALTH", on_health}, {"COMMAND", on_command}};
    const int n = scene->network.nprocess;
    pm_listener *l = NULL;
    PM_TRY(PM_NEW(l, "a listener"));
    pm_status status;
    l->transport = transport;
    l->scene = scene;
    l->wanted = session;
    l->newest = -1;
    l->health.nprocess = l->next_health.nprocess = n;
    l->process = pm_arena_array(&l->arena, (size_t)n, sizeof *l->process);
    PM_TRY_DONE(pm_health_alloc(&l->health, &l->arena));
    PM_TRY_DONE(pm_health_alloc(&l->next_health, &l->arena));
    PM_TRY_DONE(
        pm_report_window_init(&l->reports, &l->arena, scene, 2 * (pm_lookahead(scene) + 1), 0));
    char channel[PM_CHANNEL_SIZE];
    for (size_t i = 0; i < sizeof words / sizeof words[0]; ++i) {
        PM_TRY_DONE(pm_channel_scene(channel, scene->name, words[i].word));
        PM_TRY_DONE(pm_transport_subscribe(transport, channel, words[i].handler, l));
    }
    for (int i = 0; i < n; ++i) {
        pm_remote_process *remote = &l->process[i].remote;
        l->process[i].listener = l;
        PM_TRY_DONE(pm_remote_process_init(remote, &l->arena, scene, i));
        PM_TRY_DONE(pm_transport_subscribe(transport, remote->channel, on_report, &l->process[i]));
    }
    *listener = l;
    return PM_OK;
done:
    pm_listener_close(l);
    return status;
}

void pm_listener_close(pm_listener *listener) {
    if (listener == NULL) {
        return;
    }
    pm_report_window_free(&listener->reports);
    PM_DELETE(listener);
}

// --- reading ---

void pm_listener_set_handler(pm_listener *listener, pm_sample_handler *handler, void *context) {
    listener->handler = handler;
    listener->context = context;
}

pm_status pm_listener_read(pm_listener *listener) {
    int handled = 1;
    for (int i = 0; i < MOST_READS && handled > 0; ++i) {
        PM_TRY(pm_transport_wait(listener->transport, 0, &handled));
    }
    return PM_OK;
}

int64_t pm_listener_session(const pm_listener *listener) {
    return listener->session;
}

bool pm_listener_is_over(const pm_listener *listener) {
    return listener->over;
}

const pm_sample *pm_listener_sample(const pm_listener *listener) {
    return listener->newest < 0 ? NULL
                                : pm_report_window_sample(&listener->reports, listener->newest);
}

bool pm_listener_has_state(const pm_listener *listener) {
    return listener->has_state;
}

const portmet_ledger_t *pm_listener_ledger(const pm_listener *listener) {
    return listener->has_ledger ? &listener->ledger : NULL;
}

const portmet_health_t *pm_listener_health(const pm_listener *listener) {
    return listener->has_health ? &listener->health : NULL;
}

int64_t pm_listener_health_count(const pm_listener *listener) {
    return listener->health_count;
}
