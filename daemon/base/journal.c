// Writes lines of text and of JSON on standard error. Each line is one call of fwrite, so that
// lines of several processes do not mix.
#include "base/journal.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "base/json.h"

#define LINE 4096 // bytes of a line, at most; longer messages are cut

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

static void append_time(line *l) {
    struct timespec now;
    struct tm utc;
    char text[32] = "";
    clock_gettime(CLOCK_REALTIME, &now);
    gmtime_r(&now.tv_sec, &utc);
    strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%S", &utc);
    append(l, "{\"time\":\"%s.%06ldZ\"", text, now.tv_nsec / 1000);
}

static void append_fields(line *l, int nfield, const pm_journal_field *field) {
    append(l, ",\"fields\":{");
    for (int i = 0; i < nfield; ++i) {
        append(l, "%s\"%s\":", i > 0 ? "," : "", field[i].name);
        if (field[i].text != NULL) {
            append_quoted(l, field[i].text, 256);
        } else if (isfinite(field[i].number)) {
            append(l, "%.17g", field[i].number);
        } else {
            append(l, "null");
        }
    }
    append(l, "}");
}

static void write_json(const char *part, pm_journal_level level, int nfield,
                       const pm_journal_field *field, const char *message) {
    line l = {.used = 0};
    append_time(&l);
    append(&l, ",\"level\":\"%s\",\"part\":", level_names[level]);
    append_quoted(&l, part == NULL ? "" : part, 128);
    append(&l, ",\"message\":");
    append_quoted(&l, message, 2048);
    append_fields(&l, nfield, field);
    append(&l, "}\n");
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
