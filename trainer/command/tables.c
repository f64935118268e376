// Calls the reader of tables, and decides which files need it.
#include "command/tables.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/files.h"
#include "base/python.h"
#include "store/hdf5_io.h"

static const pm_python_program reader = {
    "tables", "tables are read by Python: apt-get install python3 python3-h5py python3-scipy"};

pm_status pm_tables_import(int count, const char *const *table, const char *output,
                           const pm_tables_how *how, bool quiet) {
    const char *const option[][2] = {{"--time", how->time},       {"--dt", how->dt},
                                     {"--missing", how->missing}, {"--runs", how->runs},
                                     {"--types", how->types},     {"--units", how->units}};
    const int noption = sizeof option / sizeof *option;
    pm_arena arena = {0};
    const char **argument =
        pm_arena_array(&arena, (size_t)count + (size_t)noption + 4, sizeof *argument);
    int n = 0;
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "tables"));
    for (int i = 0; i < count; ++i) {
        PM_TRY_DONE(pm_files_check_input(table[i]));
        pm_files_note_input(table[i]);
    }
    PM_TRY_DONE(pm_files_check_output(output, PM_FILES_HDF5));
    argument[n++] = output;
    for (int i = 0; i < noption; ++i) {
        if (option[i][1] != NULL) { // joined by '=', as a value may begin with '-'
            argument[n++] = pm_arena_printf(&arena, "%s=%s", option[i][0], option[i][1]);
        }
    }
    if (how->temporary) {
        argument[n++] = "--temporary";
    }
    argument[n++] = "--";
    memcpy(argument + n, table, (size_t)count * sizeof *argument);
    PM_TRY_DONE(pm_arena_status(&arena, "tables"));
    status = pm_python_run(&reader, argument, quiet);
done:
    pm_arena_free(&arena);
    return status;
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
    data->table = given->word[0];
    const pm_tables_how how = {.temporary = data->temporary};
    const pm_status status = pm_tables_import(given->count, given->word, data->own, &how, quiet);
    if (status != PM_OK) {
        pm_data_close(data);
    }
    return status;
}

void pm_data_close(pm_data_file *data) {
    const size_t length = strlen(data->own);
    if (data->temporary) {
        unlink(data->own);
        if (strncmp(pm_error(), data->own, length) == 0) {
            (void)pm_fail(PM_EDATA, "%s%s", data->table, pm_error() + length);
        }
    }
    data->temporary = false;
}
