// portmetd emit: writes the files with which systemd or procman starts the processes of a scene on
// several hosts.
//   systemd   for each host a folder with environment files, one for each instance of the units
//             portmet-node@ and portmetd@ that are installed with portmetd, and with a target that
//             starts them: a service with its nodes, whose runs clients start
//   procman   one file for the sheriff of libbot2's procman: a group of commands, one for each
//             process, with the deputy on which it runs
// Their texts are the files in app/emit (base/template.h). Lines that begin with %EACH% are
// repeated for each process.
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/command.h"
#include "app/connect.h"
#include "base/files.h"
#include "base/options.h"
#include "base/template.h"

#define LETTERS "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
#define DIGITS "0123456789"
#define EACH "%EACH%"

// The texts, which the build embeds as arrays of lines that end with NULL.
extern const char *const pm_emit_environment[];
extern const char *const pm_emit_target[];
extern const char *const pm_emit_procman[];

#define STATE "/var/lib/portmet" // where the units may write

typedef struct emission {
    const pm_run_options *options;
    bool systemd; // else procman
    pm_scene *scene;
    const char *path;    // absolute, of the scene
    const char **host;   // [nprocess + 1] host of each process; the last is the coordinator's
    int nhost;           // different hosts
    const char **called; // [nhost]
    pm_arena arena;
} emission;

// --- what the command line asks for ---

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

// Reads names of hosts and assignments PROCESS=HOST, separated by commas. The hosts that are not
// part of an assignment share the processes in the order of the scene, in equal numbers, and the
// first of them has the coordinator, which assignments call "coordinator".
static pm_status read_hosts(emission *e, const char *list) {
    const pm_scene *scene = e->scene;
    const int nprocess = scene->network.nprocess;
    char *text = pm_arena_strdup(&e->arena, list == NULL ? "localhost" : list);
    PM_TRY(pm_arena_status(&e->arena, "%d processes", nprocess));
    const size_t most = strlen(text) + (size_t)nprocess + 2;
    e->host = pm_arena_array(&e->arena, (size_t)nprocess + 1, sizeof *e->host);
    e->called = pm_arena_array(&e->arena, most, sizeof *e->called);
    PM_TRY(pm_arena_status(&e->arena, "%d processes", nprocess));
    int count = 0; // hosts that share processes
    for (char *entry = text, *next; entry != NULL; entry = next) {
        next = strchr(entry, ',');
        if (next != NULL) {
            *next++ = '\0';
        }
        char *host = strchr(entry, '=');
        if (host == NULL) {
            PM_TRY(check_host(entry));
            e->called[count++] = entry;
            continue;
        }
        *host++ = '\0';
        const int found = pm_scene_find_process(scene, entry);
        if (found < 0 && strcmp(entry, "coordinator") != 0) {
            return pm_fail(PM_EUSAGE, "--hosts: scene %s has no process called \"%s\"", scene->name,
                           entry);
        }
        e->host[found < 0 ? nprocess : found] = host;
        PM_TRY(check_host(host));
    }
    for (int i = 0; i <= nprocess; ++i) {
        if (e->host[i] == NULL && count == 0) {
            return pm_fail(PM_EUSAGE, "--hosts: %s has no host",
                           i < nprocess ? scene->network.process[i].name : "the coordinator");
        }
        if (e->host[i] == NULL) {
            e->host[i] = e->called[i < nprocess ? (int)((long long)i * count / nprocess) : 0];
        }
    }
    for (int i = 0; i <= nprocess; ++i) { // each host that has a process is called once
        int k = 0;
        while (k < e->nhost && strcmp(e->called[k], e->host[i]) != 0) {
            ++k;
        }
        e->called[k] = e->host[i];
        e->nhost += k == e->nhost;
    }
    return PM_OK;
}

