// portmet-train import: turns tables of measurements, one file for each trajectory, into a dataset.
#include "command/commands.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/options.h"
#include "base/unit.h"
#include "command/table.h"
#include "store/dataset.h"
#include "store/names.h"

#define MOST_FILES 10000
#define EVEN 1e-3 // times that are off by less, in steps, are even: tables round

typedef struct import_arguments {
    const char *file[MOST_FILES];
    const char *output, *time, *title;
} import_arguments;

// --- from tables to a dataset ---

static pm_status check_columns(const pm_table *first, const pm_table *other, const char *path) {
    bool same = first->ncolumn == other->ncolumn;
    for (int c = 0; same && c < first->ncolumn; ++c) {
        same = strcmp(first->name[c], other->name[c]) == 0 &&
               strcmp(first->unit[c], other->unit[c]) == 0;
    }
    return same ? PM_OK
                : pm_fail(PM_EDATA,
                          "%s: expected the same columns as in the first file, in the same units",
                          path);
}

// Finds the column of times by its name.
static pm_status find_time(pm_table *table, const char *name, const char *path, int *column) {
    for (*column = 0; *column < table->ncolumn; ++*column) {
        const char *own = table->name[*column];
        if (name == NULL ? strcasecmp(own, "t") == 0 || strcasecmp(own, "time") == 0
                         : strcmp(own, name) == 0) {
            return PM_OK;
        }
    }
    const char *all = pm_names_fold(table->name, table->ncolumn, &table->arena);
    return pm_fail(PM_EDATA,
                   "%s: there is no column \"%s\" with times; name it with --time, one of: %.255s",
                   path, name == NULL ? "t" : name, all == NULL ? "" : all);
}

// Converts the times of a table to s, by the unit of their column. Times without a unit are in s.
static pm_status convert_times(pm_table *table, int column, const char *path) {
    const char *text = table->unit[column];
    const pm_unit second = pm_unit_parse("s");
    pm_unit unit = pm_unit_parse(*text == '\0' ? "s" : text);
    const double factor = unit.factor;
    unit.factor = second.factor;
    if (!pm_unit_equal(&unit, &second)) {
        return pm_fail(PM_EDATA, "%s: column \"%s\": \"%.40s\" is no unit of time, such as s or ms",
                       path, table->name[column], text);
    }
    for (int k = 0; k < table->nrow; ++k) {
        table->value[(ptrdiff_t)k * table->ncolumn + column] *= factor;
    }
    return PM_OK;
}

static pm_status note_units(pm_dataset *d, const pm_table *table, int time) {
    const char *text = "";
    for (int c = 0, n = 0; c < table->ncolumn && text != NULL; ++c) {
        text = c == time
                   ? text
                   : pm_arena_printf(&d->arena, "%s%s%s", text, n++ > 0 ? ";" : "", table->unit[c]);
    }
    return text == NULL ? pm_fail(PM_ENOMEM, "import: out of memory")
                        : pm_dataset_note(d, "units", "%s", text);
}

static void copy_table(const pm_table *table, int time, int trajectory, pm_dataset *d) {
    for (int k = 0; k < d->ntime; ++k) {
        double *row = pm_dataset_state(d, trajectory, k);
        const bool there = k < table->nrow;
        const double *from = table->value + (ptrdiff_t)(there ? k : 0) * table->ncolumn;
        d->times[(ptrdiff_t)trajectory * d->ntime + k] = there ? from[time] : NAN;
        for (int c = 0, to = 0; c < table->ncolumn; ++c) {
            if (c != time) {
                row[to++] = there ? from[c] : NAN;
            }
        }
    }
}

// Sets dt to the mean step of the first trajectory. If all trajectories have the same even times,
// these become the times of the dataset.
static void make_even(pm_dataset *d, int steps) {
    d->dt = (pm_dataset_time(d, 0, steps) - pm_dataset_time(d, 0, 0)) / steps;
    bool even = d->dt > 0;
    for (int i = 0; i < d->ntrajectory; ++i) {
        for (int k = 0; k < d->ntime; ++k) {
            const double expected = pm_dataset_time(d, 0, 0) + k * d->dt;
            even = even && fabs(pm_dataset_time(d, i, k) - expected) <= EVEN * d->dt;
        }
    }
    for (int k = 0; k < d->ntime && even; ++k) {
        d->t[k] = pm_dataset_time(d, 0, 0) + k * d->dt;
    }
    d->times = even ? NULL : d->times;
}

