// Parses LCM datagrams and joins fragments.
#include "transport/datagram.h"

#include <arpa/inet.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "transport/transport.h"

static uint32_t read_number(const unsigned char *at, int size) {
    uint32_t number = 0;
    for (int i = 0; i < size; ++i) {
        number = number << 8 | at[i];
    }
    return number;
}

// Splits the channel off from the front of the data. Returns false if its terminator is missing.
static bool take_channel(pm_datagram *d) {
    const size_t most = d->size < PM_CHANNEL_SIZE ? d->size : PM_CHANNEL_SIZE;
    const size_t length = strnlen((const char *)d->data, most);
    if (length == most) {
        return false;
    }
    d->channel = (const char *)d->data;
    d->data += length + 1;
    d->size -= length + 1;
    return true;
}

bool pm_datagram_parse(pm_datagram *datagram, const void *bytes, size_t size) {
    const unsigned char *head = bytes;
    if (size < PM_DATAGRAM_SHORT_HEAD) {
        return false;
    }
    const uint32_t magic = read_number(head, 4);
    pm_datagram d = {.sequence = read_number(head + 4, 4), .count = 1};
    bool good = false;
    if (magic == PM_DATAGRAM_SHORT) {
        d.data = head + PM_DATAGRAM_SHORT_HEAD;
        d.size = size - PM_DATAGRAM_SHORT_HEAD;
        good = take_channel(&d);
        d.total = d.size;
    } else if (magic == PM_DATAGRAM_FRAGMENT && size >= PM_DATAGRAM_FRAGMENT_HEAD) {
        d.data = head + PM_DATAGRAM_FRAGMENT_HEAD;
        d.size = size - PM_DATAGRAM_FRAGMENT_HEAD;
        d.total = read_number(head + 8, 4);
        d.offset = read_number(head + 12, 4);
        d.number = read_number(head + 16, 2);
        d.count = read_number(head + 18, 2);
        // The first fragment begins with the channel.
        good = (d.number != 0 || (d.offset == 0 && take_channel(&d))) && d.number < d.count &&
               d.total <= PM_MESSAGE_MAX && d.size <= d.total && d.offset <= d.total - d.size;
    }
    if (good) {
        *datagram = d;
    }
    return good;
}

void pm_reassembly_free(pm_reassembly *reassembly) {
    free(reassembly->data);
    *reassembly = (pm_reassembly){0};
}

pm_status pm_reassembly_begin(pm_reassembly *reassembly, const pm_datagram *first, uint64_t sender,
                              long *discarded) {
    pm_reassembly *r = reassembly;
    const size_t needed = first->total + first->count;
    if (pm_reassembly_add(r, first, sender)) {
        return PM_OK; // a duplicate
    }
    *discarded += r->count > 0 && !pm_reassembly_complete(r);
    r->missing = 0;
    if (r->capacity < needed) {
        unsigned char *data = realloc(r->data, needed);
        if (data == NULL) {
            return pm_fail(PM_ENOMEM, "channel %s: no memory for a message of %zu bytes",
                           first->channel, first->total);
        }
        r->data = data;
        r->capacity = needed;
    }
    r->sender = sender;
    r->sequence = first->sequence;
    r->total = first->total;
    r->received = 0;
    r->count = r->missing = first->count;
    memset(r->data + r->total, 0, r->count);
    (void)pm_reassembly_add(r, first, sender);
    return PM_OK;
}

bool pm_reassembly_add(pm_reassembly *reassembly, const pm_datagram *part, uint64_t sender) {
    pm_reassembly *r = reassembly;
    const bool belongs = r->missing > 0 && r->sender == sender && r->sequence == part->sequence &&
                         r->total == part->total && r->count == part->count;
    if (belongs && r->data[r->total + part->number] == 0) {
        memcpy(r->data + part->offset, part->data, part->size);
        r->data[r->total + part->number] = 1;
        r->received += part->size;
        r->missing -= 1;
    }
    return belongs;
}

bool pm_reassembly_complete(const pm_reassembly *reassembly) {
    return reassembly->count > 0 && reassembly->missing == 0 &&
           reassembly->received == reassembly->total;
}

// --- the filter of channels ---

#define SHORTEST 3 // characters of a name: one word with its terminator
#define NOTHING_LOADED SIZE_MAX

typedef struct emitter {
    struct sock_filter *code; // [BPF_MAXINSNS]
    int count;
    bool full;
} emitter;

