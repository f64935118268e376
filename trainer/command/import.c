// portmet-train import: turns tables of measurements, one file for each trajectory, into a dataset.
// Tables are text files, as spreadsheets and loggers write them (CSV), or MATLAB files.
#include "command/commands.h"

#include <ctype.h>
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
#define FIRST_ROWS 1024 // rows for which a table has room at first
#define EVEN 1e-3       // times that are off by less, in steps, are even: tables round

// --- tables in text files ---

// A text_column says which texts a column holds among its numbers.
typedef struct text_column {
    bool numbers;  // some place holds a number
    long line;     // number of the first line where the place holds another text; 0: none does
    char text[41]; // this text, cut
} text_column;

// A file that is being read.
typedef struct table_reader {
    pm_table *table;
    const char *path;
    FILE *file;
    char *line; // of getline
    size_t size;
    long number; // of the line, from 1
    char separator;
    int capacity; // rows
    double *value;
    text_column *column; // [PM_MOST_TABLE_COLUMNS]
} table_reader;

// Reads the next line with content into r->line, without its end. Returns false at the end.
static bool next_line(table_reader *r) {
    for (ssize_t length; (length = getline(&r->line, &r->size, r->file)) >= 0;) {
        ++r->number;
        while (length > 0 && isspace((unsigned char)r->line[length - 1]) &&
               r->line[length - 1] != '\t') {
            r->line[--length] = '\0';
        }
        if (length > 0 && r->line[0] != '#') {
            return true;
        }
    }
    return false;
}

// Removes blanks and quotation marks around a text, in place.
static char *trim(char *text) {
    while (isspace((unsigned char)*text) || *text == '"') {
        ++text;
    }
    size_t length = strlen(text);
    while (length > 0 && (isspace((unsigned char)text[length - 1]) || text[length - 1] == '"')) {
        text[--length] = '\0';
    }
    return text;
}

// Cuts the next place off a line; NULL at its end.
static char *cut(table_reader *r, char **rest) {
    char *place = *rest;
    if (place == NULL) {
        return NULL;
    }
    char *end = strchr(place, r->separator);
    *rest = end == NULL ? NULL : end + 1;
    if (end != NULL) {
        *end = '\0';
    }
    return trim(place);
}

// Reads the first line: names such as "theta [rad]", with a unit. Blanks inside a name become '_'.
static pm_status read_names(table_reader *r) {
    pm_table *t = r->table;
    t->name = pm_arena_array(&t->arena, PM_MOST_TABLE_COLUMNS, sizeof *t->name);
    t->unit = pm_arena_array(&t->arena, PM_MOST_TABLE_COLUMNS, sizeof *t->unit);
    r->column = pm_arena_array(&t->arena, PM_MOST_TABLE_COLUMNS, sizeof *r->column);
    PM_TRY(pm_arena_status(&t->arena, "a table"));
    if (!next_line(r)) {
        return pm_fail(PM_EDATA, "%s: the file is empty", r->path);
    }
    static const char mark[] = "\xEF\xBB\xBF"; // with which some programs begin a text in UTF-8
    char *rest = strncmp(r->line, mark, 3) == 0 ? r->line + 3 : r->line;
    r->separator = strchr(rest, '\t') != NULL ? '\t' : strchr(rest, ';') != NULL ? ';' : ',';
    for (char *text; (text = cut(r, &rest)) != NULL;) {
        const size_t bracket = strcspn(text, "[(");
        const char *unit = "";
        if (text[bracket] != '\0') {
            char *inside = text + bracket + 1;
            inside[strcspn(inside, "])")] = '\0';
            unit = pm_arena_strdup(&t->arena, trim(inside));
            text[bracket] = '\0';
        }
        text = trim(text);
        for (char *c = text; *c != '\0'; ++c) {
            *c = isspace((unsigned char)*c) ? '_' : *c;
        }
        if (*text == '\0' || t->ncolumn == PM_MOST_TABLE_COLUMNS) {
            return pm_fail(PM_EDATA, "%s:%ld: expected the names of 1 to %d columns", r->path,
                           r->number, PM_MOST_TABLE_COLUMNS);
        }
        t->name[t->ncolumn] = pm_arena_strdup(&t->arena, text);
        t->unit[t->ncolumn++] = unit;
    }
    return pm_arena_status(&t->arena, "a table");
}

