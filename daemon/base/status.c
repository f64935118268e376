// Error codes and their descriptions. The description is the library's only state, one per thread.
#include "base/status.h"

#include <stdarg.h>
#include <stdio.h>

static _Thread_local char last_error[1024];

pm_status pm_fail(pm_status code, const char *format, ...) {
    // Formatted aside first: the arguments may contain pm_error() itself.
    char text[sizeof last_error];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    snprintf(last_error, sizeof last_error, "%s", text);
    // Text of files may be quoted in it.
    for (char *at = last_error; *at != '\0'; ++at) {
        *at = (unsigned char)*at < ' ' || *at == 0x7f ? ' ' : *at;
    }
    return code;
}

const char *pm_error(void) {
    return last_error;
}
