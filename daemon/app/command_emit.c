// portmetd emit: writes the files with which systemd or procman starts the processes of a scene on
// several hosts.
//   systemd   for each host a folder with environment files, one for each instance of the units
//             portmet-node@ and portmet-coordinator@ that are installed with portmetd, and with a
//             target that starts them
//   procman   one file for the sheriff of libbot2's procman: a group of commands, one for each
//             process, with the deputy on which it runs
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app/command.h"
#include "app/connect.h"
#include "app/hosts.h"
#include "base/options.h"

typedef struct emission {
    const pm_run_options *options;
    pm_scene *scene;
    const char *path; // absolute, of the scene
    pm_hosts hosts;
    pm_arena arena;
} emission;

// --- what the processes get ---

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

// A message leaves its host only with a time to live, which is 0 unless the address sets it.
static pm_status check_address(const emission *e) {
    const char *url = e->options->url == NULL ? e->scene->url : e->options->url;
    const char *ttl = strstr(url, "ttl=");
    PM_TRY(pm_transport_check(url));
    if (e->hosts.count > 1 && (ttl == NULL || atoi(ttl + 4) < 1)) {
        return pm_fail(PM_EUSAGE,
                       "emit: the address %s keeps messages on one host, and the scene runs on %d: "
                       "expected --url with ttl=1",
                       url, e->hosts.count);
    }
    return PM_OK;
}

static void write_option(FILE *file, const char *name, const char *value) {
    if (value != NULL) {
        fprintf(file, "%s %s ", name, value);
    }
}

// Writes the options of process i, each followed by a blank. The number of processes stands for the
// coordinator.
static void write_options(const emission *e, FILE *file, int i) {
    const pm_run_options *o = e->options;
    write_option(file, "--weights", o->weights);
    write_option(file, "--url", o->url);
    if (o->session != 0) {
        fprintf(file, "--session %lld ", (long long)o->session);
    }
    if (i == e->scene->nprocess) {
        if (o->steps != 0) {
            fprintf(file, "--steps %lld ", (long long)o->steps);
        }
        write_option(file, "--record", o->record);
    }
}

// --- files ---

static pm_status open_file(FILE **file, const char *path) {
    *file = path == NULL ? NULL : fopen(path, "w");
    return *file != NULL ? PM_OK
                         : pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(errno));
}

static pm_status close_file(FILE *file, const char *path) {
    const bool bad = ferror(file) != 0;
    return (file == stdout ? fflush(file) : fclose(file)) == 0 && !bad
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: cannot be written: %s", path, strerror(errno));
}

// --- systemd ---

// Returns the unit of process i.
static const char *unit_of(emission *e, int i) {
    const pm_scene *scene = e->scene;
    return i < scene->nprocess
               ? pm_arena_printf(&e->arena, "node@%s-%s", scene->name, scene->process[i].name)
               : pm_arena_printf(&e->arena, "coordinator@%s", scene->name);
}

// The unit KIND@INSTANCE reads the file KIND-INSTANCE.env.
static pm_status write_environment(emission *e, const char *folder, const char *unit, int i) {
    const pm_scene *scene = e->scene;
    const char *instance = strchr(unit, '@') + 1;
    const char *path = pm_arena_printf(&e->arena, "%s/%.*s-%s.env", folder,
                                       (int)(instance - 1 - unit), unit, instance);
    FILE *file;
    PM_TRY(open_file(&file, path));
    fprintf(file, "PORTMET_SCENE=%s\n", e->path);
    if (i < scene->nprocess) {
        fprintf(file, "PORTMET_PROCESS=%s\n", scene->process[i].name);
    }
    fprintf(file, "PORTMET_OPTIONS=");
    write_options(e, file, i);
    fprintf(file, "\n");
    if (scene->tolerance > 0 || scene->nlive > 0) {
        fprintf(file, "# This scene cannot have checkpoints.\nPORTMET_CHECKPOINT=\n");
    }
    return close_file(file, path);
}

static pm_status write_host(emission *e, const char *host) {
    const pm_scene *scene = e->scene;
    const char *root = e->options->output;
    const char *settings = pm_arena_printf(&e->arena, "%s/%s/etc/portmet", root, host);
    const char *units = pm_arena_printf(&e->arena, "%s/%s/etc/systemd/system", root, host);
    const char *target = pm_arena_printf(&e->arena, "%s/%s/etc/systemd/system/portmet-%s.target",
                                         root, host, scene->name);
    FILE *file;
    if (settings == NULL || units == NULL || target == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for the units of %s", host);
    }
    PM_TRY(pm_options_folder(settings));
    PM_TRY(pm_options_folder(units));
    PM_TRY(open_file(&file, target));
    fprintf(file, "# Starts the processes of the scene %s that run on %s.\n[Unit]\n", scene->name,
            host);
    fprintf(file, "Description=portmet: the scene %s on this host\nDocumentation=man:portmetd(1)\n",
            scene->name);
    pm_status status = PM_OK;
    for (int i = 0; i <= scene->nprocess && status == PM_OK; ++i) {
        const char *unit = unit_of(e, i);
        if (unit == NULL) {
            status = pm_fail(PM_ENOMEM, "out of memory for the units of %s", host);
        } else if (strcmp(e->hosts.of[i], host) == 0) {
            fprintf(file, "Wants=portmet-%s.service\n", unit);
            status = write_environment(e, settings, unit, i);
        }
    }
    fprintf(file, "\n[Install]\nWantedBy=multi-user.target\n");
    const pm_status closed = close_file(file, target);
    return status == PM_OK ? closed : status;
}

