// Reads variables of MATLAB files (versions 5 and 7.3) as the columns of a table, by libmatio where
// the program was built with it.
#include "command/table.h"

#ifdef PM_HAVE_MATIO

#include <matio.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory for a table");
}

// Whether a variable is a real matrix of double precision.
static bool is_matrix(const matvar_t *v) {
    return v->rank == 2 && v->class_type == MAT_C_DOUBLE && !v->isComplex && v->data != NULL &&
           v->dims[0] * v->dims[1] > 1;
}

// The number of samples and of columns of a variable: vectors lie in either direction.
static void shape_of(const matvar_t *v, size_t *rows, size_t *columns) {
    const bool lying = v->dims[0] == 1;
    *rows = lying ? v->dims[1] : v->dims[0];
    *columns = lying ? 1 : v->dims[1];
}

// Adds the columns of one variable to the table, by columns in `value` [ncolumn][nrow].
static pm_status add_variable(pm_table *t, const matvar_t *v, double **value) {
    size_t rows, columns;
    shape_of(v, &rows, &columns);
    if (t->ncolumn > 0 && rows != (size_t)t->nrow) {
        return PM_OK; // a constant, or a variable of another kind
    }
    if ((size_t)t->ncolumn + columns > PM_MOST_TABLE_COLUMNS || rows > 100000000) {
        return pm_fail(PM_EDATA, "more than %d columns", PM_MOST_TABLE_COLUMNS);
    }
    t->nrow = (int)rows;
    double *longer = realloc(*value, ((size_t)t->ncolumn + columns) * rows * sizeof *longer);
    if (longer == NULL) {
        return no_memory();
    }
    *value = longer;
    memcpy(longer + (size_t)t->ncolumn * rows, v->data, columns * rows * sizeof *longer);
    for (size_t c = 0; c < columns; ++c) {
        t->name[t->ncolumn] = columns == 1
                                  ? pm_arena_strdup(&t->arena, v->name)
                                  : pm_arena_printf(&t->arena, "%s_%d", v->name, (int)c + 1);
        t->unit[t->ncolumn] = "";
        if (t->name[t->ncolumn++] == NULL) {
            return no_memory();
        }
    }
    return PM_OK;
}

static pm_status read_variables(pm_table *t, mat_t *file, const char *path, double **value) {
    pm_status status = PM_OK;
    for (matvar_t *v; status == PM_OK && (v = Mat_VarReadNext(file)) != NULL;) {
        status = is_matrix(v) ? add_variable(t, v, value) : PM_OK;
        Mat_VarFree(v);
    }
    PM_TRY(status);
    return t->nrow >= 2
               ? PM_OK
               : pm_fail(PM_EDATA, "%s: there is no real matrix of two or more rows", path);
}

static pm_status transpose(pm_table *t, const double *value) {
    const size_t rows = (size_t)t->nrow, columns = (size_t)t->ncolumn;
    t->value = pm_arena_array(&t->arena, rows * columns, sizeof *t->value);
    if (t->value == NULL) {
        return no_memory();
    }
    for (size_t k = 0; k < rows; ++k) {
        for (size_t c = 0; c < columns; ++c) {
            t->value[k * columns + c] = value[c * rows + k];
        }
    }
    return PM_OK;
}

pm_status pm_table_read_matlab(pm_table *table, const char *path) {
    *table = (pm_table){0};
    mat_t *file = Mat_Open(path, MAT_ACC_RDONLY);
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot be read as a MATLAB file", path);
    }
    double *value = NULL;
    table->name = pm_arena_array(&table->arena, PM_MOST_TABLE_COLUMNS, sizeof *table->name);
    table->unit = pm_arena_array(&table->arena, PM_MOST_TABLE_COLUMNS, sizeof *table->unit);
    pm_status status = table->name == NULL || table->unit == NULL
                           ? no_memory()
                           : read_variables(table, file, path, &value);
    if (status == PM_OK) {
        status = transpose(table, value);
    }
    free(value);
    Mat_Close(file);
    if (status != PM_OK) {
        pm_table_free(table);
    }
    return status;
}

#else

pm_status pm_table_read_matlab(pm_table *table, const char *path) {
    (void)table;
    return pm_fail(PM_EFILE, "%s: this program was built without libmatio (libmatio-dev)", path);
}

#endif
