// Fills in a text that the build embeds (pm_embed in daemon/CMakeLists.txt): %KEY% stands for a
// value.
#ifndef PM_BASE_TEMPLATE_H
#define PM_BASE_TEMPLATE_H

#include <stdio.h>

// A value: `text`, or what `write` writes when it gets `context`. If both are NULL, there is no
// such value, and lines with its key are left out.
typedef struct pm_template_value {
    const char *key; // such as "%NAME%"
    const char *text;
    void (*write)(FILE *file, const void *context);
    const void *context;
} pm_template_value;

// Writes `count` lines, or all lines up to NULL, with the values value [nvalue] in the place of
// their keys. Where a line is nothing but a key of a value with `write`, the value is whole lines.
void pm_template_write(FILE *file, const char *const *line, int count, int nvalue,
                       const pm_template_value *value);

#endif
