// Reads what every section of a scene file contains: names, paths, and the places of values for
// later errors.
#include <string.h>

#include "scene/scene_reader.h"

#define MAX_NAME 48 // characters of a name

pm_status pm_scene_no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading a scene");
}

// --- names and paths ---

static bool is_letter(char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
}

pm_status pm_scene_check_name(pm_yaml at, const char *name) {
    bool good = is_letter(name[0]) && strlen(name) <= MAX_NAME;
    for (const char *c = name; *c != '\0'; ++c) {
        good = good && (is_letter(*c) || (*c >= '0' && *c <= '9') || *c == '_');
    }
    return good ? PM_OK
                : pm_yaml_fail(
                      at,
                      "expected a name of a letter, then letters, digits or '_', at most %d "
                      "in all, found \"%.64s\"",
                      MAX_NAME, name);
}

pm_status pm_scene_read_name(pm_scene_reader *r, pm_yaml at, const char **name) {
    PM_TRY(pm_yaml_text(at, r->arena, name));
    return pm_scene_check_name(at, *name);
}

pm_status pm_scene_read_path(pm_scene_reader *r, pm_yaml at, const char **path) {
    PM_TRY(pm_yaml_text(at, r->arena, path));
    const char *slash = strrchr(r->scene->path, '/');
    if (**path != '/' && slash != NULL) {
        const int folder = (int)(slash - r->scene->path) + 1;
        *path = pm_arena_printf(r->arena, "%.*s%s", folder, r->scene->path, *path);
    }
    return *path == NULL ? pm_scene_no_memory() : PM_OK;
}

pm_status pm_scene_read_at(pm_scene_reader *r, pm_yaml value, const char **at) {
    *at = pm_yaml_where(value, r->arena);
    return *at == NULL ? pm_scene_no_memory() : PM_OK;
}
