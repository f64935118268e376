// 64-bit FNV-1a over bytes in little-endian order.
#include "base/digest.h"

#include <string.h>

static uint64_t fold_word(uint64_t digest, uint64_t word) {
    for (int i = 0; i < 8; ++i) {
        digest = (digest ^ ((word >> (8 * i)) & 0xff)) * UINT64_C(0x100000001b3);
    }
    return digest;
}

uint64_t pm_digest_text(uint64_t digest, const char *text) {
    const unsigned char *byte = (const unsigned char *)text;
    do {
        digest = (digest ^ *byte) * UINT64_C(0x100000001b3);
    } while (*byte++ != 0);
    return digest;
}

uint64_t pm_digest_integer(uint64_t digest, int64_t value) {
    return fold_word(digest, (uint64_t)value);
}

uint64_t pm_digest_doubles(uint64_t digest, const double *value, size_t count) {
    for (size_t i = 0; i < count; ++i) {
        uint64_t word;
        memcpy(&word, &value[i], sizeof word);
        digest = fold_word(digest, word);
    }
    return digest;
}
