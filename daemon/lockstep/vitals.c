// Sums of times and counts, and what the system tells of this process.
#include "lockstep/vitals.h"

#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "transport/channel.h"

int pm_vitals_neighbours(const pm_scene *scene, int process_id, int *list) {
    int count = 0;
    for (int other = 0; other < scene->nprocess; ++other) {
        bool joined = false;
        for (int i = 0; i < scene->nport && !joined && other != process_id; ++i) {
            const int *end = scene->port[i].subsystem;
            const int a = end[0] < 0 ? -1 : scene->subsystem[end[0]].process;
            const int b = end[1] < 0 ? -1 : scene->subsystem[end[1]].process;
            joined = (a == process_id && b == other) || (b == process_id && a == other);
        }
        if (joined && list != NULL) {
            list[count] = other;
        }
        count += joined;
    }
    return count;
}

double pm_vitals_interval(int processes) {
    return fmax(PM_VITALS_INTERVAL, PM_VITALS_EACH * processes);
}

pm_status pm_vitals_init(pm_vitals *vitals, pm_arena *arena, const pm_scene *scene, int process_id,
                         int npeer, const int *peer) {
    portmet_vitals_t *m = &vitals->message;
    const size_t count = (size_t)npeer + 1;
    PM_TRY(pm_channel_scene(vitals->channel, scene, "VITALS"));
    vitals->interval = pm_vitals_interval(scene->nprocess);
    *m = (portmet_vitals_t){.process = process_id, .npeer = npeer + 1, .ndrop = PM_NDROP};
    int64_t *numbers = pm_arena_array(arena, 4 * count + PM_NDROP, sizeof *numbers);
    m->waited = pm_arena_array(arena, count, sizeof *m->waited);
    vitals->capacity = pm_vitals_size(m);
    vitals->data = pm_arena_alloc(arena, vitals->capacity);
    if (numbers == NULL || m->waited == NULL || vitals->data == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", scene->process[process_id].name);
    }
    m->peer = numbers;
    m->asked = numbers + count;
    m->used = numbers + 2 * count;
    m->answered = numbers + 3 * count;
    m->drops = numbers + 4 * count;
    for (int i = 0; i < npeer; ++i) {
        m->peer[i] = peer[i];
    }
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

void pm_vitals_ask(pm_vitals *vitals, int peer) {
    vitals->message.asked[peer] += 1;
}

void pm_vitals_use(pm_vitals *vitals, int peer) {
    vitals->message.used[peer] += 1;
}

void pm_vitals_answer(pm_vitals *vitals, int peer) {
    vitals->message.answered[peer] += 1;
}

bool pm_vitals_are_due(pm_vitals *vitals, int64_t session, double now) {
    if (session == 0 || (vitals->begun > 0 && now < vitals->next)) {
        return false;
    }
    vitals->message.session = session;
    vitals->begun = vitals->begun > 0 ? vitals->begun : now;
    vitals->message.elapsed = now - vitals->begun;
    vitals->next = now + vitals->interval;
    return true;
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

pm_status pm_vitals_publish(pm_vitals *vitals, pm_transport *transport, int64_t step,
                            int64_t checkpoint, const pm_drops *drops) {
    portmet_vitals_t *m = &vitals->message;
    const pm_drops *below = pm_transport_drops(transport);
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
        m->drops[i] = drops->count[i] + below->count[i];
    }
    const size_t size = pm_vitals_encode(m, vitals->data, vitals->capacity);
    return pm_transport_publish(transport, vitals->channel, vitals->data, size);
}