// systemd and procman divide text at blanks and replace variables.
static pm_status check_text(const char *text) {
    const char *bad = text == NULL ? NULL : strpbrk(text, " \t\n\"'\\$;#");
    return bad == NULL
               ? PM_OK
               : pm_fail(PM_EUSAGE, "emit: %s: '%c' cannot be written for systemd and procman",
                         text, *bad);
}

// The processes start in folders of their own.
static pm_status check_path(const char *option, const char *path) {
    return path == NULL || path[0] == '/'
               ? check_text(path)
               : pm_fail(PM_EUSAGE, "emit: %s %s: expected an absolute path", option, path);
}

// Fails if the units cannot read a file, since systemd/hardening.conf hides its folder from them,
// or if it is `written` and they cannot write it.
static pm_status check_unit_path(const char *path, bool written) {
    static const char own[] = "/var/lib/portmet/";
    static const char *const hidden[] = {"/home/", "/root/", "/run/user/", "/tmp/", "/var/tmp/"};
    char whole[PATH_MAX];
    if (path == NULL) {
        return PM_OK;
    }
    const char *real = realpath(path, whole); // links may lead into a hidden folder
    bool sees = true;
    for (size_t i = 0; i < sizeof hidden / sizeof *hidden; ++i) {
        sees = sees && strncmp(path, hidden[i], strlen(hidden[i])) != 0 &&
               (real == NULL || strncmp(real, hidden[i], strlen(hidden[i])) != 0);
    }
    if (!sees ||
        (written && (strncmp(path, own, strlen(own)) != 0 || strstr(path, "/../") != NULL))) {
        return pm_fail(PM_EUSAGE, "emit: %s: the units %s", path,
                       written ? "write only below /var/lib/portmet"
                               : "do not see /home, /root, /run/user, /tmp and /var/tmp");
    }
    return PM_OK;
}

// --- texts ---

// Returns "NAME VALUE " in the arena, or "" if the option was not given.
static const char *option_text(emission *e, const char *name, const char *value) {
    return value == NULL ? "" : pm_arena_printf(&e->arena, "%s %s ", name, value);
}

static const char *number_text(emission *e, const char *name, int64_t value) {
    return value == 0 ? "" : pm_arena_printf(&e->arena, "%s %lld ", name, (long long)value);
}

// Returns the part of a name that tells process i from the others: the unit and the environment
// file are called KIND@<this>. Past the last process it is the scene's name, the coordinator's.
static const char *instance_of(emission *e, int i) {
    const pm_scene *scene = e->scene;
    return i < scene->network.nprocess
               ? pm_arena_printf(&e->arena, "%s-%s", scene->name, scene->network.process[i].name)
               : scene->name;
}

// Writes `count` lines with the values of process i, or all lines up to NULL. The number of
// processes stands for the coordinator.
static void write_lines(emission *e, FILE *file, const char *const *line, int count, int i,
                        const char *host) {
    const pm_run_options *o = e->options;
    const pm_scene *scene = e->scene;
    const bool node = i < scene->network.nprocess;
    const char *name = node ? scene->network.process[i].name : "coordinator";
    const char *instance = instance_of(e, i);
    const bool keeps =
        e->systemd && !pm_physics_is_adaptive(&scene->physics) && scene->network.nlive == 0;
    const char *options = pm_arena_printf(
        &e->arena, "%s%s%s%s%s%s%s", e->systemd && !node ? "--elsewhere " : "",
        keeps ? pm_arena_printf(&e->arena, "--checkpoint " STATE "/%s ", instance) : "",
        option_text(e, "--weights", o->weights), option_text(e, "--url", o->url),
        number_text(e, "--session", o->session), node ? "" : number_text(e, "--steps", o->steps),
        node ? "" : option_text(e, "--record", o->record));
    const pm_template_value value[] = {
        {EACH, .text = ""},
        {"%SCENE%", .text = scene->name},
        {"%PATH%", .text = e->path},
        {"%HOST%", .text = host},
        {"%KIND%", .text = node ? "node" : "coordinator"},
        {"%UNIT%", .text = node ? "portmet-node" : "portmetd"},
        {"%NAME%", .text = name},
        {"%PROCESS%", .text = node ? name : NULL},
        {"%ARGUMENT%", .text = node ? pm_arena_printf(&e->arena, " %s", name) : ""},
        {"%OPTIONS%", .text = options},
        {"%INSTANCE%", .text = instance},
    };
    if (!e->arena.failed) {
        pm_template_write(file, line, count, (int)(sizeof value / sizeof value[0]), value);
    }
}

