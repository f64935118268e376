// The reader and the writer of LCM's wire format, which walk the tables of the types.
#include "lockstep/codec.h"

#include <endian.h>
#include <string.h>

#include "base/digest.h"

// --- members of a struct, by offset ---

static int32_t get_count(const char *message, size_t offset) {
    int32_t count;
    memcpy(&count, message + offset, sizeof count);
    return count;
}

static char *get_array(const char *message, size_t offset) {
    char *array;
    memcpy(&array, message + offset, sizeof array);
    return array;
}

static const char *get_text(const char *message, size_t offset) {
    const char *text;
    memcpy(&text, message + offset, sizeof text);
    return text;
}

static bool is_finite_bits(uint64_t bits) {
    const uint64_t exponent = UINT64_C(0x7ff) << 52;
    return (bits & exponent) != exponent;
}

static bool is_control(char character) {
    const unsigned char byte = (unsigned char)character;
    return byte < 0x20 || byte == 0x7f;
}

// Returns the number of bytes of a single number in a message.
static size_t size_of(pm_wire_kind kind) {
    switch (kind) {
    case PM_WIRE_I8:
    case PM_WIRE_BOOLEAN:
        return 1;
    case PM_WIRE_I32:
    case PM_WIRE_COUNT:
        return 4;
    default:
        return 8;
    }
}

static bool is_array(pm_wire_kind kind) {
    return kind == PM_WIRE_DOUBLES || kind == PM_WIRE_I64S;
}

// --- reading ---

typedef struct wire_reader {
    const unsigned char *at;
    size_t left;
} wire_reader;

static bool read_bits(wire_reader *r, size_t size, uint64_t *bits) {
    if (r->left < size) {
        return false;
    }
    *bits = 0;
    for (size_t i = 0; i < size; ++i) {
        *bits = *bits << 8 | r->at[i];
    }
    r->at += size;
    r->left -= size;
    return true;
}

// `count` numbers of eight bytes.
static pm_drop read_words(wire_reader *r, size_t count, bool must_be_finite, char *target) {
    bool finite = true;
    if (r->left / 8 < count) {
        return PM_DROP_LENGTH;
    }
    for (size_t i = 0; i < count; ++i) {
        uint64_t bits;
        memcpy(&bits, r->at + 8 * i, sizeof bits);
        bits = be64toh(bits);
        finite = finite && is_finite_bits(bits);
        memcpy(target + 8 * i, &bits, sizeof bits);
    }
    r->at += 8 * count;
    r->left -= 8 * count;
    return finite || !must_be_finite ? PM_KEEP : PM_DROP_NUMBER;
}

static pm_drop read_text(wire_reader *r, char *target) {
    uint64_t size;
    if (!read_bits(r, 4, &size)) {
        return PM_DROP_LENGTH;
    }
    if (size < 1 || size > PM_TEXT_MAX + 1) {
        return PM_DROP_TEXT;
    }
    if (size > r->left) {
        return PM_DROP_LENGTH;
    }
    const char *text = (const char *)r->at;
    for (size_t i = 0; i + 1 < size; ++i) {
        if (is_control(text[i])) {
            return PM_DROP_TEXT;
        }
    }
    if (text[size - 1] != 0) {
        return PM_DROP_TEXT;
    }
    memcpy(target, &text, sizeof text);
    r->at += size;
    r->left -= size;
    return PM_KEEP;
}

static pm_drop read_integer(wire_reader *r, pm_wire_kind kind, bool exact, char *target) {
    const size_t size = size_of(kind);
    uint64_t bits;
    if (!read_bits(r, size, &bits)) {
        return PM_DROP_LENGTH;
    }
    const uint32_t word = (uint32_t)bits;
    const uint8_t byte = (uint8_t)bits;
    switch (kind) {
    case PM_WIRE_I64:
        memcpy(target, &bits, 8);
        return PM_KEEP;
    case PM_WIRE_I32:
        memcpy(target, &word, 4);
        return PM_KEEP;
    case PM_WIRE_COUNT: {
        const uint32_t most = (uint32_t)get_count(target, 0);
        if (exact ? word != most : word > most) {
            return PM_DROP_COUNT;
        }
        memcpy(target, &word, 4);
        return PM_KEEP;
    }
    case PM_WIRE_BOOLEAN:
        memcpy(target, &byte, 1);
        return byte <= 1 ? PM_KEEP : PM_DROP_NUMBER;
    default:
        memcpy(target, &byte, 1);
        return PM_KEEP;
    }
}

