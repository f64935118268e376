// Parts of file names.
#include "base/path.h"

#include <ctype.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

size_t pm_path_stem(const char *path) {
    const char *slash = strrchr(path, '/'), *name = slash == NULL ? path : slash + 1;
    const char *dot = strrchr(name, '.');
    return dot == NULL || dot == name ? strlen(path) : (size_t)(dot - path);
}

const char *pm_path_seen_from(const char *from, const char *path, char *out) {
    char folder[PATH_MAX], own[PATH_MAX], other[PATH_MAX];
    const char *slash = strrchr(from, '/');
    size_t shared = 0, used = 0;
    snprintf(folder, sizeof folder, "%.*s", slash == NULL ? 1 : (int)(slash - from) + 1,
             slash == NULL ? "." : from);
    if (realpath(folder, own) == NULL || realpath(path, other) == NULL) {
        return path;
    }
    for (size_t i = 1; own[i - 1] != '\0' && (own[i] == other[i] || own[i] == '\0'); ++i) {
        shared = other[i] == '/' && (own[i] == '/' || own[i] == '\0') ? i : shared;
    }
    for (const char *c = own + shared; shared > 0 && *c != '\0' && used + 3 < PATH_MAX; ++c) {
        used += *c == '/' ? (size_t)sprintf(out + used, "../") : 0;
    }
    snprintf(out + used, PATH_MAX - used, "%s", other + (shared > 0 ? shared + 1 : 0));
    return out;
}

void pm_path_folder_name(const char *path, const char *prefix, char *out, size_t size) {
    char folder[PATH_MAX], own[PATH_MAX];
    const char *slash = strrchr(path, '/');
    snprintf(folder, sizeof folder, "%.*s", slash == NULL ? 1 : (int)(slash - path) + 1,
             slash == NULL ? "." : path);
    char *name = realpath(folder, own) == NULL ? NULL : strrchr(own, '/') + 1;
    bool named = false;
    for (char *c = name; c != NULL && *c != '\0'; ++c) {
        *c = isalnum((unsigned char)*c) ? *c : '_';
        named = named || *c != '_';
    }
    if (!named) {
        snprintf(out, size, "%s", prefix);
        return;
    }
    const size_t length = strlen(name);
    name += length < size ? 0 : length - size + 1;
    if (isalpha((unsigned char)*name)) {
        snprintf(out, size, "%s", name);
    } else { // as much of its end as there is room for
        const size_t most = size - strlen(prefix) - 2, left = strlen(name);
        snprintf(out, size, "%s_%s", prefix, name + (left < most ? 0 : left - most));
    }
}
