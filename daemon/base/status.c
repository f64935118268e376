// Descriptions of failures. They are the library's only global state, one per thread.
#include "base/status.h"

#include <stdarg.h>
#include <stdio.h>

static _Thread_local char last_error[1024];

pm_status pm_fail(pm_status code, const char *format, ...) {
    // The arguments may contain pm_error(), so the text is formatted before it replaces that one.
    char text[sizeof last_error];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    snprintf(last_error, sizeof last_error, "%s", text);
    // The text may quote a file.
    for (char *at = last_error; *at != '\0'; ++at) {
        *at = (unsigned char)*at < ' ' || *at == 0x7f ? ' ' : *at;
    }
    return code;
}

pm_status pm_allocated(const void *memory, const char *what, ...) {
    char text[256];
    va_list arguments;
    va_start(arguments, what);
    vsnprintf(text, sizeof text, what, arguments);
    va_end(arguments);
    return memory != NULL ? PM_OK : pm_fail(PM_ENOMEM, "out of memory for %s", text);
}

const char *pm_error(void) {
    return last_error;
}

void pm_forget_error(void) {
    last_error[0] = '\0';
}
