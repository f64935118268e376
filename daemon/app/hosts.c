// Reads a list of hosts and assignments.
#include "app/hosts.h"

#include <string.h>

#define LETTERS "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
#define DIGITS "0123456789"

// Host names are also names of folders.
static pm_status check_host(const char *name) {
    const size_t length = strspn(name, LETTERS DIGITS "-._");
    if (length == 0 || name[length] != '\0' || strchr("-._", name[0]) != NULL) {
        return pm_fail(PM_EUSAGE,
                       "--hosts: \"%s\" is not the name of a host: expected letters, digits, '-', "
                       "'.' and '_', the first a letter or a digit",
                       name);
    }
    return PM_OK;
}

// Returns the position of a process, nprocess for the coordinator, or -1.
static int find_process(const pm_scene *scene, const char *name) {
    for (int i = 0; i < scene->nprocess; ++i) {
        if (strcmp(scene->process[i].name, name) == 0) {
            return i;
        }
    }
    return strcmp(name, "coordinator") == 0 ? scene->nprocess : -1;
}

static pm_status assign(pm_hosts *hosts, const pm_scene *scene, char *entry, char *equals) {
    *equals = '\0';
    const int process = find_process(scene, entry);
    if (process < 0) {
        return pm_fail(PM_EUSAGE, "--hosts: scene %s has no process called \"%s\"", scene->name,
                       entry);
    }
    hosts->of[process] = equals + 1;
    return check_host(equals + 1);
}

// Divides the processes that have no host among the first `count` names.
static pm_status share(pm_hosts *hosts, const pm_scene *scene, int count) {
    const int nprocess = scene->nprocess;
    for (int i = 0; i <= nprocess; ++i) {
        if (hosts->of[i] != NULL) {
            continue;
        }
        if (count == 0) {
            return pm_fail(PM_EUSAGE, "--hosts: %s has no host",
                           i < nprocess ? scene->process[i].name : "the coordinator");
        }
        const int k = i < nprocess ? (int)((long long)i * count / nprocess) : 0;
        hosts->of[i] = hosts->name[k];
    }
    return PM_OK;
}

// Lists each host that has a process once.
static void list_hosts(pm_hosts *hosts, int nprocess) {
    hosts->count = 0;
    for (int i = 0; i <= nprocess; ++i) {
        int k = 0;
        while (k < hosts->count && strcmp(hosts->name[k], hosts->of[i]) != 0) {
            ++k;
        }
        hosts->name[k] = hosts->of[i];
        hosts->count += k == hosts->count;
    }
}

pm_status pm_hosts_read(pm_hosts *hosts, const pm_scene *scene, const char *list, pm_arena *arena) {
    char *text = pm_arena_strdup(arena, list == NULL ? "localhost" : list);
    const size_t most = text == NULL ? 0 : strlen(text) + (size_t)scene->nprocess + 2;
    hosts->of = pm_arena_array(arena, (size_t)scene->nprocess + 1, sizeof *hosts->of);
    hosts->name = pm_arena_array(arena, most, sizeof *hosts->name);
    if (text == NULL || hosts->of == NULL || hosts->name == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for %d processes", scene->nprocess);
    }
    for (int i = 0; i <= scene->nprocess; ++i) {
        hosts->of[i] = NULL;
    }
    int count = 0;
    for (char *entry = text, *next; entry != NULL; entry = next) {
        next = strchr(entry, ',');
        if (next != NULL) {
            *next++ = '\0';
        }
        char *equals = strchr(entry, '=');
        PM_TRY(equals == NULL ? check_host(entry) : assign(hosts, scene, entry, equals));
        if (equals == NULL) {
            hosts->name[count++] = entry;
        }
    }
    PM_TRY(share(hosts, scene, count));
    list_hosts(hosts, scene->nprocess);
    return PM_OK;
}
