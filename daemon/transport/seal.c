// Computes stamps and tags, and reads the key file, with libsodium.
#include "transport/seal.h"

#include <endian.h>
#include <errno.h>
#include <fcntl.h>
#include <sodium.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "base/files.h"
#include "transport/transport_table.h"

#define STAMP_SIZE 8
#define TAG_SIZE 16

struct pm_seal {
    crypto_generichash_state keyed; // the hash with the key taken in, where every tag begins
    int64_t offset;                 // ns, clock of stamps minus the system's clock since its start
    unsigned char sender[PM_SEAL_SENDER]; // [length], then its length
    size_t length;
};

// --- the key ---

static pm_status read_key(pm_key *key, int file, const char *path) {
    struct stat about;
    unsigned char bytes[PM_KEY_SIZE + 1];
    if (fstat(file, &about) != 0) {
        return pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    if (!S_ISREG(about.st_mode)) {
        return pm_fail(PM_EFILE, "%s: not a file", path);
    }
    if ((about.st_mode & 077) != 0) {
        return pm_fail(PM_EFILE,
                       "%s: others may use this key (mode %04o): chmod 600 it, or make "
                       "another",
                       path, (unsigned)about.st_mode & 07777);
    }
    const ssize_t count = read(file, bytes, sizeof bytes);
    if (count == PM_KEY_SIZE) {
        memcpy(key->byte, bytes, PM_KEY_SIZE);
    }
    sodium_memzero(bytes, sizeof bytes);
    return count == PM_KEY_SIZE ? PM_OK
                                : pm_fail(PM_EFILE,
                                          "%s: %lld bytes, expected a key of %d, as from "
                                          "\"head -c %d /dev/urandom\"",
                                          path, (long long)about.st_size, PM_KEY_SIZE, PM_KEY_SIZE);
}

pm_status pm_key_load(pm_key *key, const char *path) {
    const int file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file < 0) {
        return pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    const pm_status status = read_key(key, file, path);
    close(file);
    pm_files_note_input(path);
    return status;
}

void pm_key_clear(pm_key *key) {
    sodium_memzero(key, sizeof *key);
}

// --- the seal ---

static int64_t read_clock(clockid_t clock) {
    struct timespec now;
    clock_gettime(clock, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

pm_status pm_seal_open(pm_seal **seal, const pm_key *key, const char *sender, int64_t now) {
    // The memory is locked where the system allows it. It is aligned for the state, whose size is a
    // multiple of its alignment.
    pm_seal *made = sodium_init() < 0 ? NULL : sodium_malloc(sizeof *made);
    PM_TRY(pm_allocated(made, "a key"));
    crypto_generichash_init(&made->keyed, key->byte, PM_KEY_SIZE, TAG_SIZE);
    made->offset = now - read_clock(CLOCK_BOOTTIME);
    made->length = strnlen(sender, PM_SEAL_SENDER - 1);
    memcpy(made->sender, sender, made->length);
    made->sender[made->length] = (unsigned char)made->length;
    *seal = made;
    return PM_OK;
}

void pm_seal_close(pm_seal *seal) {
    sodium_free(seal); // clears it, too
}

int64_t pm_seal_clock(const pm_seal *seal) {
    return seal == NULL ? read_clock(CLOCK_REALTIME) : read_clock(CLOCK_BOOTTIME) + seal->offset;
}

// Computes the tag of `data` [size], which holds the payload and the other fields.
static void make_tag(const pm_seal *seal, const char *channel, const void *data, size_t size,
                     unsigned char *tag) {
    crypto_generichash_state state = seal->keyed;
    crypto_generichash_update(&state, (const unsigned char *)channel, strlen(channel) + 1);
    crypto_generichash_update(&state, data, size);
    crypto_generichash_final(&state, tag, TAG_SIZE);
}

size_t pm_seal_write(const pm_seal *seal, const char *channel, void *data, size_t size,
                     int64_t stamp) {
    unsigned char *field = (unsigned char *)data + size;
    const uint64_t bits = htobe64((uint64_t)stamp);
    const size_t head = STAMP_SIZE + seal->length + 1;
    memcpy(field, &bits, STAMP_SIZE);
    memcpy(field + STAMP_SIZE, seal->sender, seal->length + 1);
    make_tag(seal, channel, data, size + head, field + head);
    return head + TAG_SIZE;
}

pm_drop pm_seal_check(const pm_seal *seal, const char *channel, const void *data, size_t *size,
                      pm_seal_origin *origin) {
    if (*size < PM_SEAL_LEAST) {
        return PM_DROP_LENGTH;
    }
    const unsigned char *end = (const unsigned char *)data + *size - TAG_SIZE; // the tag
    unsigned char tag[TAG_SIZE];
    make_tag(seal, channel, data, *size - TAG_SIZE, tag);
    if (sodium_memcmp(tag, end, TAG_SIZE) != 0) {
        return PM_DROP_SEAL;
    }
    const size_t length = end[-1];
    if (length >= PM_SEAL_SENDER || *size < PM_SEAL_LEAST + length) {
        return PM_DROP_LENGTH;
    }
    uint64_t bits;
    memcpy(&bits, end - 1 - length - STAMP_SIZE, STAMP_SIZE);
    // A stamp may be any number, and the difference must not overflow.
    const int64_t stamp = (int64_t)be64toh(bits);
    const int64_t ahead = stamp < 0 ? INT64_MIN : stamp - pm_seal_clock(seal);
    if (ahead >= -PM_SEAL_AGE && ahead <= PM_SEAL_AGE) {
        *size -= PM_SEAL_LEAST + length;
        return PM_KEEP;
    }
    if (origin != NULL) {
        origin->ahead = ahead;
        // Nothing but printable characters are expected in the sender's text.
        const unsigned char *text = end - 1 - length;
        for (size_t i = 0; i < length; ++i) {
            origin->sender[i] = text[i] > ' ' && text[i] < 0x7f ? (char)text[i] : '?';
        }
        origin->sender[length] = 0;
    }
    return ahead > 0 ? PM_DROP_CLOCK : PM_DROP_REPLAY;
}

// --- the transport ---
//
// A transport in front of another one: it seals what is published, and passes on only messages that
// were sealed with the same key.

#define FIRST_CAPACITY 1024 // bytes
#define MOST_TOLD 16        // senders whose clocks are told of

typedef struct sealed_subscription {
    struct sealed_subscription *next;
    struct sealed *owner;
    pm_message_handler *handler;
    void *context;
} sealed_subscription;

typedef struct sealed {
    pm_transport_front front;
    pm_seal *seal;
    pm_drops *drops;
    unsigned char *data; // [capacity] a message with its seal
    size_t capacity;
    sealed_subscription *subscriptions;
    pm_clock_handler *on_clock; // NULL: nobody is told
    const void *context;        // of on_clock
    int ntold;
    char told[MOST_TOLD][PM_SEAL_SENDER]; // the senders that it was called for
} sealed;

static void sealed_close(void *state) {
    sealed *s = state;
    s->front.table->close(s->front.beneath);
    pm_seal_close(s->seal);
    while (s->subscriptions != NULL) {
        sealed_subscription *next = s->subscriptions->next;
        free(s->subscriptions);
        s->subscriptions = next;
    }
    free(s->data);
    free(s);
}

pm_status pm_transport_sealed_open(void **state, const pm_transport_table *table, void *beneath,
                                   const pm_key *key, const char *sender,
                                   pm_clock_handler *on_clock, const void *context,
                                   pm_drops *drops) {
    sealed *s = NULL;
    PM_TRY(PM_NEW(s, "a sealed transport"));
    const pm_status status = pm_seal_open(&s->seal, key, sender, pm_seal_clock(NULL));
    if (status != PM_OK) {
        free(s);
        return status;
    }
    s->front = (pm_transport_front){table, beneath};
    s->drops = drops;
    s->on_clock = on_clock;
    s->context = context;
    *state = s;
    return PM_OK;
}

static void check(void *context, const char *channel, const void *data, size_t size) {
    const sealed_subscription *s = context;
    pm_seal_origin origin;
    const pm_drop drop = pm_seal_check(s->owner->seal, channel, data, &size, &origin);
    if (drop == PM_KEEP) {
        s->handler(s->context, channel, data, size);
        return;
    }
    sealed *owner = s->owner;
    owner->drops->count[drop] += 1;
    if (drop == PM_DROP_CLOCK) {
        // Tells once of each sender whose clock is ahead. A stamp that is behind may be that of a
        // replayed message; a sender whose clock is behind finds the others' ahead.
        int i = 0;
        while (i < owner->ntold && strcmp(owner->told[i], origin.sender) != 0) {
            ++i;
        }
        if (i == owner->ntold && i < MOST_TOLD && owner->on_clock != NULL) {
            strcpy(owner->told[owner->ntold++], origin.sender);
            owner->on_clock(owner->context, origin.sender, 1e-9 * (double)origin.ahead);
        }
    }
}

static pm_status sealed_subscribe(void *state, const char *channel, pm_message_handler *handler,
                                  void *context) {
    sealed *s = state;
    sealed_subscription *made = calloc(1, sizeof *made);
    PM_TRY(pm_allocated(made, "channel %s", channel));
    *made = (sealed_subscription){s->subscriptions, s, handler, context};
    s->subscriptions = made;
    return pm_front_subscribe(s, channel, check, made);
}

static pm_status sealed_publish(void *state, const char *channel, const void *data, size_t size) {
    sealed *s = state;
    if (s->capacity < size + PM_SEAL_MOST) {
        const size_t capacity = 2 * size + FIRST_CAPACITY;
        unsigned char *larger = realloc(s->data, capacity);
        if (larger == NULL) {
            return pm_fail(PM_ENOMEM, "channel %s: no memory for %zu bytes", channel, size);
        }
        s->data = larger;
        s->capacity = capacity;
    }
    if (size > 0) {
        memcpy(s->data, data, size);
    }
    size += pm_seal_write(s->seal, channel, s->data, size, pm_seal_clock(s->seal));
    return pm_front_publish(s, channel, s->data, size);
}

const pm_transport_table pm_transport_sealed = {
    .close = sealed_close,
    .subscribe = sealed_subscribe,
    .publish = sealed_publish,
    .wait = pm_front_wait,
    .file = pm_front_file,
};
