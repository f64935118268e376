// MPI as a transport, for machines between which multicast does not travel: the processes are the
// ranks of one job, which mpirun starts. This is the only file that calls MPI. Every rank tells all
// ranks which channels it subscribes to; a message is sent to the ranks that subscribe to its
// channel, and to no other. It is the name of the channel with its terminator, then the data.
#include <assert.h>
#include <errno.h>
#include <mpi.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/progress.h"
#include "transport/datagram.h"
#include "transport/spin.h"
#include "transport/transport_table.h"

// Messages handled in one wait at most, so that a flood cannot keep the caller from its own work.
#define BURST 1024

// Messages on their way at most. Others are lost, as any message may be, until the ranks that they
// go to receive again.
#define MOST_PENDING 4096

// MPI cannot wait for a message with a time limit, so a rank that has waited for long sleeps
// between two looks.
#define NAP 0.00005     // s of such a sleep
#define LONG_WAIT 0.02  // s of waiting, after which it sleeps for LONG_NAP
#define LONG_NAP 0.001  // s
#define CLOSE_NAP 0.001 // s between two looks at the end

// At the end every rank waits for the others. Rank 0 ends the run, so that the others need little
// time after it; it may need long to complete its files.
#define FIRST_GRACE 5.0  // s that rank 0 waits at most
#define OTHER_GRACE 60.0 // s that the other ranks wait at most

enum { TAG_MESSAGE = 1, TAG_SUBSCRIPTIONS };

typedef struct own_subscription {
    char channel[PM_CHANNEL_SIZE];
    pm_message_handler *handler;
    void *context;
} own_subscription;

typedef struct rank_subscription {
    char channel[PM_CHANNEL_SIZE];
    int rank;
} rank_subscription;

// Entries that begin with a channel, and are sorted by it before they are searched.
typedef struct channel_list {
    void *entry; // [count]
    int count, capacity;
    bool sorted;
} channel_list;

// A message on its way to `count` ranks.
typedef struct outgoing {
    struct outgoing *next;
    MPI_Request *request; // [count], of room for all ranks
    int count;
    size_t capacity;
    unsigned char data[]; // [capacity]
} outgoing;

typedef struct mpi_endpoint {
    int rank, nrank;
    pm_drops *drops;
    channel_list own;    // own_subscription
    channel_list others; // rank_subscription, of this rank too
    int announced;       // entries of `own` that the ranks were told of; they are the first ones
    outgoing *pending, *unused;
    int npending;
    unsigned char *data; // [capacity] the message being received
    size_t capacity;
    pm_spin spin;
} mpi_endpoint;

// --- lists of channels ---

// Appends an entry of `size` bytes.
static pm_status append(channel_list *list, const void *entry, size_t size) {
    if (list->count == list->capacity) {
        const int capacity = 2 * list->capacity + 32;
        void *larger = realloc(list->entry, (size_t)capacity * size);
        PM_TRY(pm_allocated(larger, "channel %s", (const char *)entry));
        list->entry = larger;
        list->capacity = capacity;
    }
    memcpy((char *)list->entry + (size_t)list->count * size, entry, size);
    list->count += 1;
    list->sorted = false;
    return PM_OK;
}

static int compare(const void *a, const void *b) {
    return strcmp(a, b);
}

