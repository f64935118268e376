// Reads variables of MATLAB files (versions 5 and 7.3) as the columns of a table, by libmatio where
// the program was built with it.
#include "command/table.h"

#ifdef PM_HAVE_MATIO

#include <matio.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST_ROWS 100000000
#define DEEPEST 8 // structs within structs

// What a file holds, and the table that it becomes.
typedef struct reading {
    const char *path;
    matvar_t *variable[PM_MOST_TABLE_COLUMNS]; // [nvariable] owned
    int nvariable;
    struct {
        const char *name; // borrowed from the variable
        const matvar_t *matrix;
    } item[PM_MOST_TABLE_COLUMNS]; // [nitem] the variables that may be columns
    int nitem;
    size_t rows; // samples of the table: as many as the longest variable has
} reading;

static pm_status too_many(const char *path) {
    return pm_fail(PM_EDATA, "%s: more than %d variables or columns", path, PM_MOST_TABLE_COLUMNS);
}

// Returns element i of a real matrix; *known is set to false if its numbers have another type.
static double element(const matvar_t *v, size_t i, bool *known) {
    switch (v->class_type) {
    case MAT_C_DOUBLE:
        return ((const double *)v->data)[i];
    case MAT_C_SINGLE:
        return ((const float *)v->data)[i];
    case MAT_C_INT8:
        return ((const mat_int8_t *)v->data)[i];
    case MAT_C_UINT8:
        return ((const mat_uint8_t *)v->data)[i];
    case MAT_C_INT16:
        return ((const mat_int16_t *)v->data)[i];
    case MAT_C_UINT16:
        return ((const mat_uint16_t *)v->data)[i];
    case MAT_C_INT32:
        return ((const mat_int32_t *)v->data)[i];
    case MAT_C_UINT32:
        return ((const mat_uint32_t *)v->data)[i];
    case MAT_C_INT64:
        return (double)((const mat_int64_t *)v->data)[i];
    case MAT_C_UINT64:
        return (double)((const mat_uint64_t *)v->data)[i];
    default:
        *known = false;
        return 0;
    }
}

// Whether a variable is a real matrix of numbers with more than one element.
static bool is_matrix(const matvar_t *v) {
    bool known = true;
    if (v->rank != 2 || v->isComplex || v->data == NULL || v->dims[0] * v->dims[1] < 2) {
        return false;
    }
    element(v, 0, &known);
    return known;
}

static void tell_left_out(const reading *r, const char *name, const matvar_t *v) {
    char size[64] = "";
    for (int i = 0; i < v->rank && i < 3; ++i) {
        const size_t n = strlen(size);
        snprintf(size + n, sizeof size - n, "%s%zu", i > 0 ? " x " : "", v->dims[i]);
    }
    printf("%s: leaves out %s (%s%s)\n", r->path, name == NULL ? "a variable" : name, size,
           v->class_type == MAT_C_STRUCT                                    ? " struct"
           : v->class_type == MAT_C_CELL                                    ? " cell"
           : v->class_type == MAT_C_CHAR                                    ? " text"
           : v->class_type == MAT_C_SPARSE                                  ? " sparse"
           : v->class_type == MAT_C_OPAQUE || v->class_type == MAT_C_OBJECT ? " object"
           : v->isComplex                                                   ? " complex"
           : is_matrix(v)                                                   ? ", others are longer"
                                                                            : " of unknown type");
}

// --- variables ---

// Lists a variable that may be a column, or the fields of a struct.
static pm_status list_variable(reading *r, const char *name, matvar_t *v, int depth) {
    if (v->class_type == MAT_C_STRUCT && v->rank == 2 && v->dims[0] * v->dims[1] == 1 &&
        depth < DEEPEST) {
        char *const *field = Mat_VarGetStructFieldnames(v);
        const unsigned count = Mat_VarGetNumberOfFields(v);
        for (unsigned i = 0; i < count; ++i) {
            matvar_t *own = Mat_VarGetStructFieldByIndex(v, i, 0);
            PM_TRY(own == NULL ? PM_OK : list_variable(r, field[i], own, depth + 1));
        }
        return PM_OK;
    }
    if (!is_matrix(v)) {
        tell_left_out(r, name, v);
        return PM_OK;
    }
    if (r->nitem == PM_MOST_TABLE_COLUMNS) {
        return too_many(r->path);
    }
    r->item[r->nitem].name = name == NULL ? "column" : name;
    r->item[r->nitem++].matrix = v;
    const size_t longer = v->dims[0] > v->dims[1] ? v->dims[0] : v->dims[1];
    r->rows = longer > r->rows ? longer : r->rows;
    return PM_OK;
}

