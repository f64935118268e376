// Makes result folders, and runs programs in them.
#include "make.h"

#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/digest.h"
#include "base/progress.h"

// --- programs ---

static void become(char *const *argv, const char *folder, const char *log) {
    const int file = open(log, O_WRONLY | O_CREAT | O_TRUNC, 0666);
    if (file >= 0 && dup2(file, STDOUT_FILENO) >= 0 && dup2(file, STDERR_FILENO) >= 0 &&
        (folder == NULL || chdir(folder) == 0)) {
        execvp(argv[0], argv);
    }
    _exit(127);
}

static double seconds_of(const struct timeval *time) {
    return (double)time->tv_sec + 1e-6 * (double)time->tv_usec;
}

pm_status study_run(char *const *argv, const char *folder, const char *log, double *cpu) {
    const pid_t child = fork();
    if (child == 0) {
        become(argv, folder, log);
    }
    if (child < 0) {
        return pm_fail(PM_EFILE, "%s: %s", argv[0], strerror(errno));
    }
    int code = 0;
    struct rusage usage;
    pid_t ended;
    do {
        ended = wait4(child, &code, 0, &usage);
    } while (ended < 0 && errno == EINTR);
    if (ended < 0) {
        return pm_fail(PM_EFILE, "%s: %s", argv[0], strerror(errno));
    }
    if (code != 0) {
        return pm_fail(PM_EFILE, "%s failed, see %s", argv[0], log);
    }
    *cpu = seconds_of(&usage.ru_utime) + seconds_of(&usage.ru_stime);
    return PM_OK;
}

// --- folders ---

// Writes the times, after all other results.
static bool read_times(const char *path, study_made *made) {
    FILE *file = fopen(path, "r");
    const bool read = file != NULL && fscanf(file, "%lf %lf", &made->cpu, &made->elapsed) == 2;
    if (file != NULL) {
        fclose(file);
    }
    return read;
}

static pm_status write_text(const char *path, const char *text) {
    FILE *file = fopen(path, "w");
    const bool written = file != NULL && fputs(text, file) >= 0;
    if (file == NULL || fclose(file) != 0 || !written) {
        return pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    return PM_OK;
}

static pm_status fold_file(uint64_t *digest, const char *path) {
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: %s", path, strerror(errno));
    }
    int64_t word = 0;
    while (fread(&word, 1, sizeof word, file) > 0) {
        *digest = pm_digest_integer(*digest, word);
        word = 0;
    }
    fclose(file);
    return PM_OK;
}

pm_status study_place_look(study_place *place) {
    char pattern[4096];
    glob_t found;
    if ((size_t)snprintf(pattern, sizeof pattern, "%s/*.yaml", place->configs) >= sizeof pattern ||
        glob(pattern, 0, NULL, &found) != 0) {
        return pm_fail(PM_EFILE, "%s: no scenes there", place->configs);
    }
    place->digest = PM_DIGEST_INIT;
    pm_status status = fold_file(&place->digest, place->trainer);
    for (size_t i = 0; i < found.gl_pathc && status == PM_OK; ++i) {
        status = fold_file(&place->digest, found.gl_pathv[i]);
    }
    globfree(&found);
    return status;
}

// Runs the trainer in a folder of its own; `data` NULL: a simulation.
static pm_status make(const study_place *place, const char *text, const char *data, pm_arena *arena,
                      study_made *made) {
    const uint64_t digest =
        pm_digest_text(pm_digest_text(place->digest, text), data == NULL ? "" : data);
    const char *folder =
        pm_arena_printf(arena, "%s/%016llx", place->work, (unsigned long long)digest);
    char *config = pm_arena_printf(arena, "%s/config.yaml", folder);
    char *simulated = pm_arena_printf(arena, "%s/data.h5", folder);
    const char *log = pm_arena_printf(arena, "%s/log", folder);
    const char *times = pm_arena_printf(arena, "%s/seconds", folder);
    char *const trainer = pm_arena_strdup(arena, place->trainer);
    char *const input = pm_arena_strdup(arena, data == NULL ? "" : data);
    char *const output = pm_arena_strdup(arena, folder);
    if (folder == NULL || config == NULL || simulated == NULL || log == NULL || times == NULL ||
        trainer == NULL || input == NULL || output == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for paths");
    }
    *made = (study_made){.config = config, .folder = folder, .data = simulated};
    if (read_times(times, made)) {
        return PM_OK;
    }
    char *const simulate[] = {trainer, "truth", config, "-o", simulated, NULL};
    char *const train[] = {trainer, "fit", config, "--data", input, "-o", output, NULL};
    if (mkdir(folder, 0777) != 0 && errno != EEXIST) {
        return pm_fail(PM_EFILE, "%s: %s", folder, strerror(errno));
    }
    PM_TRY(write_text(config, text));
    const double started = pm_clock();
    PM_TRY(study_run(data == NULL ? simulate : train, NULL, log, &made->cpu));
    made->elapsed = pm_clock() - started;
    char line[64];
    snprintf(line, sizeof line, "%.3f %.3f\n", made->cpu, made->elapsed);
    return write_text(times, line);
}

pm_status study_simulate(const study_place *place, const study_file *truth, pm_arena *arena,
                         study_made *made) {
    const char *text = NULL;
    PM_TRY(study_text(truth, place->configs, arena, &text));
    return make(place, text, NULL, arena, made);
}

pm_status study_train(const study_place *place, const study_file *training, const char *data,
                      pm_arena *arena, study_made *made) {
    // The scene is found from the training file, which is written elsewhere.
    const char *scene = pm_arena_printf(arena, "scene: %s/", place->configs), *text = NULL;
    if (scene == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for paths");
    }
    PM_TRY(study_text(training, place->configs, arena, &text));
    PM_TRY(study_replace(&(study_passage){"scene: ../", scene}, training->path, arena, &text));
    return make(place, text, data, arena, made);
}
