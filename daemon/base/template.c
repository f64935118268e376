// Looks for a key at every sign of a line.
#include "base/template.h"

#include <stdbool.h>
#include <string.h>

void pm_template_write(FILE *file, const char *const *line, int count, int nvalue,
                       const pm_template_value *value) {
    for (int l = 0; l < count && line[l] != NULL; ++l) {
        bool exists = true;
        for (int k = 0; k < nvalue; ++k) {
            exists = exists && (value[k].text != NULL || value[k].write != NULL ||
                                strstr(line[l], value[k].key) == NULL);
        }
        for (const char *at = line[l]; exists && *at != '\0';) {
            int k = *at == '%' ? 0 : nvalue;
            while (k < nvalue && strncmp(at, value[k].key, strlen(value[k].key)) != 0) {
                ++k;
            }
            if (k == nvalue) {
                fputc(*at++, file);
                continue;
            }
            const char *after = at + strlen(value[k].key);
            if (value[k].text != NULL) {
                fputs(value[k].text, file);
            } else {
                value[k].write(file, value[k].context);
                after += at == line[l] && strcmp(after, "\n") == 0; // whole lines
            }
            at = after;
        }
    }
}
