// LCM's wire format, as its documentation gives it; all numbers big-endian.
//   short message  magic "LC02", sequence, channel with its terminator, data
//   fragment       magic "LC03", sequence, size of the data, offset of this part, its number and
//   how
//                  many there are (16 bits each), the channel in number 0 only, this part
// Bytes from the network are hostile until parsed here.
#ifndef PM_TRANSPORT_DATAGRAM_H
#define PM_TRANSPORT_DATAGRAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/status.h"

#define PM_DATAGRAM_SHORT UINT32_C(0x4c433032)
#define PM_DATAGRAM_FRAGMENT UINT32_C(0x4c433033)
#define PM_DATAGRAM_SHORT_HEAD 8     // bytes before the channel
#define PM_DATAGRAM_FRAGMENT_HEAD 20 // likewise

// Bytes of the largest message that is put together.
#define PM_MESSAGE_MAX ((size_t)1 << 24)

typedef struct pm_datagram {
    const char *channel;       // NULL: a later fragment, which does not name it
    const unsigned char *data; // [size] the message, or this part of it
    size_t size;
    size_t offset, total;   // of the part within the message; size of the message
    uint32_t sequence;      // the sender's number of the message
    unsigned number, count; // of the part; 0 of 1: a whole message
} pm_datagram;

// False: not LCM's, or it contradicts itself. Pointers are into `bytes`.
bool pm_datagram_parse(pm_datagram *datagram, const void *bytes, size_t size);

// A message that arrives in parts, in any order after the first. Storage the caller owns;
// zero-initialise.
typedef struct pm_reassembly {
    unsigned char *data; // [total], then [count] flags: this part is there
    size_t capacity;
    uint64_t sender; // whatever tells senders apart
    uint32_t sequence;
    size_t total, received;  // bytes
    unsigned count, missing; // parts; missing 0: nothing under way
} pm_reassembly;

void pm_reassembly_free(pm_reassembly *reassembly);

// Starts with a message's first part, in place of what was under way. PM_ENOMEM.
pm_status pm_reassembly_begin(pm_reassembly *reassembly, const pm_datagram *first, uint64_t sender);

// True if the part belongs to what is under way; then takes it in.
bool pm_reassembly_add(pm_reassembly *reassembly, const pm_datagram *part, uint64_t sender);

// No part is missing, and they are as long as the whole: data [total] is the message, until the
// next _begin. So a few bytes cannot pass for a large message.
bool pm_reassembly_complete(const pm_reassembly *reassembly);

#endif