// Reads all lines; a place is NAN if it is empty or holds no number. Leaves out columns of texts
// alone, and refuses texts among numbers.
static pm_status read_lines(table_reader *r) {
    pm_table *t = r->table;
    int kept[PM_MOST_TABLE_COLUMNS], count = 0;
    PM_TRY(read_names(r));
    while (next_line(r)) {
        if (t->nrow == r->capacity) {
            const int more = r->capacity == 0 ? FIRST_ROWS : 2 * r->capacity;
            double *longer =
                realloc(r->value, (size_t)more * (size_t)t->ncolumn * sizeof *r->value);
            if (longer == NULL) {
                return pm_fail(PM_ENOMEM, "out of memory for a table");
            }
            r->value = longer;
            r->capacity = more;
        }
        double *row = r->value + (size_t)t->nrow++ * (size_t)t->ncolumn;
        char *rest = r->line;
        int nplace = 0;
        for (char *text; (text = cut(r, &rest)) != NULL; ++nplace) {
            if (nplace >= t->ncolumn) {
                continue;
            }
            text_column *column = &r->column[nplace];
            char *end;
            const double value = *text == '\0' ? NAN : strtod(text, &end);
            const bool number = *text != '\0' && *end == '\0' && !isinf(value);
            column->numbers = column->numbers || number;
            if (*text != '\0' && !number && column->line == 0) {
                column->line = r->number;
                snprintf(column->text, sizeof column->text, "%s", text);
            }
            row[nplace] = number ? value : NAN;
        }
        if (nplace != t->ncolumn) {
            return pm_fail(PM_EDATA, "%s:%ld: expected %d columns as in the first line, found %d",
                           r->path, r->number, t->ncolumn, nplace);
        }
    }
    if (t->nrow < 2) {
        return pm_fail(PM_EDATA, "%s: %d rows of numbers, expected two or more", r->path, t->nrow);
    }
    for (int c = 0; c < t->ncolumn; ++c) {
        const text_column *column = &r->column[c];
        if (column->line > 0 && column->numbers) {
            return pm_fail(PM_EDATA, "%s:%ld: expected a number, found \"%s\"", r->path,
                           column->line, column->text);
        }
        if (column->line > 0) {
            printf("%s: leaves out column \"%s\", which holds no number but \"%s\"\n", r->path,
                   t->name[c], column->text);
            continue;
        }
        t->name[count] = t->name[c];
        t->unit[count] = t->unit[c];
        kept[count++] = c;
    }
    if (count == 0) {
        return pm_fail(PM_EDATA, "%s: there is no column of numbers", r->path);
    }
    t->value = pm_arena_array(&t->arena, (size_t)t->nrow * (size_t)count, sizeof *t->value);
    PM_TRY(pm_arena_status(&t->arena, "a table"));
    for (ptrdiff_t k = 0; k < t->nrow; ++k) {
        for (int c = 0; c < count; ++c) {
            t->value[k * count + c] = r->value[k * t->ncolumn + kept[c]];
        }
    }
    t->ncolumn = count;
    return PM_OK;
}

typedef struct import_arguments {
    const char *file[MOST_FILES];
    const char *output, *time;
} import_arguments;

// --- from tables to a dataset ---

// Makes the dataset of all tables.
static pm_status join(const pm_table *table, int count, int time, pm_dataset **dataset) {
    const char *column[PM_MOST_TABLE_COLUMNS], *units = "";
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
    for (int c = 0, n = 0; c < table->ncolumn && units != NULL; ++c) {
        units = c == time ? units
                          : pm_arena_printf(&d->arena, "%s%s%s", units, n++ > 0 ? ";" : "",
                                            table->unit[c]);
    }
    PM_TRY(pm_arena_status(&d->arena, "a dataset"));
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < ntime; ++k) {
            const bool there = k < table[i].nrow;
            const double *from = table[i].value + (ptrdiff_t)(there ? k : 0) * table[i].ncolumn;
            double *row = pm_dataset_state(d, i, k);
            d->times[(ptrdiff_t)i * ntime + k] = there ? from[time] : NAN;
            for (int c = 0; c < table->ncolumn; ++c) {
                if (c != time) {
                    *row++ = there ? from[c] : NAN;
                }
            }
        }
    }
    // dt is the mean step of the first trajectory. If all trajectories have the same even times,
    // these become the times of the dataset.
    const double first = pm_dataset_time(d, 0, 0);
    d->dt = (pm_dataset_time(d, 0, table->nrow - 1) - first) / (table->nrow - 1);
    bool even = d->dt > 0;
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < ntime; ++k) {
            even = even && fabs(pm_dataset_time(d, i, k) - (first + k * d->dt)) <= EVEN * d->dt;
        }
    }
    for (int k = 0; k < ntime && even; ++k) {
        d->t[k] = first + k * d->dt;
    }
    d->times = even ? NULL : d->times;
    return pm_dataset_note(d, "units", "%s", units);
}

