// Copies a scene with ports of the law exchange, for the forms soft and free.
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "propose/propose.h"

pm_status pm_propose_scene(const char *from, const char *path) {
    FILE *in = fopen(from, "r"), *out = in == NULL ? NULL : fopen(path, "w");
    if (out == NULL) {
        const char *which = in == NULL ? from : path;
        const char *why = strerror(errno);
        if (in != NULL) {
            fclose(in);
        }
        return pm_fail(PM_EFILE, "%s: %s", which, why);
    }
    char *line = NULL;
    size_t size = 0;
    fprintf(out, "# %s with ports of the law exchange, for models in the forms soft and free.\n",
            from);
    while (getline(&line, &size, in) > 0) {
        const char *law = strstr(line, "law: bracket");
        if (law != NULL) {
            fprintf(out, "%.*slaw: exchange%s", (int)(law - line), line,
                    law + strlen("law: bracket"));
        } else {
            fputs(line, out);
        }
    }
    free(line);
    const bool failed = ferror(in) != 0 || ferror(out) != 0;
    fclose(in);
    return fclose(out) == 0 && !failed ? PM_OK : pm_fail(PM_EFILE, "%s: cannot be written", path);
}
