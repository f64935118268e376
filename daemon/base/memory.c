// Reads the limits from the kernel's text files.
#include "base/memory.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>

// Returns the number in the first line of a file that begins with `word`, which may be empty, or
// -1.
static int64_t read_number(const char *path, const char *word) {
    FILE *file = fopen(path, "re");
    char line[256];
    int64_t number = -1;
    while (file != NULL && number < 0 && fgets(line, sizeof line, file) != NULL) {
        if (strncmp(line, word, strlen(word)) != 0 ||
            sscanf(line + strlen(word), "%" SCNd64, &number) != 1) {
            number = -1;
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return number;
}

static int64_t least(int64_t a, int64_t b) {
    return a < b ? a : b;
}

int64_t pm_memory_available(void) {
    int64_t available = INT64_MAX;
    const int64_t free = read_number("/proc/meminfo", "MemAvailable:"); // KiB
    if (free >= 0) {
        available = free * 1024;
    }
    // "max", which is no number, means that there is no limit.
    const int64_t most = read_number("/sys/fs/cgroup/memory.max", "");
    const int64_t used = read_number("/sys/fs/cgroup/memory.current", "");
    if (most >= 0 && used >= 0) {
        available = least(available, most > used ? most - used : 0);
    }
    struct rlimit limit;
    if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur <= INT64_MAX) {
        available = least(available, (int64_t)limit.rlim_cur);
    }
    return available;
}
