// The lines that a program writes on standard error while it runs: as text for people, or as one
// JSON object for each line (RFC 8259), for journald and other collectors of logs:
//     {"time":"2026-01-31T12:00:00.123456Z","level":"warning","part":"upper","message":"...",
//      "fields":{"step":98}}
// `time` is UTC, `level` is notice, warning or error, `part` is the process that the line is about,
// and `fields` holds the numbers and names of the message.
#ifndef PM_BASE_JOURNAL_H
#define PM_BASE_JOURNAL_H

#include <stdbool.h>
#include <stddef.h>

#include "base/status.h"

typedef enum pm_journal_level {
    PM_JOURNAL_NOTICE,
    PM_JOURNAL_WARNING,
    PM_JOURNAL_ERROR
} pm_journal_level;

// A journal says in which form a process writes its lines, and under which names. A journal of
// zeros writes plain text. The texts are borrowed.
typedef struct pm_journal {
    bool json;
    const char *program; // such as "portmetd"; begins a line of text
    const char *part;    // the process that writes
} pm_journal;

// A field of a JSON line: a number, or a text if `text` is not NULL.
typedef struct pm_journal_field {
    const char *name;
    double number;
    const char *text;
} pm_journal_field;

// Reads the value of an option that chooses the form: "text", "json", or NULL for text. PM_EUSAGE.
pm_status pm_journal_read_form(const char *value, bool *json);

// Writes one line with the message that `format` makes. `field` [nfield] only appears in JSON.
__attribute__((format(printf, 5, 6))) void pm_journal_write(const pm_journal *log,
                                                            pm_journal_level level, int nfield,
                                                            const pm_journal_field *field,
                                                            const char *format, ...);

// Passes on a line of text of the process `part`, as pm_journal_write wrote it there: as text with
// the part in brackets in front, or as JSON. Empty lines are dropped.
void pm_journal_pass_on(const pm_journal *log, const char *part, const char *line);

// Writes `text` into `quoted` [size] as a JSON string with its quotation marks and a terminator,
// and returns its length in bytes without the terminator. Quotation marks, backslashes and control
// characters are escaped. A byte that is not part of a UTF-8 character, as in some file names,
// becomes U+FFFD. A text for which `size` is too small is cut after a whole character. `size` is at
// least 3.
size_t pm_json_quote(char *quoted, size_t size, const char *text);

#endif