// Reads all tables, which have the same columns, and finds the one with times, which become s.
static pm_status read_tables(const import_arguments *a, pm_table *table, int count, int *time) {
    for (int i = 0; i < count; ++i) {
        const char *end = strrchr(a->file[i], '.');
        if (end != NULL && strcmp(end, ".mat") == 0) {
            PM_TRY(pm_table_read_matlab(&table[i], a->file[i]));
        } else {
            // The first line that does not begin with # names the columns. A comma, semicolon or
            // tab separates columns, whichever the first line has.
            const char *path = a->file[i];
            table_reader r = {.table = &table[i], .path = path, .file = fopen(path, "r")};
            if (r.file == NULL) {
                return pm_fail(PM_EFILE, "%s: cannot be read", path);
            }
            const pm_status status = read_lines(&r);
            fclose(r.file);
            free(r.line);
            free(r.value);
            PM_TRY(status);
        }
        bool same = table[0].ncolumn == table[i].ncolumn;
        for (int c = 0; same && c < table[0].ncolumn; ++c) {
            same = strcmp(table[0].name[c], table[i].name[c]) == 0 &&
                   strcmp(table[0].unit[c], table[i].unit[c]) == 0;
        }
        if (!same) {
            return pm_fail(PM_EDATA,
                           "%s: expected the same columns as in the first file, in the same units",
                           a->file[i]);
        }
    }
    for (*time = 0; *time < table->ncolumn; ++*time) {
        const char *own = table->name[*time];
        if (a->time == NULL ? strcasecmp(own, "t") == 0 || strcasecmp(own, "time") == 0
                            : strcmp(own, a->time) == 0) {
            break;
        }
    }
    if (*time == table->ncolumn) {
        const char *all = pm_names_fold(table->name, table->ncolumn, &table->arena);
        return pm_fail(
            PM_EDATA,
            "%s: there is no column \"%s\" with times; name it with --time, one of: %.255s",
            a->file[0], a->time == NULL ? "t" : a->time, all == NULL ? "" : all);
    }
    // Their unit is that of the column, or s.
    const char *text = table->unit[*time];
    const pm_unit second = pm_unit_parse("s");
    pm_unit unit = pm_unit_parse(*text == '\0' ? "s" : text);
    const double factor = unit.factor;
    unit.factor = second.factor;
    if (!pm_unit_equal(&unit, &second)) {
        return pm_fail(PM_EDATA, "%s: column \"%s\": \"%.40s\" is no unit of time, such as s or ms",
                       a->file[0], table->name[*time], text);
    }
    for (int i = 0; i < count; ++i) {
        for (int k = 0; k < table[i].nrow; ++k) {
            table[i].value[(ptrdiff_t)k * table->ncolumn + *time] *= factor;
        }
    }
    return table[0].ncolumn > 1
               ? PM_OK
               : pm_fail(PM_EDATA, "%s: there is no column beside the times", a->file[0]);
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
    pm_dataset *dataset = NULL;
    pm_table *table = NULL;
    int count = 0, time = 0;
    pm_status status;
    PM_TRY_DONE(pm_options_read(&options, argc, argv, &helped));
    PM_TRY_DONE(pm_options_output("--output", a->output));
    while (count < MOST_FILES && a->file[count] != NULL) {
        ++count;
    }
    if (helped) {
        goto done;
    }
    table = calloc((size_t)count, sizeof *table);
    PM_TRY_DONE(table == NULL ? pm_fail(PM_ENOMEM, "import: out of memory") : PM_OK);
    PM_TRY_DONE(read_tables(a, table, count, &time));
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
    for (int i = 0; i < count && table != NULL; ++i) {
        pm_arena_free(&table[i].arena);
    }
    free(table);
    free(a);
    return status;
}
