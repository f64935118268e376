// Reads tables line by line.
#include "command/table.h"

#include <ctype.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

// A text_column says which texts a column holds among its numbers.
typedef struct text_column {
    bool numbers;  // some place holds a number
    long line;     // number of the first line where the place holds another text; 0: none does
    char text[41]; // this text, cut
} text_column;

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

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a table");
}

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

// --- the first line ---

// Splits "theta [rad]" into a name and a unit. Blanks inside the name become '_'.
static pm_status take_name(table_reader *r, char *text) {
    pm_table *t = r->table;
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
    const char *name = pm_arena_strdup(&t->arena, text);
    if (name == NULL || unit == NULL) {
        return no_memory();
    }
    if (*name == '\0' || t->ncolumn == PM_MOST_TABLE_COLUMNS) {
        return pm_fail(PM_EDATA, "%s:%ld: expected the names of 1 to %d columns", r->path,
                       r->number, PM_MOST_TABLE_COLUMNS);
    }
    t->name[t->ncolumn] = name;
    t->unit[t->ncolumn++] = unit;
    return PM_OK;
}

static pm_status read_names(table_reader *r) {
    pm_table *t = r->table;
    t->name = pm_arena_array(&t->arena, PM_MOST_TABLE_COLUMNS, sizeof *t->name);
    t->unit = pm_arena_array(&t->arena, PM_MOST_TABLE_COLUMNS, sizeof *t->unit);
    if (t->name == NULL || t->unit == NULL) {
        return no_memory();
    }
    if (!next_line(r)) {
        return pm_fail(PM_EDATA, "%s: the file is empty", r->path);
    }
    static const char mark[] = "\xEF\xBB\xBF"; // with which some programs begin a text in UTF-8
    char *rest = strncmp(r->line, mark, 3) == 0 ? r->line + 3 : r->line;
    r->separator = strchr(rest, '\t') != NULL ? '\t' : strchr(rest, ';') != NULL ? ';' : ',';
    for (char *place; (place = cut(r, &rest)) != NULL;) {
        PM_TRY(take_name(r, place));
    }
    return PM_OK;
}

// --- numbers ---

// Reads a place. The result is NAN if the place is empty or holds no number.
static double take_number(const table_reader *r, const char *text, text_column *column) {
    char *end;
    const double value = *text == '\0' ? NAN : strtod(text, &end);
    const bool number = *text != '\0' && *end == '\0' && !isinf(value);
    column->numbers = column->numbers || number;
    if (*text != '\0' && !number && column->line == 0) {
        column->line = r->number;
        snprintf(column->text, sizeof column->text, "%s", text);
    }
    return number ? value : NAN;
}

static pm_status read_row(table_reader *r) {
    pm_table *t = r->table;
    if (t->nrow == r->capacity) {
        const int more = r->capacity == 0 ? 1024 : 2 * r->capacity;
        double *longer = realloc(r->value, (size_t)more * (size_t)t->ncolumn * sizeof *r->value);
        if (longer == NULL) {
            return no_memory();
        }
        r->value = longer;
        r->capacity = more;
    }
    double *row = r->value + (size_t)t->nrow * (size_t)t->ncolumn;
    char *rest = r->line;
    int count = 0;
    for (char *place; (place = cut(r, &rest)) != NULL; ++count) {
        if (count < t->ncolumn) {
            row[count] = take_number(r, place, &r->column[count]);
        }
    }
    ++t->nrow;
    return count == t->ncolumn
               ? PM_OK
               : pm_fail(PM_EDATA, "%s:%ld: expected %d columns as in the first line, found %d",
                         r->path, r->number, t->ncolumn, count);
}

// --- the whole ---

// Leaves out columns of texts alone, and refuses texts among numbers. kept [ncolumn] receives the
// places of the others.
static pm_status choose_columns(const table_reader *r, int *kept) {
    pm_table *t = r->table;
    int count = 0;
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
    t->ncolumn = count;
    return count > 0 ? PM_OK : pm_fail(PM_EDATA, "%s: there is no column of numbers", r->path);
}

static pm_status read_table(table_reader *r) {
    pm_table *t = r->table;
    int kept[PM_MOST_TABLE_COLUMNS];
    PM_TRY(read_names(r));
    while (next_line(r)) {
        PM_TRY(read_row(r));
    }
    if (t->nrow < 2) {
        return pm_fail(PM_EDATA, "%s: %d rows of numbers, expected two or more", r->path, t->nrow);
    }
    const int width = t->ncolumn;
    PM_TRY(choose_columns(r, kept));
    t->value = pm_arena_array(&t->arena, (size_t)t->nrow * (size_t)t->ncolumn, sizeof *t->value);
    if (t->value == NULL) {
        return no_memory();
    }
    for (ptrdiff_t k = 0; k < t->nrow; ++k) {
        for (int c = 0; c < t->ncolumn; ++c) {
            t->value[k * t->ncolumn + c] = r->value[k * width + kept[c]];
        }
    }
    return PM_OK;
}

pm_status pm_table_read(pm_table *table, const char *path) {
    *table = (pm_table){0};
    table_reader r = {.table = table, .path = path, .file = fopen(path, "r")};
    if (r.file == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot be read", path);
    }
    r.column = pm_arena_array(&table->arena, PM_MOST_TABLE_COLUMNS, sizeof *r.column);
    const pm_status status = r.column == NULL ? no_memory() : read_table(&r);
    fclose(r.file);
    free(r.line);
    free(r.value);
    if (status != PM_OK) {
        pm_table_free(table);
    }
    return status;
}

void pm_table_free(pm_table *table) {
    pm_arena_free(&table->arena);
    *table = (pm_table){0};
}
