// Texts in JSON (RFC 8259). What else is written in JSON are numbers and fixed names.
#ifndef PM_BASE_JSON_H
#define PM_BASE_JSON_H

#include <stddef.h>

// Writes `text` into `quoted` [size] as a JSON string with its quotation marks and a terminator,
// and returns its length in bytes without the terminator. Quotation marks, backslashes and control
// characters are escaped. A byte that is not part of a UTF-8 character, as in some file names,
// becomes U+FFFD. A text for which `size` is too small is cut after a whole character. `size` is at
// least 3.
size_t pm_json_quote(char *quoted, size_t size, const char *text);

#endif
