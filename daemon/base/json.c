// Quotes a text character by character.
#include "base/json.h"

#include <assert.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

#define LONGEST \
    7 // bytes of a character in JSON, at most, with a terminator: an escape such as \u001b

// Returns the length in bytes of the UTF-8 character at the beginning of `text`, which is not
// empty; 0: there is none. Overlong forms and surrogates are no characters (Unicode 15, table 3-7).
static size_t character(const unsigned char *text) {
    const unsigned char first = text[0];
    const size_t length = first < 0x80                    ? 1
                          : first >= 0xc2 && first < 0xe0 ? 2
                          : first >= 0xe0 && first < 0xf0 ? 3
                          : first >= 0xf0 && first < 0xf5 ? 4
                                                          : 0;
    for (size_t i = 1; i < length; ++i) {
        if ((text[i] & 0xc0) != 0x80) {
            return 0;
        }
    }
    const unsigned char second = length > 1 ? text[1] : 0;
    const bool wrong = (first == 0xe0 && second < 0xa0) || (first == 0xed && second > 0x9f) ||
                       (first == 0xf0 && second < 0x90) || (first == 0xf4 && second > 0x8f);
    return wrong ? 0 : length;
}

// Writes the character of `length` bytes, or what stands for a byte that is none (0), and a
// terminator.
static void write_character(char written[LONGEST], const char *text, size_t length) {
    const unsigned char c = (unsigned char)text[0];
    if (length == 0) {
        strcpy(written, "\\ufffd");
    } else if (c == '"' || c == '\\') {
        snprintf(written, LONGEST, "\\%c", c);
    } else if (c < 0x20 || c == 0x7f) {
        snprintf(written, LONGEST, "\\u%04x", c);
    } else {
        memcpy(written, text, length);
        written[length] = 0;
    }
}

size_t pm_json_quote(char *quoted, size_t size, const char *text) {
    assert(size >= 3);
    size_t used = 0;
    quoted[used++] = '"';
    while (*text != 0) {
        char written[LONGEST];
        const size_t length = character((const unsigned char *)text);
        write_character(written, text, length);
        if (used + strlen(written) + 2 > size) {
            break;
        }
        used += strlen(strcpy(quoted + used, written));
        text += length > 0 ? length : 1;
    }
    strcpy(quoted + used, "\"");
    return used + 1;
}