pm_drop pm_wire_decode(const pm_wire_type *type, bool exact, void *message, const void *data,
                       size_t size) {
    wire_reader r = {data, size};
    uint64_t fingerprint;
    if (!read_bits(&r, 8, &fingerprint)) {
        return PM_DROP_LENGTH;
    }
    if (fingerprint != (uint64_t)type->fingerprint()) {
        return PM_DROP_TYPE;
    }
    char *m = message;
    for (int i = 0; i < type->nfield; ++i) {
        const pm_wire_field *f = &type->field[i];
        pm_drop drop;
        if (f->kind == PM_WIRE_DOUBLE) {
            drop = read_words(&r, 1, true, m + f->offset);
        } else if (is_array(f->kind)) {
            // The count was decoded and checked before: the caller's memory holds as many numbers.
            const size_t count = (size_t)get_count(m, f->count);
            drop = read_words(&r, count, f->kind == PM_WIRE_DOUBLES, get_array(m, f->offset));
        } else if (f->kind == PM_WIRE_TEXT) {
            drop = read_text(&r, m + f->offset);
        } else {
            drop = read_integer(&r, f->kind, exact, m + f->offset);
        }
        if (drop != PM_KEEP) {
            return drop;
        }
    }
    return r.left == 0 ? PM_KEEP : PM_DROP_LENGTH;
}

// --- writing ---

typedef struct wire_writer {
    unsigned char *at;
    size_t left;
    bool failed;
} wire_writer;

static void write_bits(wire_writer *w, size_t size, uint64_t bits) {
    if (w->failed || w->left < size) {
        w->failed = true;
        return;
    }
    for (size_t i = 0; i < size; ++i) {
        w->at[i] = (unsigned char)(bits >> (8 * (size - 1 - i)));
    }
    w->at += size;
    w->left -= size;
}

// `count` numbers of eight bytes.
static void write_words(wire_writer *w, size_t count, bool must_be_finite, const char *source) {
    bool finite = true;
    if (w->failed || w->left / 8 < count) {
        w->failed = true;
        return;
    }
    for (size_t i = 0; i < count; ++i) {
        uint64_t bits;
        memcpy(&bits, source + 8 * i, sizeof bits);
        finite = finite && is_finite_bits(bits);
        bits = htobe64(bits);
        memcpy(w->at + 8 * i, &bits, sizeof bits);
    }
    w->at += 8 * count;
    w->left -= 8 * count;
    w->failed = must_be_finite && !finite;
}

size_t pm_wire_encode(const pm_wire_type *type, const void *message, void *data, size_t capacity) {
    wire_writer w = {data, capacity, false};
    write_bits(&w, 8, (uint64_t)type->fingerprint());
    const char *m = message;
    for (int i = 0; i < type->nfield; ++i) {
        const pm_wire_field *f = &type->field[i];
        if (f->kind == PM_WIRE_DOUBLE) {
            write_words(&w, 1, true, m + f->offset);
        } else if (is_array(f->kind)) {
            const size_t count = (size_t)get_count(m, f->count);
            write_words(&w, count, f->kind == PM_WIRE_DOUBLES, get_array(m, f->offset));
        } else if (f->kind == PM_WIRE_TEXT) {
            const char *text = get_text(m, f->offset);
            const size_t length = strnlen(text, PM_TEXT_MAX);
            write_bits(&w, 4, length + 1);
            for (size_t k = 0; k < length; ++k) {
                write_bits(&w, 1, is_control(text[k]) ? ' ' : (unsigned char)text[k]);
            }
            write_bits(&w, 1, 0);
        } else { // a single integer
            const char *source = m + f->offset;
            uint64_t bits = (unsigned char)*source;
            uint32_t word;
            if (size_of(f->kind) == 8) {
                memcpy(&bits, source, 8);
            } else if (size_of(f->kind) == 4) {
                memcpy(&word, source, 4);
                bits = word;
            }
            write_bits(&w, size_of(f->kind), bits);
        }
    }
    return w.failed ? 0 : capacity - w.left;
}

size_t pm_wire_size(const pm_wire_type *type, const void *message) {
    const char *m = message;
    size_t size = 8;
    for (int i = 0; i < type->nfield; ++i) {
        const pm_wire_field *f = &type->field[i];
        if (f->kind == PM_WIRE_TEXT) {
            size += 4 + strnlen(get_text(m, f->offset), PM_TEXT_MAX) + 1;
        } else {
            size += size_of(f->kind) * (is_array(f->kind) ? (size_t)get_count(m, f->count) : 1);
        }
    }
    return size;
}

// --- messages as a whole ---

pm_status pm_wire_alloc(const pm_wire_type *type, void *message, pm_arena *arena) {
    char *m = message;
    for (int i = 0; i < type->nfield; ++i) {
        const pm_wire_field *f = &type->field[i];
        if (is_array(f->kind)) {
            void *array = pm_arena_array(arena, (size_t)get_count(m, f->count), 8);
            memcpy(m + f->offset, &array, sizeof array);
        }
    }
    return pm_arena_status(arena, "a message");
}

uint64_t pm_wire_digest(const pm_wire_type *type, const void *message, int row, int rows) {
    const char *m = message;
    uint64_t digest = PM_DIGEST_INIT;
    for (int i = 0; i < type->nfield; ++i) {
        const pm_wire_field *f = &type->field[i];
        const int count = is_array(f->kind) ? get_count(m, f->count) / rows : 0;
        for (int k = row * count; k < (row + 1) * count; ++k) {
            uint64_t bits;
            memcpy(&bits, get_array(m, f->offset) + (ptrdiff_t)8 * k, sizeof bits);
            digest = (digest ^ bits) * UINT64_C(0x9e3779b97f4a7c15);
            digest ^= digest >> 32;
        }
    }
    return digest;
}
