// Encodes the wire types (lcmtypes/portmet.lcm) to bytes and decodes them into memory that the
// caller has prepared; nothing is allocated. The bytes and structs are those of the code that
// lcm-gen generates. Its decoders trust the sender; the functions here check everything.
//
// _decode: the caller sets the array counts of `message`, and its array pointers to that many
// numbers. A flux must have exactly these counts. For a report, a tick and vitals they are the
// largest counts that are accepted, and are replaced by the counts of the message. Length,
// fingerprint, counts, text and numbers are checked; only after PM_KEEP may the message be read.
// Its text then points into `data`. Array pointers never change.
//
// _encode writes at most `capacity` bytes and returns their number; 0 if they do not suffice or a
// number is not finite. Text is cut after PM_TEXT_MAX characters; control characters become blanks.
//
// _size returns the number of bytes that encoding takes.
#ifndef PM_LOCKSTEP_CODEC_H
#define PM_LOCKSTEP_CODEC_H

#include <stddef.h>
#include <stdint.h>

#include "lockstep/wire_format.h"
#include "portmet_command_t.h"
#include "portmet_flux_t.h"
#include "portmet_health_t.h"
#include "portmet_hello_t.h"
#include "portmet_ledger_t.h"
#include "portmet_report_t.h"
#include "portmet_request_t.h"
#include "portmet_tick_t.h"
#include "portmet_vitals_t.h"

// The largest number of steps of a run. Rounds counted from its start then fit an int64_t.
#define PM_STEPS_MAX (INT64_C(1) << 40)

// Protocol version: the sum of the fingerprints of all message types except hello_t.
int64_t pm_protocol(void);

pm_drop pm_hello_decode(portmet_hello_t *message, const void *data, size_t size);
size_t pm_hello_encode(const portmet_hello_t *message, void *data, size_t capacity);

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

pm_drop pm_command_decode(portmet_command_t *message, const void *data, size_t size);
size_t pm_command_encode(const portmet_command_t *message, void *data, size_t capacity);

pm_drop pm_vitals_decode(portmet_vitals_t *message, const void *data, size_t size);
size_t pm_vitals_encode(const portmet_vitals_t *message, void *data, size_t capacity);
size_t pm_vitals_size(const portmet_vitals_t *message);

pm_drop pm_health_decode(portmet_health_t *message, const void *data, size_t size);
size_t pm_health_encode(const portmet_health_t *message, void *data, size_t capacity);
size_t pm_health_size(const portmet_health_t *message);

pm_drop pm_request_decode(portmet_request_t *message, const void *data, size_t size);
size_t pm_request_encode(const portmet_request_t *message, void *data, size_t capacity);

#endif
