// Differences of the sums that processes tell, and what follows from them.
#include "lockstep/health.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "lockstep/vitals.h"
#include "transport/channel.h"

#define LEAST_USED 20   // messages of a process in an interval, of which a part says something
#define LEAST_PART 0.01 // of the time: who waits less waits for nobody

// --- opening ---

pm_status pm_health_message_alloc(portmet_health_t *message, pm_arena *arena, int nprocess) {
    portmet_health_t *m = message;
    double **const doubles[] = {&m->process_rate, &m->silent,     &m->cpu,
                                &m->computing,    &m->waits_part, &m->asks,
                                &m->answers,      &m->loss,       &m->checkpoint_age};
    int64_t **const integers[] = {&m->process_step, &m->waits_for, &m->loses_from,
                                  &m->drops,        &m->strange,   &m->rss};
    const size_t count = (size_t)nprocess;
    m->nprocess = nprocess;
    for (size_t i = 0; i < sizeof doubles / sizeof doubles[0]; ++i) {
        *doubles[i] = pm_arena_array(arena, count, sizeof **doubles[i]);
        if (*doubles[i] == NULL) {
            return pm_fail(PM_ENOMEM, "health: out of memory");
        }
    }
    for (size_t i = 0; i < sizeof integers / sizeof integers[0]; ++i) {
        *integers[i] = pm_arena_array(arena, count, sizeof **integers[i]);
        if (*integers[i] == NULL) {
            return pm_fail(PM_ENOMEM, "health: out of memory");
        }
    }
    return PM_OK;
}

// Makes the arrays of vitals with `npeer` peers, and two more.
static pm_status allocate(pm_arena *arena, portmet_vitals_t *v, int npeer, int64_t **more) {
    const size_t count = (size_t)npeer;
    int64_t *numbers = pm_arena_array(arena, 6 * count + PM_NDROP, sizeof *numbers);
    *v = (portmet_vitals_t){.npeer = npeer, .ndrop = PM_NDROP};
    v->waited = pm_arena_array(arena, count, sizeof *v->waited);
    if (numbers == NULL || v->waited == NULL) {
        return pm_fail(PM_ENOMEM, "health: out of memory");
    }
    v->peer = numbers;
    v->asked = numbers + count;
    v->used = numbers + 2 * count;
    v->answered = numbers + 3 * count;
    *more = numbers + 4 * count;
    v->drops = numbers + 6 * count;
    return PM_OK;
}

pm_status pm_health_init(pm_health *health, pm_arena *arena, const pm_scene *scene, int64_t digest,
                         int64_t session, int64_t steps) {
    const int count = scene->nprocess;
    int64_t *unused;
    health->scene = scene;
    health->told_blocker = PM_HEALTH_NOBODY;
    PM_TRY(pm_channel_scene(health->channel, scene, "HEALTH"));
    PM_TRY(pm_channel_scene(health->vitals_channel, scene, "VITALS"));
    PM_TRY(pm_health_message_alloc(&health->message, arena, count));
    health->message.session = session;
    health->message.digest = digest;
    health->message.steps = steps;
    PM_TRY(allocate(arena, &health->vitals, count + 1, &unused));
    health->process = pm_arena_array(arena, (size_t)count, sizeof *health->process);
    health->capacity = pm_health_size(&health->message);
    health->data = pm_arena_alloc(arena, health->capacity);
    if (health->process == NULL || health->data == NULL) {
        return pm_fail(PM_ENOMEM, "health: out of memory");
    }
    for (int i = 0; i < count; ++i) {
        pm_health_process *p = &health->process[i];
        const int npeer = pm_vitals_neighbours(scene, i, NULL) + 1;
        PM_TRY(allocate(arena, &p->last, npeer, &p->used));
        p->answered = p->used + npeer;
        health->message.waits_for[i] = health->message.loses_from[i] = PM_HEALTH_NOBODY;
        health->message.checkpoint_age[i] = health->message.silent[i] = -1;
    }
    return PM_OK;
}

// --- the vitals of a process ---