// Returns the index of the first entry of this channel, or where it would stand.
static int find_first(channel_list *list, size_t size, const char *channel) {
    if (!list->sorted && list->count > 0) {
        qsort(list->entry, (size_t)list->count, size, compare);
    }
    list->sorted = true;
    int low = 0, high = list->count;
    while (low < high) {
        const int middle = low + (high - low) / 2;
        if (strcmp((const char *)list->entry + (size_t)middle * size, channel) < 0) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low;
}

// --- sending ---

static void free_outgoing(outgoing *o) {
    while (o != NULL) {
        outgoing *next = o->next;
        free(o->request);
        free(o);
        o = next;
    }
}

// Takes back the memory of the messages that have left.
static void reclaim(mpi_endpoint *e) {
    for (outgoing **link = &e->pending; *link != NULL;) {
        outgoing *o = *link;
        int done = 0;
        MPI_Testall(o->count, o->request, &done, MPI_STATUSES_IGNORE);
        if (!done) {
            link = &o->next;
            continue;
        }
        *link = o->next;
        o->next = e->unused;
        e->unused = o;
        e->npending -= 1;
    }
}

// Returns memory for a message of `size` bytes: the first unused one that is large enough, else a
// new one; NULL: out of memory.
static outgoing *take_outgoing(mpi_endpoint *e, size_t size) {
    for (outgoing **link = &e->unused; *link != NULL; link = &(*link)->next) {
        outgoing *o = *link;
        if (o->capacity >= size) {
            *link = o->next;
            return o;
        }
    }
    const size_t capacity = size < 1024 ? 1024 : 2 * size;
    outgoing *o = malloc(sizeof *o + capacity);
    MPI_Request *request = malloc((size_t)e->nrank * sizeof(MPI_Request));
    if (o == NULL || request == NULL) {
        free(o);
        free(request);
        return NULL;
    }
    *o = (outgoing){.request = request, .capacity = capacity};
    return o;
}

// Puts a message among those on their way; send_to sends it.
static void begin_sending(mpi_endpoint *e, outgoing *o) {
    o->count = 0;
    o->next = e->pending;
    e->pending = o;
    e->npending += 1;
}

static void send_to(outgoing *o, size_t size, int rank, int tag) {
    MPI_Isend(o->data, (int)size, MPI_BYTE, rank, tag, MPI_COMM_WORLD, &o->request[o->count]);
    o->count += 1;
}

// Tells every rank of the channels that are new. The list is sorted only after that, so that the
// new ones are the last.
static pm_status announce(mpi_endpoint *e) {
    if (e->announced == e->own.count) {
        return PM_OK;
    }
    const own_subscription *s = e->own.entry;
    outgoing *o = take_outgoing(e, (size_t)(e->own.count - e->announced) * PM_CHANNEL_SIZE);
    PM_TRY(pm_allocated(o, "subscriptions"));
    size_t size = 0;
    for (int i = e->announced; i < e->own.count; ++i) {
        int first = 0; // entry with the channel of this one
        while (strcmp(s[first].channel, s[i].channel) != 0) {
            ++first;
        }
        if (first == i) {
            memcpy(o->data + size, s[i].channel, PM_CHANNEL_SIZE);
            size += PM_CHANNEL_SIZE;
        }
    }
    begin_sending(e, o);
    for (int rank = 0; rank < e->nrank; ++rank) {
        send_to(o, size, rank, TAG_SUBSCRIPTIONS);
    }
    e->announced = e->own.count;
    return PM_OK;
}

static pm_status mpi_publish(void *state, const char *channel, const void *data, size_t size) {
    mpi_endpoint *e = state;
    PM_TRY(announce(e));
    reclaim(e);
    const rank_subscription *s = e->others.entry;
    const int first = find_first(&e->others, sizeof *s, channel);
    int end = first;
    while (end < e->others.count && strcmp(s[end].channel, channel) == 0) {
        ++end;
    }
    if (end == first || e->npending >= MOST_PENDING) {
        return PM_OK;
    }
    const size_t head = strlen(channel) + 1;
    if (size > PM_MESSAGE_MAX - head) {
        return pm_fail(PM_ENET, "channel %s: cannot publish %zu bytes", channel, size);
    }
    outgoing *o = take_outgoing(e, head + size);
    PM_TRY(pm_allocated(o, "channel %s", channel));
    memcpy(o->data, channel, head);
    if (size > 0) {
        memcpy(o->data + head, data, size);
    }
    begin_sending(e, o);
    for (int i = first; i < end; ++i) {
        send_to(o, head + size, s[i].rank, TAG_MESSAGE);
    }
    return PM_OK;
}

// --- receiving ---

// Passes a message to every handler of its channel.
static void dispatch(mpi_endpoint *e, size_t size) {
    const char *channel = (const char *)e->data;
    const size_t most = size < PM_CHANNEL_SIZE ? size : PM_CHANNEL_SIZE;
    const size_t head = strnlen(channel, most) + 1;
    if (head > most) {
        e->drops->count[PM_DROP_DATAGRAM] += 1;
        return;
    }
    const own_subscription *s = e->own.entry;
    for (int i = find_first(&e->own, sizeof *s, channel);
         i < e->own.count && strcmp(s[i].channel, channel) == 0; ++i) {
        s[i].handler(s[i].context, s[i].channel, e->data + head, size - head);
    }
}

// Takes one message, if one is there, into e->data. `found` tells whether there was one, `size`,
// `rank` and `tag` what it is.
static pm_status take(mpi_endpoint *e, bool *found, size_t *size, int *rank, int *tag) {
    int flag = 0, count = 0;
    MPI_Message message;
    MPI_Status info;
    MPI_Improbe(MPI_ANY_SOURCE, MPI_ANY_TAG, MPI_COMM_WORLD, &flag, &message, &info);
    *found = flag != 0;
    if (!*found) {
        return PM_OK;
    }
    MPI_Get_count(&info, MPI_BYTE, &count);
    *size = (size_t)count;
    *rank = info.MPI_SOURCE;
    *tag = info.MPI_TAG;
    if (e->capacity < *size) {
        unsigned char *larger = realloc(e->data, 2 * *size);
        PM_TRY(pm_allocated(larger, "a message of %zu bytes", *size));
        e->data = larger;
        e->capacity = 2 * *size;
    }
    MPI_Mrecv(e->data, count, MPI_BYTE, &message, &info);
    return PM_OK;
}

// Receives and handles the messages that are there; `handled` receives their number.
static pm_status take_all(mpi_endpoint *e, int *handled) {
    bool found = true;
    *handled = 0;
    while (found && *handled < BURST) {
        size_t size;
        int rank, tag;
        PM_TRY(take(e, &found, &size, &rank, &tag));
        if (found && tag == TAG_SUBSCRIPTIONS) {
            for (size_t i = 0; i + PM_CHANNEL_SIZE <= size; i += PM_CHANNEL_SIZE) {
                rank_subscription s = {.rank = rank};
                memcpy(s.channel, e->data + i, PM_CHANNEL_SIZE - 1);
                PM_TRY(append(&e->others, &s, sizeof s));
            }
        } else if (found) {
            dispatch(e, size);
            *handled += 1;
        }
    }
    return PM_OK;
}

static int nap(double seconds) {
    return nanosleep(&(struct timespec){.tv_nsec = (long)(1e9 * seconds)}, NULL);
}

// Looks for messages again and again, for `seconds` at most: at first without sleeping, for the
// time that pm_spin_time allows.
static pm_status await(mpi_endpoint *e, double seconds, int *handled) {
    const double start = pm_clock(), polled = start + pm_spin_time(&e->spin, start);
    double now = start;
    while (*handled == 0 && now < start + seconds) {
        const double before = now;
        if (now < polled) {
            sched_yield();
        } else if (nap(now < start + LONG_WAIT ? NAP : LONG_NAP) != 0 && errno == EINTR) {
            break;
        }
        PM_TRY(take_all(e, handled));
        now = pm_clock();
        if (before < polled) {
            pm_spin_note_yield(&e->spin, now - before, now);
        }
    }
    pm_spin_note_wait(&e->spin, now - start);
    return PM_OK;
}

static pm_status mpi_wait(void *state, double seconds, int *handled) {
    mpi_endpoint *e = state;
    PM_TRY(announce(e));
    reclaim(e);
    PM_TRY(take_all(e, handled));
    return *handled == 0 && seconds > 0 ? await(e, seconds, handled) : PM_OK;
}

// --- life cycle ---

static pm_status mpi_subscribe(void *state, const char *channel, pm_message_handler *handler,
                               void *context) {
    mpi_endpoint *e = state;
    own_subscription s = {.handler = handler, .context = context};
    strcpy(s.channel, channel);
    return append(&e->own, &s, sizeof s);
}

static pm_status mpi_check(const char *url) {
    return strcmp(url, "mpi://") == 0
               ? PM_OK
               : pm_fail(PM_ECONFIG, "expected nothing after mpi://, found \"%.64s\"", url);
}

static pm_status mpi_place(int *rank, int *count) {
    int begun = 0, ended = 0;
    MPI_Initialized(&begun);
    MPI_Finalized(&ended);
    if (ended) {
        return pm_fail(PM_ENET, "transport \"mpi://\": MPI is over in this process");
    }
    if (!begun) {
        MPI_Init(NULL, NULL);
    }
    MPI_Comm_rank(MPI_COMM_WORLD, rank);
    MPI_Comm_size(MPI_COMM_WORLD, count);
    return PM_OK;
}

static pm_status mpi_open(void **state, const char *url, pm_drops *drops) {
    int rank, nrank;
    PM_TRY(mpi_check(url));
    PM_TRY(mpi_place(&rank, &nrank));
    mpi_endpoint *e = NULL;
    PM_TRY(PM_NEW(e, url));
    e->rank = rank;
    e->nrank = nrank;
    e->drops = drops;
    *state = e;
    return PM_OK;
}

// Receives and drops messages until every rank has come here and, with `all_sent`, every message of
// this rank has left. False: that has not happened by the time `end`, s of pm_clock.
static bool meet(mpi_endpoint *e, bool all_sent, double end) {
    MPI_Request request;
    int met = 0;
    MPI_Ibarrier(MPI_COMM_WORLD, &request);
    while (!met || (all_sent && e->pending != NULL)) {
        bool found = true;
        size_t size;
        int rank, tag;
        while (found && take(e, &found, &size, &rank, &tag) == PM_OK) {
        }
        reclaim(e);
        if (!met) {
            MPI_Test(&request, &met, MPI_STATUS_IGNORE);
        }
        if (pm_clock() > end) {
            return false;
        }
        nap(CLOSE_NAP);
    }
    return true;
}

// After the first meeting nobody sends any more; after the second one everything has arrived. If a
// rank does not come, this one ends without MPI_Finalize, and mpirun ends the others.
static void mpi_close(void *state) {
    mpi_endpoint *e = state;
    const double end = pm_clock() + (e->rank == 0 ? FIRST_GRACE : OTHER_GRACE);
    if (meet(e, true, end) && meet(e, false, end)) {
        MPI_Finalize();
        free_outgoing(e->pending);
    }
    free_outgoing(e->unused);
    free(e->own.entry);
    free(e->others.entry);
    free(e->data);
    free(e);
}

static int mpi_file(const void *state) {
    (void)state;
    return -1;
}

// transport.c asks for this name.
extern const pm_transport_table pm_transport_mpi __attribute__((visibility("default")));
const pm_transport_table pm_transport_mpi = {
    mpi_check, mpi_open, mpi_close, mpi_subscribe, mpi_publish, mpi_wait, mpi_file, mpi_place,
};
