// Sums of times and counts, what the system tells of this process, and what follows from the sums
// of all processes.
#include "lockstep/health.h"

#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "transport/channel.h"

#define LEAST_USED 20   // messages of a process in an interval, of which a part says something
#define LEAST_PART 0.01 // of the time: who waits less waits for nobody

// --- vitals ---

pm_status pm_vitals_init(pm_vitals *vitals, pm_arena *arena, const pm_scene *scene, int process_id,
                         int npeer) {
    portmet_vitals_t *m = &vitals->message;
    PM_TRY(pm_channel_scene(vitals->channel, scene->name, "VITALS"));
    vitals->interval = pm_vitals_interval(scene->network.nprocess);
    *m = (portmet_vitals_t){.process = process_id, .npeer = npeer + 1, .ndrop = PM_NDROP};
    PM_TRY(pm_vitals_alloc(m, arena));
    vitals->capacity = pm_vitals_size(m);
    vitals->data = pm_arena_alloc(arena, vitals->capacity);
    PM_TRY(pm_arena_status(arena, "vitals of %s", scene->network.process[process_id].name));
    m->peer[npeer] = -1;
    return PM_OK;
}

void pm_vitals_look(pm_vitals *vitals, double now) {
    vitals->looked = now;
    if (vitals->rested > 0 && vitals->begun > 0) {
        vitals->message.waited[vitals->peer] += now - vitals->rested;
    }
    vitals->rested = 0;
}

void pm_vitals_rest(pm_vitals *vitals, double now, int peer) {
    if (vitals->begun > 0) {
        vitals->message.computing += now - vitals->looked;
    }
    vitals->rested = now;
    vitals->peer = peer;
}

// Resident memory, bytes; 0 where the system does not tell. Without stdio, which would allocate.
static int64_t read_memory(void) {
    char text[64];
    const int file = open("/proc/self/statm", O_RDONLY | O_CLOEXEC);
    const ssize_t size = file < 0 ? -1 : read(file, text, sizeof text - 1);
    if (file >= 0) {
        close(file);
    }
    if (size <= 0) {
        return 0;
    }
    text[size] = 0;
    char *second = text;
    (void)strtoll(text, &second, 10);
    return strtoll(second, NULL, 10) * sysconf(_SC_PAGESIZE);
}

static double seconds_of(struct timeval time) {
    return (double)time.tv_sec + 1e-6 * (double)time.tv_usec;
}

pm_status pm_vitals_tell(pm_vitals *vitals, const pm_endpoint *endpoint, int64_t step,
                         int64_t checkpoint) {
    portmet_vitals_t *m = &vitals->message;
    const double now = endpoint->now;
    if (endpoint->session == 0 || (vitals->begun > 0 && now < vitals->next)) {
        return PM_OK;
    }
    vitals->begun = vitals->begun > 0 ? vitals->begun : now;
    vitals->next = now + vitals->interval;
    m->session = endpoint->session;
    m->elapsed = now - vitals->begun;
    const pm_drops *below = pm_transport_drops(endpoint->transport);
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    if (checkpoint != vitals->checkpoint || vitals->saved == 0) {
        vitals->checkpoint = checkpoint;
        vitals->saved = vitals->looked;
    }
    m->step = step;
    m->cpu = seconds_of(usage.ru_utime) + seconds_of(usage.ru_stime);
    m->rss = read_memory();
    m->checkpoint_age = checkpoint < 0 ? -1 : vitals->looked - vitals->saved;
    for (int i = 0; i < PM_NDROP; ++i) {
        m->drops[i] = endpoint->drops.count[i] + below->count[i];
    }
    const size_t size = pm_vitals_encode(m, vitals->data, vitals->capacity);
    return pm_transport_publish(endpoint->transport, vitals->channel, vitals->data, size);
}

// --- health ---

