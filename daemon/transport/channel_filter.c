// The program is a tree of comparisons of words of four bytes. Names that begin with the same words
// share the comparisons of these. Where the size of a name, with its terminator, is no multiple of
// four, its last word overlaps the one before it, so that no byte of the data is compared.
#include "transport/channel_filter.h"

#include <arpa/inet.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "transport/datagram.h"

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

// Loads the word at `offset` of the channel, which begins X bytes into the packet, unless it is
// loaded already.
static void load_word(emitter *e, size_t offset, size_t *loaded) {
    if (*loaded != offset) {
        emit(e, BPF_LD | BPF_W | BPF_IND, (uint32_t)offset, 0, 0);
        *loaded = offset;
    }
}

static size_t size_of(const char *name) {
    return strlen(name) + 1;
}

static void emit_names(emitter *e, int count, const char *const *name, size_t offset);

// Compares the word at offset `at`, which is the same in all these names, and then the rest of the
// names.
static void emit_branch(emitter *e, int count, const char *const *name, size_t at, size_t *loaded) {
    load_word(e, at, loaded);
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

// Emits code that checks LCM's header and stores the position of the channel name in the register
// X.
static void emit_head(emitter *e, unsigned start) {
    emit(e, BPF_LD | BPF_W | BPF_ABS, start, 0, 0);
    emit(e, BPF_JMP | BPF_JEQ | BPF_K, PM_DATAGRAM_SHORT, 0, 2);
    emit(e, BPF_LDX | BPF_W | BPF_IMM, start + PM_DATAGRAM_SHORT_HEAD, 0, 0);
    const int is_short = jump(e);
    emit(e, BPF_JMP | BPF_JEQ | BPF_K, PM_DATAGRAM_FRAGMENT, 1, 0);
    drop(e);
    emit(e, BPF_LD | BPF_H | BPF_ABS, start + 16, 0, 0); // the fragment's number
    emit(e, BPF_JMP | BPF_JEQ | BPF_K, 0, 1, 0);
    pass(e);
    emit(e, BPF_LDX | BPF_W | BPF_IMM, start + PM_DATAGRAM_FRAGMENT_HEAD, 0, 0);
    land(e, is_short);
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
    if (e.code == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a socket filter");
    }
    emit_head(&e, start);
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
