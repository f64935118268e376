// Writes lines of text and of JSON on standard error. Each line is one call of fwrite, so that
// lines of several processes do not mix.
#include "base/journal.h"

#include <assert.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#define LINE 4096 // bytes of a line, at most; longer messages are cut

// --- JSON ---

#define LONGEST_CHARACTER \
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

size_t pm_json_quote(char *quoted, size_t size, const char *text) {
    assert(size >= 3);
    size_t used = 0;
    quoted[used++] = '"';
    while (*text != 0) {
        char written[LONGEST_CHARACTER];
        const size_t length = character((const unsigned char *)text);
        const unsigned char c = (unsigned char)text[0];
        if (length == 0) {
            strcpy(written, "\\ufffd");
        } else if (c == '"' || c == '\\') {
            snprintf(written, sizeof written, "\\%c", c);
        } else if (c < 0x20 || c == 0x7f) {
            snprintf(written, sizeof written, "\\u%04x", c);
        } else {
            memcpy(written, text, length);
            written[length] = 0;
        }
        if (used + strlen(written) + 2 > size) {
            break;
        }
        used += strlen(strcpy(quoted + used, written));
        text += length > 0 ? length : 1;
    }
    strcpy(quoted + used, "\"");
    return used + 1;
}

// --- lines ---

static const char *const level_names[] = {"notice", "warning", "error"};
static const char warning_prefix[] = "warning: ";

// A line that is being written. Two bytes stay free for the end.
typedef struct line {
    char text[LINE];
    size_t used;
} line;

__attribute__((format(printf, 2, 3))) static void append(line *l, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    const size_t left = sizeof l->text - l->used;
    const int length = vsnprintf(l->text + l->used, left, format, arguments);
    va_end(arguments);
    if (length > 0) {
        l->used += (size_t)length < left ? (size_t)length : left - 1;
    }
}

// Appends a text in quotes, which is cut after `most` bytes. A few bytes stay free for what
// follows.
static void append_quoted(line *l, const char *text, size_t most) {
    const size_t room = sizeof l->text - l->used;
    if (room < 16) {
        return;
    }
    l->used += pm_json_quote(l->text + l->used, most < room - 8 ? most : room - 8, text);
}

static void write_json(const char *part, pm_journal_level level, int nfield,
                       const pm_journal_field *field, const char *message) {
    line l = {.used = 0};
    struct timespec now;
    struct tm utc;
    char text[32] = "";
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc);
    append(&l, "{\"time\":\"%s.%06ldZ\"", text, now.tv_nsec / 1000);
    append(&l, ",\"level\":\"%s\",\"part\":", level_names[level]);
    append_quoted(&l, part == NULL ? "" : part, 128);
    append(&l, ",\"message\":");
    append_quoted(&l, message, 2048);
    append(&l, ",\"fields\":{");
    for (int i = 0; i < nfield; ++i) {
        append(&l, "%s\"%s\":", i > 0 ? "," : "", field[i].name);
        if (field[i].text != NULL) {
            append_quoted(&l, field[i].text, 256);
        } else if (isfinite(field[i].number)) {
            append(&l, "%.17g", field[i].number);
        } else {
            append(&l, "null");
        }
    }
    append(&l, "}}\n");
    fwrite(l.text, 1, l.used, stderr);
}

pm_status pm_journal_read_form(const char *value, bool *json) {
    *json = value != NULL && strcmp(value, "json") == 0;
    return value == NULL || *json || strcmp(value, "text") == 0
               ? PM_OK
               : pm_fail(PM_EUSAGE, "--log: expected text or json, found \"%.64s\"", value);
}

void pm_journal_write(const pm_journal *log, pm_journal_level level, int nfield,
                      const pm_journal_field *field, const char *format, ...) {
    char message[2048];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    if (log->json) {
        write_json(log->part, level, nfield, field, message);
        return;
    }
    fprintf(stderr, "%s: %s%s\n", log->program, level == PM_JOURNAL_WARNING ? warning_prefix : "",
            message);
}

void pm_journal_pass_on(const pm_journal *log, const char *part, const char *text) {
    if (text[0] == 0) {
        return;
    }
    if (!log->json) {
        fprintf(stderr, "[%s] %s\n", part, text);
        return;
    }
    const size_t length = strlen(log->program);
    const bool own =
        strncmp(text, log->program, length) == 0 && strncmp(text + length, ": ", 2) == 0;
    const char *message = own ? text + length + 2 : text;
    const size_t prefix = sizeof warning_prefix - 1;
    const bool warns = own && strncmp(message, warning_prefix, prefix) == 0;
    write_json(part, warns ? PM_JOURNAL_WARNING : PM_JOURNAL_NOTICE, 0, NULL,
               warns ? message + prefix : message);
}
