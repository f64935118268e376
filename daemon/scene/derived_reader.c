// Reads matrices, and derived variables: offset + matrix * groups.
#include <math.h>

#include "scene/model_block.h"
#include "scene/network_reader.h"

#define MAX_SIZE 1000000 // components of a derived variable

static pm_status check_rows(pm_yaml list) {
    const bool any = pm_yaml_is_list(list) && pm_yaml_count(list) > 0;
    const int cols = any ? pm_yaml_count(pm_yaml_item(list, 0)) : 0;
    if (cols == 0) {
        return pm_yaml_fail(list, "expected a list of rows such as [[1.0, 0.0], [0.0, 1.0]]");
    }
    for (int i = 0; i < pm_yaml_count(list); ++i) {
        const pm_yaml row = pm_yaml_item(list, i);
        if (!pm_yaml_is_list(row) || pm_yaml_count(row) != cols) {
            return pm_yaml_fail(row, "expected a row of %d numbers like the first, found %d", cols,
                                pm_yaml_count(row));
        }
    }
    return PM_OK;
}

pm_status pm_model_read_matrix(pm_yaml list, pm_arena *arena, pm_matrix_spec *matrix) {
    *matrix = (pm_matrix_spec){0};
    if (!pm_yaml_exists(list)) {
        return PM_OK;
    }
    PM_TRY(pm_model_read_at(list, arena, &matrix->at));
    PM_TRY(check_rows(list));
    matrix->rows = pm_yaml_count(list);
    matrix->cols = pm_yaml_count(pm_yaml_item(list, 0));
    const size_t count = (size_t)matrix->rows * (size_t)matrix->cols;
    double *value = pm_arena_array(arena, count, sizeof *value);
    if (value == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < matrix->rows; ++i) {
        const pm_yaml row = pm_yaml_item(list, i);
        for (int j = 0; j < matrix->cols; ++j) {
            PM_TRY(pm_yaml_double(pm_yaml_item(row, j), -INFINITY, INFINITY,
                                  &value[i * matrix->cols + j]));
        }
    }
    matrix->value = value;
    return PM_OK;
}

// Reads one derived variable. The block holds its matrix, or only its size if the weights file
// holds the matrix.
static pm_status read_derived(pm_yaml name, pm_yaml block, pm_arena *arena,
                              pm_derived_spec *derived) {
    static const char *const keys[] = {"of", "size", "matrix", "offset", NULL};
    pm_yaml of;
    const pm_yaml matrix = pm_yaml_get(block, "matrix"), offset = pm_yaml_get(block, "offset");
    pm_yaml size = pm_yaml_get(block, "size");
    PM_TRY(pm_yaml_text(name, arena, &derived->name));
    PM_TRY(pm_model_read_at(block, arena, &derived->at));
    PM_TRY(pm_yaml_allow(block, keys));
    PM_TRY(pm_yaml_require(block, "of", &of));
    PM_TRY(pm_model_read_names(block, "of", arena, &derived->ngroup, &derived->group));
    if (derived->ngroup < 1 || derived->ngroup > PM_MAX_GROUPS) {
        return pm_yaml_fail(of, "expected 1 to %d groups", PM_MAX_GROUPS);
    }
    PM_TRY(pm_model_read_matrix(matrix, arena, &derived->matrix));
    derived->size = derived->matrix.rows;
    if (pm_yaml_exists(size) || !pm_yaml_exists(matrix)) {
        PM_TRY(pm_yaml_require(block, "size", &size));
        PM_TRY(pm_yaml_int(size, 1, MAX_SIZE, &derived->size));
    }
    if (pm_yaml_exists(offset)) {
        int count;
        double *value;
        PM_TRY(pm_yaml_doubles(offset, arena, &count, &value));
        if (!pm_yaml_exists(matrix)) {
            return pm_yaml_fail(offset, "expected a matrix beside it");
        }
        if (count != derived->size) {
            return pm_yaml_fail(offset, "expected %d numbers, found %d", derived->size, count);
        }
        derived->offset = value;
    }
    return PM_OK;
}

pm_status pm_model_read_derived(pm_yaml map, pm_arena *arena, pm_part_spec *spec) {
    spec->nderived = 0;
    spec->derived = NULL;
    if (!pm_yaml_exists(map)) {
        return PM_OK;
    }
    PM_TRY(pm_yaml_require_entries(map));
    const int count = pm_yaml_count(map);
    if (count > PM_MAX_DERIVED) {
        return pm_yaml_fail(map, "%d derived variables, at most %d are possible", count,
                            PM_MAX_DERIVED);
    }
    pm_derived_spec *derived = pm_arena_array(arena, (size_t)count, sizeof *derived);
    if (derived == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory while reading a model");
    }
    for (int i = 0; i < count; ++i) {
        pm_yaml key, value;
        pm_yaml_entry(map, i, &key, &value);
        PM_TRY(read_derived(key, value, arena, &derived[i]));
    }
    spec->nderived = count;
    spec->derived = derived;
    return PM_OK;
}
