// Runs rings of processes over liblcm, over portmet's own receiver, and over futexes.
#include "ring.h"

#include <errno.h>
#include <lcm/lcm.h>
#include <linux/futex.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "base/progress.h"
#include "transport/transport.h"

#define MOST 64
#define MESSAGE 72 // bytes
#define START 20.0 // s until all processes are there
#define LOST 2.0   // s without a sign of the neighbours: it was lost
#define PREFIX "ring_"

// In memory that all processes share.
typedef struct shared {
    atomic_int ready;
    double cpu[MOST]; // s
    struct {
        atomic_int step;  // complete, by this process
        atomic_uint bell; // rung by its neighbours
        char apart[56];   // on a cache line of its own
    } process[MOST];
    double time[]; // [steps + 1]
} shared;

// One process.
typedef struct member {
    shared *shared;
    int id, count, steps;
    int neighbour[2];
    int heard[2]; // steps that the neighbours are known to have completed
    lcm_t *lcm;
    pm_transport *transport;
} member;

// --- messages ---

static void hear(member *m, const char *channel, const void *data, size_t size) {
    int step;
    const int from = atoi(channel + strlen(PREFIX));
    if (size != MESSAGE) {
        return;
    }
    memcpy(&step, data, sizeof step);
    for (int i = 0; i < 2; ++i) {
        if (m->neighbour[i] == from && step > m->heard[i]) {
            m->heard[i] = step;
        }
    }
}

static void on_lcm(const lcm_recv_buf_t *buffer, const char *channel, void *context) {
    hear(context, channel, buffer->data, buffer->data_size);
}

static void on_transport(void *context, const char *channel, const void *data, size_t size) {
    hear(context, channel, data, size);
}

static bool open_lcm(member *m, const char *url) {
    char channel[2][16];
    m->lcm = lcm_create(url);
    for (int i = 0; m->lcm != NULL && i < 2; ++i) {
        snprintf(channel[i], sizeof channel[i], PREFIX "%d", m->neighbour[i]);
        if (i == 0 || m->neighbour[1] != m->neighbour[0]) {
            lcm_subscription_t *s = lcm_subscribe(m->lcm, channel[i], on_lcm, m);
            lcm_subscription_set_queue_capacity(s, 0);
        }
    }
    return m->lcm != NULL;
}

static bool open_transport(member *m, const char *url) {
    if (pm_transport_open(&m->transport, url) != PM_OK) {
        return false;
    }
    for (int i = 0; i < 2; ++i) {
        char channel[16];
        snprintf(channel, sizeof channel, PREFIX "%d", m->neighbour[i]);
        if ((i == 0 || m->neighbour[1] != m->neighbour[0]) &&
            pm_transport_subscribe(m->transport, channel, on_transport, m) != PM_OK) {
            return false;
        }
    }
    return pm_transport_wait(m->transport, 0, NULL) == PM_OK;
}

static bool tell(const member *m, int step) {
    unsigned char data[MESSAGE] = {0};
    char channel[16];
    snprintf(channel, sizeof channel, PREFIX "%d", m->id);
    memcpy(data, &step, sizeof step);
    return m->lcm != NULL ? lcm_publish(m->lcm, channel, data, sizeof data) == 0
                          : pm_transport_publish(m->transport, channel, data, sizeof data) == PM_OK;
}

static bool wait_message(const member *m) {
    if (m->lcm != NULL) {
        return lcm_handle_timeout(m->lcm, (int)(1000 * LOST)) > 0;
    }
    int handled = 0;
    return pm_transport_wait(m->transport, LOST, &handled) == PM_OK && handled > 0;
}

static bool message_step(member *m, int step) {
    bool good = tell(m, step);
    while (good && (m->heard[0] < step || m->heard[1] < step)) {
        good = wait_message(m);
    }
    return good;
}

// --- futexes ---

// A wait also ends after LOST seconds.
static long futex(atomic_uint *word, int operation, unsigned value) {
    const struct timespec timeout = {(time_t)LOST, 0};
    return syscall(SYS_futex, word, operation, value, &timeout, NULL, 0);
}

static bool futex_step(member *m, int step) {
    shared *s = m->shared;
    atomic_store(&s->process[m->id].step, step);
    for (int i = 0; i < 2; ++i) {
        atomic_uint *bell = &s->process[m->neighbour[i]].bell;
        atomic_fetch_add(bell, 1);
        futex(bell, FUTEX_WAKE, 1);
    }
    for (;;) {
        const unsigned rung = atomic_load(&s->process[m->id].bell);
        if (atomic_load(&s->process[m->neighbour[0]].step) >= step &&
            atomic_load(&s->process[m->neighbour[1]].step) >= step) {
            return true;
        }
        if (futex(&s->process[m->id].bell, FUTEX_WAIT, rung) < 0 && errno == ETIMEDOUT) {
            return false;
        }
    }
}

// --- the ring ---

// In a process of its own: all steps, from when everybody is ready. Returns its exit code.
static int serve(ring_kind kind, const char *url, member *m) {
    shared *s = m->shared;
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    const bool open =
        kind == RING_FUTEX || (kind == RING_LCM ? open_lcm(m, url) : open_transport(m, url));
    atomic_fetch_add(&s->ready, 1);
    const double late = pm_clock() + START;
    while (atomic_load(&s->ready) < m->count && pm_clock() < late) {
        nanosleep(&(struct timespec){.tv_nsec = 100000}, NULL);
    }
    const double start = cost_cpu_of_self();
    bool good = open;
    for (int step = 0; good && step <= m->steps; ++step) {
        good = kind == RING_FUTEX ? futex_step(m, step + 1) : message_step(m, step + 1);
        if (m->id == 0) {
            s->time[step] = pm_clock();
        }
    }
    s->cpu[m->id] = cost_cpu_of_self() - start;
    return good ? 0 : 1;
}

// How many of the processes failed.
static int run_members(ring_kind kind, const char *url, shared *s, int count, int steps) {
    pid_t pid[MOST];
    for (int i = 0; i < count; ++i) {
        member m = {.shared = s,
                    .id = i,
                    .count = count,
                    .steps = steps,
                    .neighbour = {(i + count - 1) % count, (i + 1) % count}};
        pid[i] = fork();
        if (pid[i] == 0) {
            _exit(serve(kind, url, &m));
        }
    }
    int failed = 0;
    for (int i = 0; i < count; ++i) {
        int status = 1;
        failed += pid[i] < 0 || waitpid(pid[i], &status, 0) != pid[i] || status != 0;
    }
    return failed;
}

pm_status ring_run(ring_kind kind, const char *url, int count, int steps, cost *result) {
    const size_t size = sizeof(shared) + ((size_t)steps + 1) * sizeof(double);
    shared *s = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (s == MAP_FAILED || count > MOST) {
        return pm_fail(PM_ENOMEM, "no memory for a ring of %d", count);
    }
    const double before = cost_bytes_sent();
    const int failed = run_members(kind, url, s, count, steps);
    double cpu = 0;
    for (int i = 0; i < count; ++i) {
        cpu += s->cpu[i];
    }
    *result = cost_of(steps, 1, s->time, cpu, cost_bytes_sent() - before);
    munmap(s, size);
    return failed == 0 ? PM_OK
                       : pm_fail(PM_ENET, "a ring of %d: %d processes failed", count, failed);
}