// Writes a text to the file `path`; NULL: to standard output. The text is about process i alone, or
// if i is -1, about the processes of `host`; NULL: of all hosts. A file that begins in another way
// than such a text is kept.
static pm_status write_text(emission *e, const char *path, const char *const *line, int i,
                            const char *host) {
    const int nprocess = e->scene->network.nprocess;
    const char *begin = pm_arena_printf(&e->arena, "%.*s", (int)strcspn(*line, "%"), *line);
    PM_TRY(pm_arena_status(&e->arena, "the texts of scene %s", e->scene->name));
    FILE *file = stdout;
    PM_TRY(path == NULL ? PM_OK : pm_files_create(&file, path, begin));
    if (i >= 0) {
        write_lines(e, file, line, INT_MAX, i, host);
    }
    for (int n; i < 0 && *line != NULL; line += n) {
        n = 0;
        while (line[n] != NULL && strncmp(line[n], EACH, strlen(EACH)) == 0) {
            ++n;
        }
        for (int k = 0; n > 0 && k <= nprocess; ++k) {
            if (host == NULL || strcmp(e->host[k], host) == 0) {
                write_lines(e, file, line, n, k, e->host[k]);
            }
        }
        if (n == 0) {
            n = 1;
            write_lines(e, file, line, n, nprocess, host);
        }
    }
    const bool bad = ferror(file) != 0;
    if ((path == NULL ? fflush(file) : fclose(file)) != 0 || bad) {
        return pm_fail(PM_EFILE, "%s: cannot be written: %s",
                       path == NULL ? "standard output" : path, strerror(errno));
    }
    return pm_arena_status(&e->arena, "the texts of scene %s", e->scene->name);
}

static pm_status emit_systemd(emission *e) {
    const char *root = e->options->output, *scene = e->scene->name;
    if (root == NULL) {
        return pm_fail(PM_EUSAGE, "emit systemd: expected -o DIR");
    }
    if (e->options->steps > 0) {
        return pm_fail(PM_EUSAGE, "emit systemd: --steps is for procman: clients start the runs of "
                                  "a service");
    }
    // The units must see all files that the scene and the options name.
    const pm_physics *physics = &e->scene->physics;
    const char *weights = e->options->weights;
    PM_TRY(check_unit_path(e->path, false));
    PM_TRY(check_unit_path(weights, false));
    PM_TRY(check_unit_path(e->options->record, true));
    PM_TRY(check_unit_path(e->scene->network.key_file, false));
    PM_TRY(check_unit_path(e->scene->run.reference, false));
    for (int i = 0; i < physics->nsubsystem && weights == NULL; ++i) {
        PM_TRY(check_unit_path(physics->subsystem[i].weights, false));
    }
    for (int i = 0; i < physics->nport && weights == NULL; ++i) {
        PM_TRY(check_unit_path(physics->port[i].weights, false));
    }
    for (int k = 0; k < e->nhost; ++k) {
        const char *host = e->called[k];
        const char *settings = pm_arena_printf(&e->arena, "%s/%s/etc/portmet", root, host);
        const char *units = pm_arena_printf(&e->arena, "%s/%s/etc/systemd/system", root, host);
        const char *target = pm_arena_printf(&e->arena, "%s/portmet-%s.target", units, scene);
        PM_TRY(pm_arena_status(&e->arena, "the units of %s", host));
        PM_TRY(pm_options_folder(settings));
        PM_TRY(pm_options_folder(units));
        PM_TRY(write_text(e, target, pm_emit_target, -1, host));
        for (int i = 0; i <= e->scene->network.nprocess; ++i) {
            if (strcmp(e->host[i], host) == 0) {
                // portmet-node@INSTANCE reads node-INSTANCE.env, and portmetd@SCENE reads
                // SCENE.env.
                const char *path = pm_arena_printf(&e->arena, "%s/%s%s.env", settings,
                                                   i < e->scene->network.nprocess ? "node-" : "",
                                                   instance_of(e, i));
                PM_TRY(write_text(e, path, pm_emit_environment, i, host));
            }
        }
        printf("wrote %s/%s/etc; on the host %s: copy it to /etc, systemctl daemon-reload, "
               "systemctl start portmet-%s.target\n",
               root, host, host, scene);
    }
    return PM_OK;
}