// Sums up what a process told since the last time, `time` s before.
static void note(pm_health *health, const portmet_vitals_t *v, double time) {
    pm_health_process *p = &health->process[v->process];
    portmet_health_t *m = &health->message;
    const portmet_vitals_t *last = &p->last;
    const int i = v->process;
    double most = LEAST_PART * time, asked = 0, answered = 0;
    m->process_step[i] = v->step;
    m->process_rate[i] = v->step > last->step ? (double)(v->step - last->step) / time : 0;
    m->cpu[i] = (v->cpu - last->cpu) / time;
    m->computing[i] = (v->computing - last->computing) / time;
    m->rss[i] = v->rss;
    m->checkpoint_age[i] = v->checkpoint_age;
    m->waits_for[i] = PM_HEALTH_NOBODY;
    m->waits_part[i] = 0;
    for (int k = 0; k < v->npeer; ++k) {
        const double waited = v->waited[k] - last->waited[k];
        asked += (double)(v->asked[k] - last->asked[k]);
        answered += (double)(v->answered[k] - last->answered[k]);
        p->used[k] = v->used[k] - last->used[k];
        p->answered[k] = v->answered[k] - last->answered[k];
        if (waited > most) {
            most = waited;
            m->waits_for[i] = v->peer[k];
            m->waits_part[i] = waited / time;
        }
    }
    m->asks[i] = asked / time;
    m->answers[i] = answered / time;
    m->drops[i] = m->strange[i] = 0;
    for (int k = 0; k < v->ndrop && k < PM_NDROP; ++k) {
        m->drops[i] += k == PM_KEEP ? 0 : v->drops[k];
        m->strange[i] += pm_drop_is_strange((pm_drop)k) ? v->drops[k] : 0;
    }
}

// Copies the sums of `v`, whose arrays have the lengths of those of `last`.
static void keep(portmet_vitals_t *last, const portmet_vitals_t *v) {
    const size_t size = (size_t)v->npeer * sizeof(int64_t);
    const portmet_vitals_t arrays = *last;
    *last = *v;
    last->peer = memcpy(arrays.peer, v->peer, size);
    last->waited = memcpy(arrays.waited, v->waited, size);
    last->asked = memcpy(arrays.asked, v->asked, size);
    last->used = memcpy(arrays.used, v->used, size);
    last->answered = memcpy(arrays.answered, v->answered, size);
    last->drops = memcpy(arrays.drops, v->drops, (size_t)v->ndrop * sizeof(int64_t));
}

pm_drop pm_health_take(pm_health *health, const void *data, size_t size, double now) {
    portmet_vitals_t *v = &health->vitals;
    v->npeer = health->scene->nprocess + 1;
    v->ndrop = PM_NDROP;
    const pm_drop drop = pm_vitals_decode(v, data, size);
    if (drop != PM_KEEP) {
        return drop;
    }
    if (v->session != health->message.session) {
        return PM_DROP_SESSION;
    }
    if (v->process < 0 || v->process >= health->scene->nprocess ||
        v->npeer != health->process[v->process].last.npeer) {
        return PM_DROP_IMPLAUSIBLE;
    }
    pm_health_process *p = &health->process[v->process];
    const double time = v->elapsed - p->last.elapsed;
    if (p->heard > 0 && time > 0) {
        note(health, v, time);
    }
    keep(&p->last, v);
    p->heard = now;
    return PM_KEEP;
}

// --- the run ---

// The part of the messages of `from` that had to be sent to process `to` again.
static double loss_between(const pm_health *health, int from, int to) {
    const pm_health_process *sender = &health->process[from], *receiver = &health->process[to];
    double used = 0, again = 0;
    for (int k = 0; k < receiver->last.npeer; ++k) {
        used += receiver->last.peer[k] == from ? (double)receiver->used[k] : 0;
    }
    for (int k = 0; k < sender->last.npeer; ++k) {
        again += sender->last.peer[k] == to ? (double)sender->answered[k] : 0;
    }
    return used + again < LEAST_USED ? 0 : again < used ? again / used : 1;
}