static void emit(emitter *e, unsigned code, uint32_t k, int if_true, int if_false) {
    if (e->count == BPF_MAXINSNS) {
        e->full = true;
    } else {
        e->code[e->count++] =
            (struct sock_filter)BPF_JUMP((uint16_t)code, k, (uint8_t)if_true, (uint8_t)if_false);
    }
}

static void pass(emitter *e) {
    emit(e, BPF_RET | BPF_K, UINT32_MAX, 0, 0);
}

static void drop(emitter *e) {
    emit(e, BPF_RET | BPF_K, 0, 0, 0);
}

// Emits a jump forward, whose target `land` sets.
static int jump(emitter *e) {
    emit(e, BPF_JMP | BPF_JA, 0, 0, 0);
    return e->count - 1;
}

static void land(emitter *e, int from) {
    e->code[from].k = (uint32_t)(e->count - from - 1);
}

static uint32_t word_at(const char *name, size_t offset) {
    uint32_t word;
    memcpy(&word, name + offset, sizeof word);
    return ntohl(word);
}

static size_t size_of(const char *name) {
    return strlen(name) + 1;
}

static void emit_names(emitter *e, int count, const char *const *name, size_t offset);

// All these names have the same word at offset `at`. Compares the message with this word, and then
// with the rest of each name.
static void emit_branch(emitter *e, int count, const char *const *name, size_t at, size_t *loaded) {
    // Loads the word at offset `at` of the channel's name, which begins X bytes into the packet,
    // unless it is loaded already.
    if (*loaded != at) {
        emit(e, BPF_LD | BPF_W | BPF_IND, (uint32_t)at, 0, 0);
        *loaded = at;
    }
    emit(e, BPF_JMP | BPF_JEQ | BPF_K, word_at(name[0], at), 1, 0);
    const int otherwise = jump(e);
    emit_names(e, count, name, at + 4);
    land(e, otherwise);
}

// Compares names that agree in their first `offset` bytes. Shorter names come first, since a load
// beyond the end of the packet drops it.
static void emit_names(emitter *e, int count, const char *const *name, size_t offset) {
    size_t loaded = NOTHING_LOADED;
    if (size_of(name[0]) == offset) {
        pass(e); // names are distinct: there is only this one
        return;
    }
    for (size_t size = offset + 1; size < offset + 4; ++size) {
        for (int i = 0; i < count; ++i) {
            if (size_of(name[i]) == size) {
                emit_branch(e, 1, name + i, size - 4, &loaded);
            }
        }
    }
    for (int i = 0, same = 1; i < count && !e->full; i += same, same = 1) {
        if (size_of(name[i]) < offset + 4) {
            continue;
        }
        while (i + same < count && size_of(name[i + same]) >= offset + 4 &&
               word_at(name[i + same], offset) == word_at(name[i], offset)) {
            ++same;
        }
        emit_branch(e, same, name + i, offset, &loaded);
    }
    drop(e);
}

pm_status pm_channel_filter_build(struct sock_fprog *program, int count, const char *const *name,
                                  unsigned start) {
    *program = (struct sock_fprog){0};
    for (int i = 0; i < count; ++i) {
        if (strlen(name[i]) < SHORTEST) {
            return PM_OK;
        }
    }
    emitter e = {.code = calloc(BPF_MAXINSNS, sizeof *e.code)};
    PM_TRY(pm_allocated(e.code, "a socket filter"));
    // Checks LCM's header and stores the position of the channel name in the register X.
    emit(&e, BPF_LD | BPF_W | BPF_ABS, start, 0, 0);
    emit(&e, BPF_JMP | BPF_JEQ | BPF_K, PM_DATAGRAM_SHORT, 0, 2);
    emit(&e, BPF_LDX | BPF_W | BPF_IMM, start + PM_DATAGRAM_SHORT_HEAD, 0, 0);
    const int is_short = jump(&e);
    emit(&e, BPF_JMP | BPF_JEQ | BPF_K, PM_DATAGRAM_FRAGMENT, 1, 0);
    drop(&e);
    emit(&e, BPF_LD | BPF_H | BPF_ABS, start + 16, 0, 0); // the fragment's number
    emit(&e, BPF_JMP | BPF_JEQ | BPF_K, 0, 1, 0);
    pass(&e);
    emit(&e, BPF_LDX | BPF_W | BPF_IMM, start + PM_DATAGRAM_FRAGMENT_HEAD, 0, 0);
    land(&e, is_short);
    if (count > 0) {
        emit_names(&e, count, name, 0);
    } else {
        drop(&e);
    }
    if (e.full) {
        free(e.code);
        return PM_OK;
    }
    *program = (struct sock_fprog){(unsigned short)e.count, e.code};
    return PM_OK;
}