// --- columns ---

// Adds the columns of one variable to the table, by columns in `value` [ncolumn][nrow]. Samples are
// the rows of a matrix, or its columns if there are as many as the table has samples. A struct may
// have a field with the name of another variable.
static pm_status add_variable(pm_table *t, const char *name, const matvar_t *v, double **value) {
    const size_t rows = (size_t)t->nrow, from = (size_t)t->ncolumn;
    const bool lying = v->dims[0] != rows;
    const size_t columns = lying ? v->dims[0] : v->dims[1];
    if (from + columns > PM_MOST_TABLE_COLUMNS) {
        return too_many("a MATLAB file");
    }
    double *longer = realloc(*value, (from + columns) * rows * sizeof *longer);
    if (longer == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a table");
    }
    *value = longer;
    for (size_t c = 0; c < columns; ++c) {
        const char *own = columns == 1 ? pm_arena_strdup(&t->arena, name)
                                       : pm_arena_printf(&t->arena, "%s_%d", name, (int)c + 1);
        PM_TRY(pm_arena_status(&t->arena, "a table"));
        for (int k = 0; k < t->ncolumn; ++k) {
            if (strcmp(t->name[k], own) == 0) {
                return pm_fail(PM_EDATA, "two columns are called \"%s\"", own);
            }
        }
        t->name[t->ncolumn] = own;
        t->unit[t->ncolumn++] = "";
        for (size_t k = 0; k < rows; ++k) {
            bool known;
            longer[(from + c) * rows + k] =
                element(v, lying ? k * v->dims[0] + c : c * rows + k, &known);
        }
    }
    return PM_OK;
}

// Fills the table; value [ncolumn][nrow] is work space.
static pm_status read_variables(pm_table *t, reading *r, mat_t *file, double **value) {
    t->name = pm_arena_array(&t->arena, PM_MOST_TABLE_COLUMNS, sizeof *t->name);
    t->unit = pm_arena_array(&t->arena, PM_MOST_TABLE_COLUMNS, sizeof *t->unit);
    PM_TRY(pm_arena_status(&t->arena, "a table"));
    for (matvar_t *v; (v = Mat_VarReadNext(file)) != NULL;) {
        if (r->nvariable == PM_MOST_TABLE_COLUMNS) {
            Mat_VarFree(v);
            return too_many(r->path);
        }
        r->variable[r->nvariable++] = v;
        PM_TRY(list_variable(r, v->name, v, 0));
    }
    if (r->rows < 2 || r->rows > MOST_ROWS) {
        return pm_fail(PM_EDATA, "%s: expected a real matrix or vector of 2 to %d samples", r->path,
                       MOST_ROWS);
    }
    t->nrow = (int)r->rows;
    for (int i = 0; i < r->nitem; ++i) {
        const matvar_t *v = r->item[i].matrix;
        if (v->dims[0] == r->rows || v->dims[1] == r->rows) {
            PM_TRY(add_variable(t, r->item[i].name, v, value));
        } else {
            tell_left_out(r, r->item[i].name, v);
        }
    }
    const size_t columns = (size_t)t->ncolumn;
    t->value = pm_arena_array(&t->arena, r->rows * columns, sizeof *t->value);
    PM_TRY(pm_arena_status(&t->arena, "a table"));
    for (size_t k = 0; k < r->rows * columns; ++k) {
        t->value[k] = (*value)[k % columns * r->rows + k / columns];
    }
    return PM_OK;
}

pm_status pm_table_read_matlab(pm_table *table, const char *path) {
    mat_t *file = Mat_Open(path, MAT_ACC_RDONLY);
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot be read as a MATLAB file", path);
    }
    double *value = NULL;
    reading *r = calloc(1, sizeof *r);
    pm_status status = pm_fail(PM_ENOMEM, "out of memory for a table");
    if (r != NULL) {
        r->path = path;
        status = read_variables(table, r, file, &value);
    }
    for (int i = 0; r != NULL && i < r->nvariable; ++i) {
        Mat_VarFree(r->variable[i]);
    }
    free(r);
    free(value);
    Mat_Close(file);
    return status;
}

#else

pm_status pm_table_read_matlab(pm_table *table, const char *path) {
    (void)table;
    return pm_fail(PM_EFILE, "%s: this program was built without libmatio (libmatio-dev)", path);
}

#endif