// Finds whose messages a process misses most.
static void find_loss(pm_health *health, int to) {
    portmet_health_t *m = &health->message;
    const portmet_vitals_t *v = &health->process[to].last;
    m->loss[to] = 0;
    m->loses_from[to] = PM_HEALTH_NOBODY;
    for (int k = 0; k < v->npeer; ++k) {
        const int from = (int)v->peer[k];
        const double loss = from >= 0 && from < m->nprocess ? loss_between(health, from, to) : 0;
        if (loss > m->loss[to]) {
            m->loss[to] = loss;
            m->loses_from[to] = from;
        }
    }
}

double pm_health_silence(int processes) {
    return fmax(PM_HEALTH_SILENT, 2 * pm_vitals_interval(processes));
}

static bool is_waiting(const portmet_health_t *m, int64_t i) {
    return m->silent[i] >= 0 && m->silent[i] < pm_health_silence(m->nprocess) &&
           m->waits_part[i] > 0.5;
}

// Follows from a process to the one that it waits for, and on, to one that does not wait. Who waits
// for the coordinator waits for whom this one waits for: the process that waits least.
static int64_t find_root(const portmet_health_t *m, int64_t from) {
    int64_t at = from;
    for (int i = 0; i <= m->nprocess && at != PM_HEALTH_NOBODY; ++i) {
        if (at == PM_HEALTH_COORDINATOR) {
            at = 0;
            for (int k = 1; k < m->nprocess; ++k) {
                at = !is_waiting(m, k) && is_waiting(m, at) ? k : at;
            }
            return is_waiting(m, at) ? PM_HEALTH_COORDINATOR : at;
        }
        if (!is_waiting(m, at)) {
            return at;
        }
        at = m->waits_for[at];
    }
    return PM_HEALTH_NOBODY;
}

// The process that all others wait for, for most of the time.
static int64_t find_blocker(const portmet_health_t *m) {
    const int64_t blocker = m->nprocess > 1 ? find_root(m, 0) : PM_HEALTH_NOBODY;
    for (int i = 0; i < m->nprocess && blocker != PM_HEALTH_NOBODY; ++i) {
        if (i != blocker && (!is_waiting(m, i) || m->waits_part[i] < PM_HEALTH_BLOCKED ||
                             find_root(m, i) != blocker)) {
            return PM_HEALTH_NOBODY;
        }
    }
    return blocker;
}

bool pm_health_is_due(pm_health *health, int64_t step, double now) {
    portmet_health_t *m = &health->message;
    if (now < health->next) {
        return false;
    }
    m->step = step;
    m->rate = health->before > 0 && now > health->before && step > health->step_before
                  ? (double)(step - health->step_before) / (now - health->before)
                  : 0;
    health->before = now;
    health->step_before = step;
    health->next = now + PM_VITALS_INTERVAL;
    for (int i = 0; i < m->nprocess; ++i) {
        m->silent[i] = health->process[i].heard > 0 ? now - health->process[i].heard : -1;
        find_loss(health, i);
    }
    m->blocker = find_blocker(m);
    return true;
}

const char *pm_health_name(const pm_scene *scene, int64_t process_id) {
    if (process_id == PM_HEALTH_COORDINATOR) {
        return "coordinator";
    }
    return process_id >= 0 && process_id < scene->nprocess ? scene->process[process_id].name
                                                           : "nobody";
}

bool pm_health_warn(pm_health *health, char *text, size_t size) {
    const portmet_health_t *m = &health->message;
    for (int i = 0; i < m->nprocess; ++i) {
        if (m->loss[i] > PM_HEALTH_LOSS && !health->process[i].told_loss) {
            health->process[i].told_loss = true;
            snprintf(text, size, "%s had to be sent %.0f %% of the messages of %s again",
                     health->scene->process[i].name, 100 * m->loss[i],
                     pm_health_name(health->scene, m->loses_from[i]));
            return true;
        }
    }
    // The observer learns of a silent process by another message.
    const bool silent = m->blocker >= 0 && m->silent[m->blocker] > pm_health_silence(m->nprocess);
    if (m->blocker != PM_HEALTH_NOBODY && m->blocker != health->told_blocker && !silent) {
        health->told_blocker = m->blocker;
        snprintf(text, size, "%s makes all others wait for more than %.0f %% of the time",
                 pm_health_name(health->scene, m->blocker), 100 * PM_HEALTH_BLOCKED);
        return true;
    }
    return false;
}
