// LCM's wire format for types that are described by tables of their fields: the fingerprint, then
// the fields in order, packed, big-endian; text with its length (terminator included) in front. One
// reader and one writer walk the tables. codec.h says what they check.
#ifndef PM_LOCKSTEP_WIRE_FORMAT_H
#define PM_LOCKSTEP_WIRE_FORMAT_H

#include <stddef.h>
#include <stdint.h>

#include "transport/drops.h"

#define PM_TEXT_MAX 1023 // characters of a text, without the terminator

typedef enum pm_wire_kind {
    PM_WIRE_I8,
    PM_WIRE_BOOLEAN,
    PM_WIRE_I32,
    PM_WIRE_I64,
    PM_WIRE_DOUBLE,
    PM_WIRE_COUNT,    // an int32_t that counts the elements of later arrays
    PM_WIRE_COUNT_TO, // a count, too; the caller sets it to the largest count that is accepted
    PM_WIRE_DOUBLES,  // an array of double; `count` is the offset of its count in the struct
    PM_WIRE_I64S,     // an array of int64_t; `count` is the offset of its count in the struct
    PM_WIRE_TEXT
} pm_wire_kind;

typedef struct pm_wire_field {
    pm_wire_kind kind;
    size_t offset, count; // bytes from the beginning of the struct; `count` for arrays alone
} pm_wire_field;

#define PM_WIRE_FIELDS 29 // the largest number of fields of a type

typedef struct pm_wire_type {
    int64_t (*fingerprint)(void);
    int nfield;
    pm_wire_field field[PM_WIRE_FIELDS];
} pm_wire_type;

// Decodes `data` [size] into `message`, a struct of this type, as pm_*_decode of codec.h do.
pm_drop pm_wire_decode(const pm_wire_type *type, void *message, const void *data, size_t size);

// Encodes `message` into `data` and returns the number of bytes; 0 if `capacity` does not suffice
// or a number is not finite.
size_t pm_wire_encode(const pm_wire_type *type, const void *message, void *data, size_t capacity);

// Returns the number of bytes that encoding `message` takes.
size_t pm_wire_size(const pm_wire_type *type, const void *message);

#endif
