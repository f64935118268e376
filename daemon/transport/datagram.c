// Parses LCM datagrams and joins fragments.
#include "transport/datagram.h"

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

static bool parse_fragment(pm_datagram *d, const unsigned char *head) {
    d->total = read_number(head + 8, 4);
    d->offset = read_number(head + 12, 4);
    d->number = read_number(head + 16, 2);
    d->count = read_number(head + 18, 2);
    if (d->number == 0 && (d->offset != 0 || !take_channel(d))) {
        return false;
    }
    return d->number < d->count && d->total <= PM_MESSAGE_MAX && d->size <= d->total &&
           d->offset <= d->total - d->size;
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
        good = parse_fragment(&d, head);
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
