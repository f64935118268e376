// The wire types (lcmtypes/portmet.lcm) to bytes and back, into memory the caller has prepared:
// nothing is allocated. Same bytes as the code that lcm-gen generates, whose structs are used here;
// but its decoders trust the sender, and these do not.
//
// _decode: `message` comes with its array counts set and its array pointers at that many numbers.
// A flux must have exactly these counts; a report's are the largest it may have, and are replaced
// by what it has. Length, fingerprint, counts, text and numbers are checked; PM_KEEP is the only
// result after which the message may be read. Text then points into `data`. Array pointers are
// never changed. _encode: writes at most `capacity` bytes and returns how many; 0 if they do not
// suffice or a number is not finite. Text is cut after PM_TEXT_MAX characters; control characters
// become blanks. _size: the bytes that encoding takes.
#ifndef PM_LOCKSTEP_CODEC_H
#define PM_LOCKSTEP_CODEC_H

#include <stddef.h>
#include <stdint.h>

#include "portmet_command_t.h"
#include "portmet_flux_t.h"
#include "portmet_hello_t.h"
#include "portmet_ledger_t.h"
#include "portmet_report_t.h"
#include "portmet_request_t.h"
#include "portmet_tick_t.h"
#include "transport/drops.h"

#define PM_TEXT_MAX 1023 // characters, without the terminator

// Steps of a run, at most: then rounds counted from its start fit an int64_t.
#define PM_STEPS_MAX (INT64_C(1) << 40)

// What a hello says of the types: their fingerprints, added up, but its own, which stays the same.
int64_t pm_protocol(void);

pm_drop pm_hello_decode(portmet_hello_t *message, const void *data, size_t size);
size_t pm_hello_encode(const portmet_hello_t *message, void *data, size_t capacity);
size_t pm_hello_size(const portmet_hello_t *message);

pm_drop pm_flux_decode(portmet_flux_t *message, const void *data, size_t size);
size_t pm_flux_encode(const portmet_flux_t *message, void *data, size_t capacity);
size_t pm_flux_size(const portmet_flux_t *message);

pm_drop pm_tick_decode(portmet_tick_t *message, const void *data, size_t size);
size_t pm_tick_encode(const portmet_tick_t *message, void *data, size_t capacity);
size_t pm_tick_size(const portmet_tick_t *message);

pm_drop pm_report_decode(portmet_report_t *message, const void *data, size_t size);
size_t pm_report_encode(const portmet_report_t *message, void *data, size_t capacity);
size_t pm_report_size(const portmet_report_t *message);

pm_drop pm_ledger_decode(portmet_ledger_t *message, const void *data, size_t size);
size_t pm_ledger_encode(const portmet_ledger_t *message, void *data, size_t capacity);
size_t pm_ledger_size(const portmet_ledger_t *message);

pm_drop pm_command_decode(portmet_command_t *message, const void *data, size_t size);
size_t pm_command_encode(const portmet_command_t *message, void *data, size_t capacity);
size_t pm_command_size(const portmet_command_t *message);

pm_drop pm_request_decode(portmet_request_t *message, const void *data, size_t size);
size_t pm_request_encode(const portmet_request_t *message, void *data, size_t capacity);
size_t pm_request_size(const portmet_request_t *message);

#endif