// --- the command ---

// Writes what the command line asks for: the first positional argument is the kind of file, the
// second one the scene.
static pm_status execute(const pm_run_options *options) {
    const bool systemd = strcmp(options->scene, "systemd") == 0;
    emission e = {.options = options, .systemd = systemd};
    char path[PATH_MAX];
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&e.scene, options->name));
    e.path = realpath(options->name, path);
    PM_TRY_DONE(e.path == NULL ? pm_fail(PM_EFILE, "%s: %s", options->name, strerror(errno))
                               : PM_OK);
    if (!systemd && strcmp(options->scene, "procman") != 0) {
        PM_TRY_DONE(
            pm_fail(PM_EUSAGE, "emit: expected systemd or procman, found \"%s\"", options->scene));
    }
    PM_TRY_DONE(pm_connect_check(e.scene));
    PM_TRY_DONE(read_hosts(&e, options->hosts));
    const char *url = pm_connect_url(e.scene, options->url);
    const char *ttl = strstr(url, "ttl=");
    PM_TRY_DONE(pm_transport_check(url));
    // A message leaves its host only with a time to live, which is 0 unless the address sets it.
    if (e.nhost > 1 && (ttl == NULL || atoi(ttl + 4) < 1)) {
        PM_TRY_DONE(
            pm_fail(PM_EUSAGE,
                    "emit: the address %s keeps messages on one host, and the scene runs on %d: "
                    "expected --url with ttl=1",
                    url, e.nhost));
    }
    PM_TRY_DONE(check_text(e.path));
    PM_TRY_DONE(check_text(options->url));
    PM_TRY_DONE(check_path("--weights", options->weights));
    PM_TRY_DONE(check_path("--record", options->record));
    status =
        systemd ? emit_systemd(&e) : write_text(&e, options->output, pm_emit_procman, -1, NULL);
done:
    pm_arena_free(&e.arena);
    pm_scene_free(e.scene);
    return status;
}

const pm_command pm_command_emit = {
    .name = "emit",
    .summary = "write files with which systemd or procman starts a scene",
    .arguments = "systemd|procman SCENE",
    .help =
        "Writes the files with which systemd or procman starts the processes of the scene on\n"
        "several hosts. With systemd, -o DIR receives a folder for each host with what belongs\n"
        "into its /etc: the settings of the units portmet-node@ and portmetd@, which serve the\n"
        "scene, and a target that starts them; --record is then the folder in which clients may\n"
        "record. With procman, a file for the sheriff names the command and the deputy of each\n"
        "process of a run. All hosts need portmetd, and the scene with its files under the path\n"
        "that it has here.",
    .examples =
        "portmetd emit systemd scene.yaml --hosts a,b -o units\n"
        "portmetd emit procman scene.yaml --hosts upper=a,lower=b,coordinator=a -o scene.pmd",
    .accepts = "hosts files steps record weights url session",
    .execute = execute,
};