pm_status pm_health_init(pm_health *health, pm_arena *arena, const pm_scene *scene, int64_t digest,
                         int64_t session, int64_t steps) {
    const int count = scene->network.nprocess;
    health->scene = scene;
    health->told_blocker = PM_HEALTH_NOBODY;
    PM_TRY(pm_channel_scene(health->channel, scene->name, "HEALTH"));
    PM_TRY(pm_channel_scene(health->vitals_channel, scene->name, "VITALS"));
    health->message =
        (portmet_health_t){.session = session, .digest = digest, .steps = steps, .nprocess = count};
    health->vitals = (portmet_vitals_t){.npeer = count + 1, .ndrop = PM_NDROP};
    PM_TRY(pm_health_alloc(&health->message, arena));
    PM_TRY(pm_vitals_alloc(&health->vitals, arena));
    health->process = pm_arena_array(arena, (size_t)count, sizeof *health->process);
    health->capacity = pm_health_size(&health->message);
    health->data = pm_arena_alloc(arena, health->capacity);
    int *counted = pm_arena_array(arena, (size_t)count, sizeof *counted); // the last i for each
    PM_TRY(pm_arena_status(arena, "health"));
    for (int i = 0; i < count; ++i) {
        pm_health_process *p = &health->process[i];
        const pm_scene_process *process = &scene->network.process[i];
        int npeer = 1; // the coordinator, and the processes that exchange fluxes with this one
        for (int k = 0; k < process->count; ++k) {
            const int id = process->subsystem[k];
            for (int e = scene->physics.first_end[id]; e < scene->physics.first_end[id + 1]; ++e) {
                const int end_at = scene->physics.end_at[e];
                const int other = scene->physics.port[end_at / 2].subsystem[1 - end_at % 2];
                const int at = other < 0 ? i : scene->physics.subsystem[other].process;
                npeer += at != i && counted[at] != i + 1;
                counted[at] = i + 1;
            }
        }
        p->last = (portmet_vitals_t){.npeer = npeer, .ndrop = PM_NDROP};
        p->used = pm_arena_array(arena, (size_t)npeer, sizeof *p->used);
        p->answered = pm_arena_array(arena, (size_t)npeer, sizeof *p->answered);
        PM_TRY(pm_vitals_alloc(&p->last, arena));
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

pm_drop pm_health_take(pm_health *health, const void *data, size_t size, double now) {
    portmet_vitals_t *v = &health->vitals;
    v->npeer = health->scene->network.nprocess + 1;
    v->ndrop = PM_NDROP;
    const pm_drop drop = pm_vitals_decode(v, data, size);
    if (drop != PM_KEEP) {
        return drop;
    }
    if (v->session != health->message.session) {
        return PM_DROP_SESSION;
    }
    if (v->process < 0 || v->process >= health->scene->network.nprocess ||
        v->npeer != health->process[v->process].last.npeer) {
        return PM_DROP_IMPLAUSIBLE;
    }
    pm_health_process *p = &health->process[v->process];
    const double time = v->elapsed - p->last.elapsed;
    if (p->heard > 0 && time > 0) {
        note(health, v, time);
    }
    // Copies the sums, whose arrays have the lengths of those of `last`.
    portmet_vitals_t *last = &p->last;
    const size_t bytes = (size_t)v->npeer * sizeof(int64_t);
    const portmet_vitals_t arrays = *last;
    *last = *v;
    last->peer = memcpy(arrays.peer, v->peer, bytes);
    last->waited = memcpy(arrays.waited, v->waited, bytes);
    last->asked = memcpy(arrays.asked, v->asked, bytes);
    last->used = memcpy(arrays.used, v->used, bytes);
    last->answered = memcpy(arrays.answered, v->answered, bytes);
    last->drops = memcpy(arrays.drops, v->drops, (size_t)v->ndrop * sizeof(int64_t));
    p->heard = now;
    return PM_KEEP;
}

// --- the run ---

double pm_health_silence(int processes, bool rests) {
    return fmax(PM_HEALTH_SILENT,
                2 * (rests ? pm_rest_interval(processes) : pm_vitals_interval(processes)));
}

static bool is_waiting(const portmet_health_t *m, int64_t i) {
    return m->silent[i] >= 0 && m->silent[i] < pm_health_silence(m->nprocess, false) &&
           m->waits_part[i] > 0.5;
}

// Goes from a process to the one that it waits for, and on, until a process does not wait. The
// coordinator itself waits for the process that waits least.
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
        // Whose messages the process misses most.
        const portmet_vitals_t *v = &health->process[i].last;
        m->loss[i] = 0;
        m->loses_from[i] = PM_HEALTH_NOBODY;
        for (int k = 0; k < v->npeer; ++k) {
            const int from = (int)v->peer[k];
            if (from < 0 || from >= m->nprocess) {
                continue;
            }
            // The part of the messages of `from` that had to be sent to process i again.
            const pm_health_process *sender = &health->process[from];
            const pm_health_process *receiver = &health->process[i];
            double used = 0, again = 0;
            for (int p = 0; p < receiver->last.npeer; ++p) {
                used += receiver->last.peer[p] == from ? (double)receiver->used[p] : 0;
            }
            for (int p = 0; p < sender->last.npeer; ++p) {
                again += sender->last.peer[p] == i ? (double)sender->answered[p] : 0;
            }
            const double loss = used + again < LEAST_USED ? 0 : again < used ? again / used : 1;
            if (loss > m->loss[i]) {
                m->loss[i] = loss;
                m->loses_from[i] = from;
            }
        }
    }
    // The process that all others wait for, for most of the time.
    const int64_t blocker = m->nprocess > 1 ? find_root(m, 0) : PM_HEALTH_NOBODY;
    m->blocker = blocker;
    for (int i = 0; i < m->nprocess && m->blocker != PM_HEALTH_NOBODY; ++i) {
        if (i != blocker && (!is_waiting(m, i) || m->waits_part[i] < PM_HEALTH_BLOCKED ||
                             find_root(m, i) != blocker)) {
            m->blocker = PM_HEALTH_NOBODY;
        }
    }
    return true;
}

const char *pm_health_name(const pm_scene *scene, int64_t process_id) {
    if (process_id == PM_HEALTH_COORDINATOR) {
        return "coordinator";
    }
    return process_id >= 0 && process_id < scene->network.nprocess
               ? scene->network.process[process_id].name
               : "nobody";
}

bool pm_health_warn(pm_health *health, char *text, size_t size) {
    const portmet_health_t *m = &health->message;
    for (int i = 0; i < m->nprocess; ++i) {
        if (m->loss[i] > PM_HEALTH_LOSS && !health->process[i].told_loss) {
            health->process[i].told_loss = true;
            snprintf(text, size, "%s had to be sent %.0f %% of the messages of %s again",
                     health->scene->network.process[i].name, 100 * m->loss[i],
                     pm_health_name(health->scene, m->loses_from[i]));
            return true;
        }
    }
    // The observer learns of a silent process by another message.
    const bool silent =
        m->blocker >= 0 && m->silent[m->blocker] > pm_health_silence(m->nprocess, false);
    if (m->blocker != PM_HEALTH_NOBODY && m->blocker != health->told_blocker && !silent) {
        health->told_blocker = m->blocker;
        snprintf(text, size, "%s makes all others wait for more than %.0f %% of the time",
                 pm_health_name(health->scene, m->blocker), 100 * PM_HEALTH_BLOCKED);
        return true;
    }
    return false;
}
