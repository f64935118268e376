// Parses LCM's UDP datagrams and reassembles fragmented messages. The format, as LCM documents it;
// all numbers are big-endian:
//   short message  magic "LC02", sequence number, channel with its terminator, data
//   fragment       magic "LC03", sequence number, size of the message, offset of this fragment, its
//                  number and the number of fragments (16 bits each), in fragment 0 the channel,
//                  then this part of the data
// Bytes from the network are not trusted; this parser checks all sizes and offsets.
#ifndef PM_TRANSPORT_DATAGRAM_H
#define PM_TRANSPORT_DATAGRAM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/status.h"
#include <linux/filter.h>

#define PM_DATAGRAM_SHORT UINT32_C(0x4c433032)    // magic of a short message, "LC02"
#define PM_DATAGRAM_FRAGMENT UINT32_C(0x4c433033) // magic of a fragment, "LC03"
#define PM_DATAGRAM_SHORT_HEAD 8                  // bytes before the channel of a short message
#define PM_DATAGRAM_FRAGMENT_HEAD 20              // bytes of a fragment before channel or data

// The largest message that is reassembled, bytes.
#define PM_MESSAGE_MAX ((size_t)1 << 24)

typedef struct pm_datagram {
    const char *channel;       // NULL: a fragment after the first, which does not name it
    const unsigned char *data; // [size] the message, or this part of it
    size_t size;
    size_t offset, total;   // bytes: position of the part in the message; size of the message
    uint32_t sequence;      // the sender's number of the message
    unsigned number, count; // number of this fragment, number of fragments; short message: 0, 1
} pm_datagram;

// Parses `bytes` [size]. The pointers in `datagram` point into `bytes`. Returns false, and leaves
// `datagram` unchanged, if the bytes are not in LCM's format or the sizes in them contradict each
// other.
bool pm_datagram_parse(pm_datagram *datagram, const void *bytes, size_t size);

// A message that is being reassembled. Its first fragment must arrive first, the others may arrive
// in any order. The caller owns this storage and initialises it with zeros.
typedef struct pm_reassembly {
    unsigned char *data; // [total] the message, then [count] flags of the fragments that arrived
    size_t capacity;
    uint64_t sender; // address and port
    uint32_t sequence;
    size_t total, received;  // bytes
    unsigned count, missing; // fragments; no message is being reassembled while `missing` is 0
} pm_reassembly;

void pm_reassembly_free(pm_reassembly *reassembly);

// Begins with the first fragment of a message. If it discards a message that is still incomplete,
// it adds 1 to `discarded`. PM_ENOMEM.
pm_status pm_reassembly_begin(pm_reassembly *reassembly, const pm_datagram *first, uint64_t sender,
                              long *discarded);

// Adds a fragment to the message being reassembled. Returns false if the fragment belongs to
// another message.
bool pm_reassembly_add(pm_reassembly *reassembly, const pm_datagram *part, uint64_t sender);

// Returns true if no fragment is missing and the sizes of the fragments add up to the size of the
// message. The check of the sum prevents a few small fragments from counting as a large message. If
// true, `data` [total] holds the message until the next call of pm_reassembly_begin.
bool pm_reassembly_complete(const pm_reassembly *reassembly);

// --- the filter of channels ---

// Builds a classic BPF program with which the kernel drops datagrams on channels that this process
// has not subscribed to, before they wake it.
// Builds a program that accepts the messages on the channels `name` [count] and drops those on all
// others. It also accepts every fragment of a message after the first one, because such a fragment
// does not name its channel. The names must be distinct and sorted by strcmp. Without names (count
// = 0) the program drops all other datagrams. `start` is the position of LCM's datagram in the
// bytes that the filter sees: 8 on a UDP socket. The caller frees `program->filter`.
//
// No program can be built if a name has fewer than three characters, or if the program would have
// more than BPF_MAXINSNS (4096) instructions. The function then returns PM_OK with
// `program->filter` NULL, and the socket must accept everything. PM_ENOMEM.
pm_status pm_channel_filter_build(struct sock_fprog *program, int count, const char *const *name,
                                  unsigned start);

#endif