// Makes the dataset of all tables.
static pm_status join(const pm_table *table, int count, int time, pm_dataset **dataset) {
    const char *column[PM_MOST_TABLE_COLUMNS];
    int ntime = 0, ncolumn = 0;
    for (int c = 0; c < table->ncolumn; ++c) {
        if (c != time) {
            column[ncolumn++] = table->name[c];
        }
    }
    for (int i = 0; i < count; ++i) {
        ntime = table[i].nrow > ntime ? table[i].nrow : ntime;
    }
    PM_TRY(pm_dataset_new(dataset, count, ntime, ncolumn, 1, column));
    pm_dataset *d = *dataset;
    d->measured = true;
    d->times = pm_arena_array(&d->arena, (size_t)count * (size_t)ntime, sizeof *d->times);
    if (d->times == NULL) {
        return pm_fail(PM_ENOMEM, "import: out of memory");
    }
    for (int i = 0; i < count; ++i) {
        copy_table(&table[i], time, i, d);
    }
    make_even(d, table->nrow - 1);
    return note_units(d, table, time);
}

// --- the command ---

static pm_status read_all(const import_arguments *a, pm_table *table, int count, int *time) {
    for (int i = 0; i < count; ++i) {
        const char *end = strrchr(a->file[i], '.');
        PM_TRY(end != NULL && strcmp(end, ".mat") == 0 ? pm_table_read_matlab(&table[i], a->file[i])
                                                       : pm_table_read(&table[i], a->file[i]));
        PM_TRY(check_columns(&table[0], &table[i], a->file[i]));
    }
    PM_TRY(find_time(&table[0], a->time, a->file[0], time));
    for (int i = 0; i < count; ++i) {
        PM_TRY(convert_times(&table[i], *time, a->file[i]));
    }
    return table[0].ncolumn > 1
               ? PM_OK
               : pm_fail(PM_EDATA, "%s: there is no column beside the times", a->file[0]);
}

static pm_status convert(const import_arguments *a, int count) {
    pm_table *table = calloc((size_t)count, sizeof *table);
    pm_dataset *dataset = NULL;
    pm_status status = PM_OK;
    int time = 0;
    if (table == NULL) {
        return pm_fail(PM_ENOMEM, "import: out of memory");
    }
    PM_TRY_DONE(read_all(a, table, count, &time));
    PM_TRY_DONE(join(table, count, time, &dataset));
    PM_TRY_DONE(pm_dataset_note(dataset, "source", "portmet-train import"));
    PM_TRY_DONE(pm_dataset_save(dataset, a->output));
    printf("wrote %s: %d trajectories of at most %d samples, columns", a->output, count,
           dataset->ntime);
    for (int c = 0; c < dataset->ncolumn; ++c) {
        printf(" %s", dataset->column[c]);
    }
    printf("\n");
done:
    pm_dataset_free(dataset);
    for (int i = 0; i < count; ++i) {
        pm_table_free(&table[i]);
    }
    free(table);
    return status;
}

pm_status pm_command_import(int argc, char **argv, const volatile sig_atomic_t *stop) {
    import_arguments *a = calloc(1, sizeof *a);
    bool helped = false;
    (void)stop;
    if (a == NULL) {
        return pm_fail(PM_ENOMEM, "import: out of memory");
    }
    const pm_option option[] = {
        {"--output", "-o", "FILE", NULL, &a->output, true, "dataset to write (HDF5)"},
        {"--time", NULL, "NAME", NULL, &a->time, false,
         "the column with times; default: t or time, in any letters"},
    };
    const pm_options options = {
        .usage = "portmet-train import TABLE... -o FILE [options]",
        .summary =
            "Turns tables of measurements into a dataset, one trajectory from each. A table is a\n"
            "text file whose first line names the columns, with units in brackets if they are\n"
            "known: t [s], theta [rad]. Times may be in s, ms or us, and need not be even.\n"
            "Commas, semicolons or tabs separate the numbers; an empty place or nan is a sample\n"
            "that is missing. Lines that begin with # and columns of texts are left out.\n"
            "Real vectors and matrices of a MATLAB file (.mat), also in structs, are columns,\n"
            "too, if the program was built with libmatio.",
        .positional_name = "TABLE",
        .positional = a->file,
        .least = 1,
        .most = MOST_FILES,
        .count = sizeof option / sizeof *option,
        .option = option,
    };
    int count = 0;
    pm_status status = pm_options_read(&options, argc, argv, &helped);
    status = status == PM_OK ? pm_options_output("--output", a->output) : status;
    while (count < MOST_FILES && a->file[count] != NULL) {
        ++count;
    }
    if (status == PM_OK && !helped) {
        status = convert(a, count);
    }
    free(a);
    return status;
}
