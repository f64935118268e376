// Each wire type is described once, as a table of its fields; one reader and one writer walk the
// tables. LCM's format: the fingerprint, then the fields in order, packed, big-endian; text with
// its length (terminator included) in front.
#include "lockstep/codec.h"

#include <endian.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

typedef enum field_kind {
    FIELD_I8,
    FIELD_BOOLEAN,
    FIELD_I32,
    FIELD_I64,
    FIELD_DOUBLE,
    FIELD_COUNT,    // an int32_t that counts the elements of later arrays
    FIELD_COUNT_TO, // the same; the caller's count is the largest allowed
    FIELD_DOUBLES,  // an array; `count` is the offset of its FIELD_COUNT
    FIELD_I64S,     // likewise
    FIELD_TEXT
} field_kind;

typedef struct field {
    field_kind kind;
    size_t offset, count; // in the struct
} field;

#define MAX_FIELDS 27

typedef struct wire_type {
    int64_t (*fingerprint)(void);
    int nfield;
    field field[MAX_FIELDS];
} wire_type;

// --- the tables ---

#define F(kind, type, name) \
    { FIELD_##kind, offsetof(portmet_##type##_t, name), 0 }
#define ARRAY(kind, type, name, length) \
    { FIELD_##kind, offsetof(portmet_##type##_t, name), offsetof(portmet_##type##_t, length) }

static const wire_type hello_type = {
    __portmet_hello_t_get_hash,
    8,
    {F(I64, hello, protocol), F(I64, hello, session), F(I64, hello, instance), F(I64, hello, nonce),
     F(I64, hello, coordinator), F(I64, hello, digest), F(I64, hello, checkpoint),
     F(TEXT, hello, sender)},
};

static const wire_type flux_type = {
    __portmet_flux_t_get_hash,
    13,
    {F(I64, flux, session), F(I64, flux, step), F(I32, flux, round), F(DOUBLE, flux, time),
     F(COUNT, flux, nend), ARRAY(DOUBLES, flux, energy_flux, nend),
     ARRAY(DOUBLES, flux, entropy_flux, nend), F(COUNT, flux, ny), ARRAY(DOUBLES, flux, y, ny),
     ARRAY(DOUBLES, flux, e, ny), ARRAY(DOUBLES, flux, eta, ny), F(COUNT, flux, nresponse),
     ARRAY(DOUBLES, flux, response, nresponse)},
};

static const wire_type tick_type = {
    __portmet_tick_t_get_hash,
    12,
    {F(I64, tick, session), F(I64, tick, instance), F(I64, tick, digest), F(I64, tick, granted),
     F(I64, tick, steps), F(DOUBLE, tick, t0), F(DOUBLE, tick, dt), F(I32, tick, substeps),
     F(BOOLEAN, tick, want_state), F(BOOLEAN, tick, open), F(COUNT_TO, tick, nanswer),
     ARRAY(I64S, tick, answer, nanswer)},
};

static const wire_type report_type = {
    __portmet_report_t_get_hash,
    27,
    {F(I64, report, session),
     F(I64, report, instance),
     F(I64, report, coordinator),
     F(I64, report, digest),
     F(I8, report, kind),
     F(I8, report, code),
     F(I64, report, step),
     F(DOUBLE, report, time),
     F(COUNT_TO, report, npart),
     ARRAY(DOUBLES, report, energy, npart),
     ARRAY(DOUBLES, report, entropy, npart),
     ARRAY(DOUBLES, report, bulk_energy, npart),
     ARRAY(DOUBLES, report, bulk_entropy, npart),
     ARRAY(DOUBLES, report, bulk_energy_gross, npart),
     ARRAY(DOUBLES, report, bulk_entropy_gross, npart),
     ARRAY(I64S, report, evaluated, npart),
     ARRAY(I64S, report, skipped, npart),
     ARRAY(I64S, report, outside, npart),
     ARRAY(DOUBLES, report, error, npart),
     F(COUNT_TO, report, nend),
     ARRAY(DOUBLES, report, energy_flux, nend),
     ARRAY(DOUBLES, report, entropy_flux, nend),
     ARRAY(DOUBLES, report, energy_gross, nend),
     ARRAY(DOUBLES, report, entropy_gross, nend),
     F(COUNT_TO, report, nz),
     ARRAY(DOUBLES, report, z, nz),
     F(TEXT, report, message)},
};

static const wire_type ledger_type = {
    __portmet_ledger_t_get_hash,
    8,
    {F(I64, ledger, session), F(I64, ledger, step), F(DOUBLE, ledger, time),
     F(DOUBLE, ledger, energy), F(DOUBLE, ledger, entropy), F(DOUBLE, ledger, energy_residual),
     F(DOUBLE, ledger, entropy_residual), F(I64, ledger, violations)},
};

static const wire_type vitals_type = {
    __portmet_vitals_t_get_hash,
    16,
    {F(I64, vitals, session), F(I32, vitals, process), F(I64, vitals, step),
     F(DOUBLE, vitals, elapsed), F(DOUBLE, vitals, computing), F(DOUBLE, vitals, cpu),
     F(I64, vitals, rss), F(DOUBLE, vitals, checkpoint_age), F(COUNT_TO, vitals, npeer),
     ARRAY(I64S, vitals, peer, npeer), ARRAY(DOUBLES, vitals, waited, npeer),
     ARRAY(I64S, vitals, asked, npeer), ARRAY(I64S, vitals, used, npeer),
     ARRAY(I64S, vitals, answered, npeer), F(COUNT_TO, vitals, ndrop),
     ARRAY(I64S, vitals, drops, ndrop)},
};

static const wire_type health_type = {
    __portmet_health_t_get_hash,
    22,
    {F(I64, health, session),
     F(I64, health, digest),
     F(I64, health, step),
     F(I64, health, steps),
     F(DOUBLE, health, rate),
     F(I64, health, blocker),
     F(COUNT, health, nprocess),
     ARRAY(I64S, health, process_step, nprocess),
     ARRAY(DOUBLES, health, process_rate, nprocess),
     ARRAY(DOUBLES, health, silent, nprocess),
     ARRAY(DOUBLES, health, cpu, nprocess),
     ARRAY(DOUBLES, health, computing, nprocess),
     ARRAY(I64S, health, waits_for, nprocess),
     ARRAY(DOUBLES, health, waits_part, nprocess),
     ARRAY(DOUBLES, health, asks, nprocess),
     ARRAY(DOUBLES, health, answers, nprocess),
     ARRAY(I64S, health, loses_from, nprocess),
     ARRAY(DOUBLES, health, loss, nprocess),
     ARRAY(I64S, health, drops, nprocess),
     ARRAY(I64S, health, strange, nprocess),
     ARRAY(DOUBLES, health, checkpoint_age, nprocess),
     ARRAY(I64S, health, rss, nprocess)},
};

static const wire_type command_type = {
    __portmet_command_t_get_hash,
    7,
    {F(I64, command, session), F(I64, command, instance), F(I64, command, addressee),
     F(I64, command, answer), F(I8, command, kind), F(I8, command, code), F(TEXT, command, reason)},
};

static const wire_type request_type = {
    __portmet_request_t_get_hash,
    7,
    {F(I64, request, session), F(TEXT, request, sender), F(I64, request, instance),
     F(I64, request, attempt), F(TEXT, request, channel), F(I64, request, step),
     F(I32, request, round)},
};

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

static pm_drop read_integer(wire_reader *r, field_kind kind, char *target) {
    const bool is_count = kind == FIELD_COUNT || kind == FIELD_COUNT_TO;
    const size_t size = kind == FIELD_I64 ? 8 : kind == FIELD_I32 || is_count ? 4 : 1;
    uint64_t bits;
    if (!read_bits(r, size, &bits)) {
        return PM_DROP_LENGTH;
    }
    const uint32_t word = (uint32_t)bits;
    const uint8_t byte = (uint8_t)bits;
    switch (kind) {
    case FIELD_I64:
        memcpy(target, &bits, 8);
        return PM_KEEP;
    case FIELD_I32:
        memcpy(target, &word, 4);
        return PM_KEEP;
    case FIELD_COUNT:
        return memcmp(target, &word, 4) == 0 ? PM_KEEP : PM_DROP_COUNT;
    case FIELD_COUNT_TO:
        if (word > (uint32_t)get_count(target, 0)) {
            return PM_DROP_COUNT;
        }
        memcpy(target, &word, 4);
        return PM_KEEP;
    case FIELD_BOOLEAN:
        memcpy(target, &byte, 1);
        return byte <= 1 ? PM_KEEP : PM_DROP_NUMBER;
    default:
        memcpy(target, &byte, 1);
        return PM_KEEP;
    }
}

static pm_drop decode(const wire_type *type, void *message, const void *data, size_t size) {
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
        const field *f = &type->field[i];
        pm_drop drop;
        if (f->kind == FIELD_DOUBLE) {
            drop = read_words(&r, 1, true, m + f->offset);
        } else if (f->kind == FIELD_DOUBLES || f->kind == FIELD_I64S) {
            // The count was decoded and checked before: the caller's memory holds as many numbers.
            const size_t count = (size_t)get_count(m, f->count);
            drop = read_words(&r, count, f->kind == FIELD_DOUBLES, get_array(m, f->offset));
        } else if (f->kind == FIELD_TEXT) {
            drop = read_text(&r, m + f->offset);
        } else {
            drop = read_integer(&r, f->kind, m + f->offset);
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

static void write_text(wire_writer *w, const char *text) {
    const size_t length = strnlen(text, PM_TEXT_MAX);
    write_bits(w, 4, length + 1);
    for (size_t i = 0; i < length; ++i) {
        write_bits(w, 1, is_control(text[i]) ? ' ' : (unsigned char)text[i]);
    }
    write_bits(w, 1, 0);
}

static void write_integer(wire_writer *w, field_kind kind, const char *source) {
    uint64_t bits = 0;
    uint32_t word;
    switch (kind) {
    case FIELD_I64:
        memcpy(&bits, source, 8);
        write_bits(w, 8, bits);
        return;
    case FIELD_I32:
    case FIELD_COUNT:
    case FIELD_COUNT_TO:
        memcpy(&word, source, 4);
        write_bits(w, 4, word);
        return;
    default:
        write_bits(w, 1, (unsigned char)*source);
    }
}

static size_t encode(const wire_type *type, const void *message, void *data, size_t capacity) {
    wire_writer w = {data, capacity, false};
    write_bits(&w, 8, (uint64_t)type->fingerprint());
    const char *m = message;
    for (int i = 0; i < type->nfield; ++i) {
        const field *f = &type->field[i];
        if (f->kind == FIELD_DOUBLE) {
            write_words(&w, 1, true, m + f->offset);
        } else if (f->kind == FIELD_DOUBLES || f->kind == FIELD_I64S) {
            const size_t count = (size_t)get_count(m, f->count);
            write_words(&w, count, f->kind == FIELD_DOUBLES, get_array(m, f->offset));
        } else if (f->kind == FIELD_TEXT) {
            write_text(&w, get_text(m, f->offset));
        } else {
            write_integer(&w, f->kind, m + f->offset);
        }
    }
    return w.failed ? 0 : capacity - w.left;
}

static size_t size_of(const wire_type *type, const void *message) {
    const char *m = message;
    size_t size = 8;
    for (int i = 0; i < type->nfield; ++i) {
        const field *f = &type->field[i];
        switch (f->kind) {
        case FIELD_I8:
        case FIELD_BOOLEAN:
            size += 1;
            break;
        case FIELD_I32:
        case FIELD_COUNT:
        case FIELD_COUNT_TO:
            size += 4;
            break;
        case FIELD_I64:
        case FIELD_DOUBLE:
            size += 8;
            break;
        case FIELD_DOUBLES:
        case FIELD_I64S:
            size += 8 * (size_t)get_count(m, f->count);
            break;
        case FIELD_TEXT:
            size += 4 + strnlen(get_text(m, f->offset), PM_TEXT_MAX) + 1;
            break;
        }
    }
    return size;
}

// --- the typed functions ---

int64_t pm_protocol(void) {
    static const wire_type *const type[] = {&flux_type,   &tick_type,    &report_type,
                                            &ledger_type, &command_type, &request_type,
                                            &vitals_type, &health_type};
    uint64_t sum = 0;
    for (size_t i = 0; i < sizeof type / sizeof type[0]; ++i) {
        sum += (uint64_t)type[i]->fingerprint();
    }
    return (int64_t)sum;
}

#define CODEC(type)                                                                             \
    pm_drop pm_##type##_decode(portmet_##type##_t *message, const void *data, size_t size) {    \
        return decode(&type##_type, message, data, size);                                       \
    }                                                                                           \
    size_t pm_##type##_encode(const portmet_##type##_t *message, void *data, size_t capacity) { \
        return encode(&type##_type, message, data, capacity);                                   \
    }

CODEC(hello)
CODEC(flux)
CODEC(tick)
CODEC(report)
CODEC(ledger)
CODEC(command)
CODEC(request)
CODEC(vitals)
CODEC(health)

size_t pm_flux_size(const portmet_flux_t *message) {
    return size_of(&flux_type, message);
}

size_t pm_vitals_size(const portmet_vitals_t *message) {
    return size_of(&vitals_type, message);
}

size_t pm_health_size(const portmet_health_t *message) {
    return size_of(&health_type, message);
}

size_t pm_tick_size(const portmet_tick_t *message) {
    return size_of(&tick_type, message);
}

size_t pm_report_size(const portmet_report_t *message) {
    return size_of(&report_type, message);
}