static pm_status emit_systemd(emission *e) {
    if (e->options->output == NULL) {
        return pm_fail(PM_EUSAGE, "emit systemd: expected -o DIR");
    }
    for (int i = 0; i < e->hosts.count; ++i) {
        PM_TRY(write_host(e, e->hosts.name[i]));
        printf("wrote %s/%s/etc; on the host %s: copy it to /etc, systemctl daemon-reload, "
               "systemctl start portmet-%s.target\n",
               e->options->output, e->hosts.name[i], e->hosts.name[i], e->scene->name);
    }
    return PM_OK;
}

// --- procman ---

static void write_command(const emission *e, FILE *file, int i) {
    const pm_scene *scene = e->scene;
    const bool node = i < scene->nprocess;
    const char *name = node ? scene->process[i].name : "coordinator";
    fprintf(file, "    cmd \"%s\" {\n        exec = \"portmetd %s ", name,
            node ? "node" : "coordinator");
    write_options(e, file, i);
    fprintf(file, "%s%s%s\";\n        host = \"%s\";\n    }\n", e->path, node ? " " : "",
            node ? name : "", e->hosts.of[i]);
}

static pm_status emit_procman(emission *e) {
    const char *path = e->options->output == NULL ? "standard output" : e->options->output;
    FILE *file = stdout;
    PM_TRY(e->options->output == NULL ? PM_OK : open_file(&file, path));
    fprintf(file, "# The processes of the scene %s, for bot-procman-sheriff.\n", e->scene->name);
    fprintf(file, "group \"%s\" {\n", e->scene->name);
    for (int i = 0; i <= e->scene->nprocess; ++i) {
        write_command(e, file, i);
    }
    fprintf(file, "}\n\nscript \"start %s\" {\n    start group \"%s\";\n}\n", e->scene->name,
            e->scene->name);
    return close_file(file, path);
}

// --- the command ---

static const struct {
    const char *name;
    pm_status (*emit)(emission *e);
} kinds[] = {{"systemd", emit_systemd}, {"procman", emit_procman}};

static pm_status emit(emission *e, const char *kind) {
    const pm_run_options *o = e->options;
    for (size_t i = 0; i < sizeof kinds / sizeof kinds[0]; ++i) {
        if (strcmp(kinds[i].name, kind) == 0) {
            PM_TRY(pm_connect_check(e->scene));
            PM_TRY(pm_hosts_read(&e->hosts, e->scene, o->hosts, &e->arena));
            PM_TRY(check_address(e));
            PM_TRY(check_text(e->path));
            PM_TRY(check_text(o->url));
            PM_TRY(check_path("--weights", o->weights));
            PM_TRY(check_path("--record", o->record));
            return kinds[i].emit(e);
        }
    }
    return pm_fail(PM_EUSAGE, "emit: expected systemd or procman, found \"%s\"", kind);
}

// Writes what the command line asks for: the first positional argument is the kind of file, the
// second one the scene.
static pm_status execute(const pm_run_options *options) {
    emission e = {.options = options};
    char path[PATH_MAX];
    pm_status status;
    PM_TRY_DONE(pm_scene_load(&e.scene, options->name));
    e.path = realpath(options->name, path);
    PM_TRY_DONE(e.path == NULL ? pm_fail(PM_EFILE, "%s: %s", options->name, strerror(errno))
                               : PM_OK);
    PM_TRY_DONE(emit(&e, options->scene));
done:
    pm_arena_free(&e.arena);
    pm_scene_free(e.scene);
    return status;
}

static const pm_command command = {
    .arguments = "systemd|procman SCENE",
    .help =
        "Writes the files with which systemd or procman starts the processes of the scene on\n"
        "several hosts. With systemd, -o DIR receives a folder for each host with what belongs\n"
        "into its /etc: the settings of the units portmet-node@ and portmet-coordinator@, and "
        "a\n"
        "target that starts them. With procman, a file for the sheriff names the command and "
        "the\n"
        "deputy of each process. All hosts need portmetd, and the scene with its files under "
        "the\n"
        "path that it has here.",
    .accepts = PM_OPTION_HOSTS | PM_OPTION_FILES | PM_OPTION_STEPS | PM_OPTION_RECORD |
               PM_OPTION_WEIGHTS | PM_OPTION_URL | PM_OPTION_SESSION,
    .execute = execute,
};

pm_status pm_command_emit(int argc, char **argv, const volatile sig_atomic_t *stop) {
    return pm_command_execute(&command, argc, argv, stop);
}
