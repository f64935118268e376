// Encodes the wire types (lcmtypes/portmet.lcm) to bytes and decodes them into memory that the
// caller has prepared; nothing is allocated. The bytes and structs are those of the code that
// lcm-gen generates. Its decoders trust the sender; the functions here check everything. The format
// is LCM's: the fingerprint, then the fields in order, packed, big-endian; text with its length
// (terminator included) in front. One reader and one writer walk the tables of the types, which the
// build makes from portmet.lcm (lcmtypes/wire_types.awk). For each type there are
//
//     pm_drop pm_flux_decode(portmet_flux_t *message, const void *data, size_t size);
//     size_t pm_flux_encode(const portmet_flux_t *message, void *data, size_t capacity);
//     size_t pm_flux_size(const portmet_flux_t *message);
//     pm_status pm_flux_alloc(portmet_flux_t *message, pm_arena *arena);
//
// _decode: the caller sets the array counts of `message`, and its array pointers to that many
// numbers. A type that is `exact` must have exactly these counts. For all others they are the
// largest counts that are accepted, and are replaced by the counts of the message. Length,
// fingerprint, counts, text and numbers are checked; only after PM_KEEP may the message be read.
// Its text then points into `data`. Array pointers never change.
//
// _encode writes at most `capacity` bytes and returns their number; 0 if they do not suffice or a
// number is not finite. Text is cut after PM_TEXT_MAX characters; control characters become blanks.
//
// _size returns the number of bytes that encoding takes. _alloc sets the array pointers to memory
// of the arena for the counts in `message`. PM_ENOMEM.
#ifndef PM_LOCKSTEP_CODEC_H
#define PM_LOCKSTEP_CODEC_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/arena.h"
#include "portmet_command_t.h"
#include "portmet_control_reply_t.h"
#include "portmet_control_t.h"
#include "portmet_flux_t.h"
#include "portmet_health_t.h"
#include "portmet_hello_t.h"
#include "portmet_input_t.h"
#include "portmet_ledger_t.h"
#include "portmet_report_t.h"
#include "portmet_request_t.h"
#include "portmet_tick_t.h"
#include "portmet_vitals_t.h"
#include "transport/drops.h"

#define PM_TEXT_MAX 1023 // characters of a text, without the terminator

// The largest number of steps of a run. Rounds counted from its start then fit an int64_t.
#define PM_STEPS_MAX (INT64_C(1) << 40)

typedef enum pm_wire_kind {
    PM_WIRE_I8,
    PM_WIRE_BOOLEAN,
    PM_WIRE_I32,
    PM_WIRE_I64,
    PM_WIRE_DOUBLE,
    PM_WIRE_COUNT,   // an int32_t that counts the elements of later arrays
    PM_WIRE_DOUBLES, // an array of double; `count` is the offset of its count in the struct
    PM_WIRE_I64S,    // an array of int64_t; `count` is the offset of its count in the struct
    PM_WIRE_TEXT
} pm_wire_kind;

typedef struct pm_wire_field {
    pm_wire_kind kind;
    size_t offset, count; // bytes from the beginning of the struct; `count` for arrays alone
} pm_wire_field;

typedef struct pm_wire_type {
    int64_t (*fingerprint)(void);
    int nfield;
    const pm_wire_field *field; // [nfield]
} pm_wire_type;

// All types, NULL at the end.
extern const pm_wire_type *const pm_wire_types[];

// The functions above for any type.
pm_drop pm_wire_decode(const pm_wire_type *type, bool exact, void *message, const void *data,
                       size_t size);
size_t pm_wire_encode(const pm_wire_type *type, const void *message, void *data, size_t capacity);
size_t pm_wire_size(const pm_wire_type *type, const void *message);
pm_status pm_wire_alloc(const pm_wire_type *type, void *message, pm_arena *arena);

// Returns a digest of row `row` of a message whose arrays have `rows` rows. It takes eight bytes at
// a time, so that it is quick.
uint64_t pm_wire_digest(const pm_wire_type *type, const void *message, int row, int rows);

#define PM_CODEC(type, exact)                                                                 \
    extern const pm_wire_type pm_##type##_type;                                               \
    static inline pm_drop pm_##type##_decode(portmet_##type##_t *message, const void *data,   \
                                             size_t size) {                                   \
        return pm_wire_decode(&pm_##type##_type, exact, message, data, size);                 \
    }                                                                                         \
    static inline size_t pm_##type##_encode(const portmet_##type##_t *message, void *data,    \
                                            size_t capacity) {                                \
        return pm_wire_encode(&pm_##type##_type, message, data, capacity);                    \
    }                                                                                         \
    static inline size_t pm_##type##_size(const portmet_##type##_t *message) {                \
        return pm_wire_size(&pm_##type##_type, message);                                      \
    }                                                                                         \
    static inline pm_status pm_##type##_alloc(portmet_##type##_t *message, pm_arena *arena) { \
        return pm_wire_alloc(&pm_##type##_type, message, arena);                              \
    }

PM_CODEC(hello, true)
PM_CODEC(flux, true)
PM_CODEC(tick, false)
PM_CODEC(input, true)
PM_CODEC(report, false)
PM_CODEC(ledger, true)
PM_CODEC(command, true)
PM_CODEC(request, true)
PM_CODEC(vitals, false)
PM_CODEC(health, true)
PM_CODEC(control, false)
PM_CODEC(control_reply, false)

#endif
