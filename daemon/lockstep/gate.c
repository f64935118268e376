// Reads the number in a file, without stdio, since the steps of a run allocate nothing.
#include "lockstep/gate.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define READ_INTERVAL 0.005 // s
#define MOST_TEXT 32        // bytes read; no number of steps takes as many

static pm_status read_file(const char *path, int64_t *steps) {
    char text[MOST_TEXT + 1];
    const int file = open(path, O_RDONLY | O_CLOEXEC);
    if (file < 0 && errno == ENOENT) {
        *steps = 0;
        return PM_OK;
    }
    const ssize_t size = file < 0 ? -1 : read(file, text, MOST_TEXT);
    const int error = errno;
    if (file >= 0) {
        close(file);
    }
    if (size < 0) {
        return pm_fail(PM_EFILE, "%s: cannot be read: %s", path, strerror(error));
    }
    text[size] = 0;
    char *end;
    errno = 0;
    const long long value = strtoll(text, &end, 10);
    if (end == text && text[strspn(text, " \t\n")] == 0) {
        *steps = 0; // empty: the number is yet to be written
        return PM_OK;
    }
    if (errno != 0 || end == text || end[strspn(end, " \t\n")] != 0 || value < 0) {
        return pm_fail(PM_EFILE, "%s: expected a number of steps, found \"%.*s\"", path,
                       (int)strcspn(text, "\n"), text);
    }
    *steps = value;
    return PM_OK;
}

pm_status pm_gate_init(pm_gate *gate, const char *path) {
    *gate = (pm_gate){.path = path, .steps = INT64_MAX};
    return path == NULL ? PM_OK : read_file(path, &gate->steps);
}

pm_status pm_gate_refresh(pm_gate *gate, double now) {
    if (now < gate->read_at) {
        return PM_OK;
    }
    gate->read_at = now + READ_INTERVAL;
    return read_file(gate->path, &gate->steps);
}
