// Calls the reader of tables, and decides which files need it.
#include "command/tables.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/child.h"
#include "store/hdf5_io.h"

// The reader's folder, from the folder of the running program: in the tree of the build, and where
// `cmake --install` puts it.
static const char *const places[] = {"../daemon/python/portmet/tables",
                                     PM_PYTHON_FROM_BIN "/tables"};

// Writes the reader's path to `path` [size].
static pm_status find_reader(char *path, size_t size) {
    char program[PATH_MAX];
    const ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
    program[length > 0 ? length : 0] = '\0';
    char *slash = strrchr(program, '/');
    for (size_t i = 0; i < sizeof places / sizeof *places && slash != NULL; ++i) {
        snprintf(path, size, "%.*s/%s", (int)(slash - program), program, places[i]);
        if (access(path, R_OK) == 0) {
            return PM_OK;
        }
    }
    return pm_fail(PM_EFILE,
                   "tables: the Python package of portmet is not where it was built or "
                   "installed: %s",
                   slash == NULL ? "/proc is needed" : path);
}

pm_status pm_tables_import(int count, const char *const *table, const char *output,
                           const pm_tables_how *how, bool quiet) {
    static const char missing[] =
        "tables are read by Python: apt-get install python3 python3-h5py python3-scipy";
    const pm_tables_how *h = how;
    const char *const option[][2] = {{"--time", h->time},
                                     {"--dt", h->dt},
                                     {"--missing", h->missing},
                                     {"--runs", h->runs},
                                     {"--types", h->types}};
    const int noption = sizeof option / sizeof *option;
    char reader[PATH_MAX + 64];
    PM_TRY(find_reader(reader, sizeof reader));
    char **argv = calloc((size_t)count + 2 * (size_t)noption + 8, sizeof *argv);
    char *joined[5] = {0};
    int argc = 0, code = 0, error = ENOMEM;
    if (argv != NULL) {
        argv[argc++] = "python3";
        argv[argc++] = "-B"; // leaves no compiled files in folders of the system
        argv[argc++] = reader;
        argv[argc++] = (char *)output;
        error = 0;
        for (int i = 0; i < noption && error == 0; ++i) {
            if (option[i][1] != NULL) { // joined by '=', as a value may begin with '-'
                error = asprintf(&joined[i], "%s=%s", option[i][0], option[i][1]) < 0 ? ENOMEM : 0;
                argv[argc++] = joined[i];
            }
        }
        if (h->temporary) {
            argv[argc++] = "--temporary";
        }
        argv[argc++] = "--";
        memcpy(argv + argc, table, (size_t)count * sizeof *argv);
    }
    if (error == 0) {
        fflush(stdout);
        error = pm_child_run(argv, quiet, &code);
    }
    for (int i = 0; i < noption; ++i) {
        free(joined[i]);
    }
    free(argv);
    switch (error != 0 ? -2 : code) {
    case 0:
        return PM_OK;
    case PM_EFILE:
    case PM_EDATA:
    case PM_ENOMEM:
    case PM_EINTERRUPTED:
        return pm_fail((pm_status)code, "%s", "");
    case -2:
        return error == ENOMEM ? pm_fail(PM_ENOMEM, "out of memory for tables")
               : error == ENOENT
                   ? pm_fail(PM_EFILE, "%s", missing)
                   : pm_fail(PM_EFILE, "tables: python3 cannot be started: %s", strerror(error));
    default:
        return pm_fail(PM_EFILE, "%s: the reader of tables ended with the code %d", table[0], code);
    }
}

// --- datasets of commands ---

typedef struct probe {
    const char *path;
    bool dataset;
} probe;

static void look(probe *p) {
    pm_hdf5 *file = NULL;
    if (pm_hdf5_open(&file, p->path, PM_HDF5_ANY, PM_EDATA) == PM_OK) {
        p->dataset = pm_hdf5_has(file, "/z") || pm_hdf5_is_text(file, "/", "state_layout");
        pm_hdf5_close(file);
    }
}

static void try_look(const void *context) {
    probe p = *(const probe *)context;
    look(&p);
}

// Returns true for a file that no reader of tables need see: a dataset, or a file that the reader
// of datasets will refuse by its name.
static bool is_dataset(const char *path) {
    static const char signature[] = {'\x89', 'H', 'D', 'F'};
    char head[4] = {0};
    struct stat found;
    FILE *file = stat(path, &found) == 0 && S_ISREG(found.st_mode) ? fopen(path, "rb") : NULL;
    if (file == NULL) {
        return stat(path, &found) != 0 || !S_ISDIR(found.st_mode);
    }
    const size_t count = fread(head, 1, sizeof head, file);
    fclose(file);
    if (count < sizeof head || memcmp(head, signature, sizeof head) != 0) {
        return false;
    }
    probe p = {.path = path};
    if (pm_hdf5_try(path, try_look, &p) != PM_OK) {
        return true; // damaged
    }
    look(&p);
    return p.dataset;
}

pm_status pm_data_open(pm_data_file *data, const pm_words *given, const char *keep, bool quiet) {
    *data = (pm_data_file){.path = given->count == 0 ? NULL : given->word[0]};
    if (given->count == 0 || (given->count == 1 && is_dataset(given->word[0]))) {
        return PM_OK;
    }
    if (keep == NULL) {
        const char *folder = getenv("TMPDIR");
        snprintf(data->own, sizeof data->own, "%s/portmet-data-XXXXXX",
                 folder == NULL ? "/tmp" : folder);
        const int file = mkstemp(data->own);
        if (file < 0) {
            return pm_fail(PM_EFILE, "%s: cannot be made: %s", data->own, strerror(errno));
        }
        close(file);
        data->temporary = true;
    } else if (snprintf(data->own, sizeof data->own, "%s", keep) >= (int)sizeof data->own) {
        return pm_fail(PM_EUSAGE, "%s: the path is too long", keep);
    }
    data->path = data->own;
    const pm_tables_how how = {.temporary = data->temporary};
    const pm_status status = pm_tables_import(given->count, given->word, data->own, &how, quiet);
    if (status != PM_OK) {
        pm_data_close(data);
    }
    return status;
}

void pm_data_close(pm_data_file *data) {
    if (data->temporary) {
        unlink(data->own);
    }
    data->temporary = false;
}
