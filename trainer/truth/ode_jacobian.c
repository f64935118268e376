// Colours the columns of the pattern greedily, and takes one difference for each colour.
#include "truth/ode_jacobian.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/arena.h"

struct pm_ode_jacobian {
    const pm_ode *ode;
    pm_arena arena;
    int ncolour;
    int *first;  // [ncolour + 1] where the columns of each colour begin in `column`
    int *column; // [nz] columns, ordered by colour
};

// The pattern row by row: the columns of row i are column[start[i]] to column[start[i + 1] - 1].
typedef struct row_pattern {
    int *start, *column;
} row_pattern;

static bool transpose(const pm_ode_pattern *pattern, int nz, pm_arena *arena, row_pattern *rows) {
    rows->start = pm_arena_array(arena, (size_t)nz + 2, sizeof *rows->start);
    rows->column = pm_arena_array(arena, (size_t)pattern->start[nz] + 1, sizeof *rows->column);
    if (rows->start == NULL || rows->column == NULL) {
        return false;
    }
    int *end = rows->start + 1; // ends as the array of starts, one place further
    for (int i = 0; i < pattern->start[nz]; ++i) {
        ++end[pattern->row[i] + 1];
    }
    for (int i = 0; i < nz; ++i) {
        end[i + 1] += end[i];
    }
    for (int j = 0; j < nz; ++j) {
        for (int i = pattern->start[j]; i < pattern->start[j + 1]; ++i) {
            rows->column[end[pattern->row[i]]++] = j;
        }
    }
    return true;
}

// Returns the smallest colour that no column before `j` has with which column j shares a row.
static int choose_colour(const pm_ode_pattern *pattern, const row_pattern *rows, int j,
                         const int *colour, int *taken) {
    for (int i = pattern->start[j]; i < pattern->start[j + 1]; ++i) {
        const int row = pattern->row[i];
        for (int k = rows->start[row]; k < rows->start[row + 1] && rows->column[k] < j; ++k) {
            taken[colour[rows->column[k]]] = j;
        }
    }
    int chosen = 0;
    while (taken[chosen] == j) {
        ++chosen;
    }
    return chosen;
}

// Orders the columns by their colours.
static bool collect_colours(pm_ode_jacobian *jacobian, const int *colour) {
    const int nz = jacobian->ode->nz;
    jacobian->first =
        pm_arena_array(&jacobian->arena, (size_t)jacobian->ncolour + 2, sizeof *jacobian->first);
    jacobian->column = pm_arena_array(&jacobian->arena, (size_t)nz, sizeof *jacobian->column);
    if (jacobian->first == NULL || jacobian->column == NULL) {
        return false;
    }
    int *end = jacobian->first + 1; // ends as the array of starts, one place further
    for (int j = 0; j < nz; ++j) {
        ++end[colour[j] + 1];
    }
    for (int c = 0; c < jacobian->ncolour; ++c) {
        end[c + 1] += end[c];
    }
    for (int j = 0; j < nz; ++j) {
        jacobian->column[end[colour[j]]++] = j;
    }
    return true;
}

static bool find_colours(pm_ode_jacobian *jacobian) {
    const int nz = jacobian->ode->nz;
    const pm_ode_pattern *pattern = jacobian->ode->pattern;
    pm_arena work = {0};
    row_pattern rows;
    int *colour = pm_arena_array(&work, (size_t)nz, sizeof *colour);
    int *taken = pm_arena_array(&work, (size_t)nz + 1, sizeof *taken);
    bool done = false;
    if (colour != NULL && taken != NULL && transpose(pattern, nz, &work, &rows)) {
        memset(taken, -1, ((size_t)nz + 1) * sizeof *taken);
        for (int j = 0; j < nz; ++j) {
            colour[j] = choose_colour(pattern, &rows, j, colour, taken);
            jacobian->ncolour = colour[j] < jacobian->ncolour ? jacobian->ncolour : colour[j] + 1;
        }
        done = collect_colours(jacobian, colour);
    }
    pm_arena_free(&work);
    return done;
}

pm_ode_jacobian *pm_ode_jacobian_new(const pm_ode *ode) {
    pm_ode_jacobian *jacobian = calloc(1, sizeof *jacobian);
    if (jacobian == NULL) {
        return NULL;
    }
    jacobian->ode = ode;
    if (!find_colours(jacobian)) {
        pm_ode_jacobian_free(jacobian);
        return NULL;
    }
    return jacobian;
}

void pm_ode_jacobian_free(pm_ode_jacobian *jacobian) {
    if (jacobian != NULL) {
        pm_arena_free(&jacobian->arena);
        free(jacobian);
    }
}

int pm_ode_jacobian_colours(const pm_ode_jacobian *jacobian) {
    return jacobian->ncolour;
}

// Returns the smallest difference for a component of weight 1, as CVODE's cvLsDenseDQJac has it.
static double smallest_difference(int nz, const pm_ode_difference *d) {
    double square = 0;
    for (int i = 0; i < nz; ++i) {
        square += d->zdot[i] * d->weight[i] * (d->zdot[i] * d->weight[i]);
    }
    const double norm = sqrt(square / nz);
    return norm > 0 ? 1000 * fabs(d->h) * DBL_EPSILON * nz * norm : 1;
}

// Returns by how much component j is moved.
static double difference_of(const pm_ode_difference *d, double smallest, int j) {
    return fmax(sqrt(DBL_EPSILON) * fabs(d->z[j]), smallest / d->weight[j]);
}

// Writes column j, which was moved by `difference`. Returns false if it is not finite.
static bool fill_column(const pm_ode_pattern *pattern, int j, const pm_ode_difference *d,
                        double difference, double *value) {
    bool finite = true;
    for (int i = pattern->start[j]; i < pattern->start[j + 1]; ++i) {
        value[i] = (d->rate[pattern->row[i]] - d->zdot[pattern->row[i]]) / difference;
        finite = finite && isfinite(value[i]);
    }
    return finite;
}

bool pm_ode_jacobian_fill(const pm_ode_jacobian *jacobian, const pm_ode_difference *d,
                          double *value) {
    const pm_ode *ode = jacobian->ode;
    const double smallest = smallest_difference(ode->nz, d);
    bool finite = true;
    memcpy(d->moved, d->z, (size_t)ode->nz * sizeof *d->moved);
    for (int c = 0; c < jacobian->ncolour; ++c) {
        const int begin = jacobian->first[c], end = jacobian->first[c + 1];
        for (int k = begin; k < end; ++k) {
            const int j = jacobian->column[k];
            d->moved[j] += difference_of(d, smallest, j);
        }
        ode->rate(ode->data, d->moved, d->rate);
        for (int k = begin; k < end; ++k) {
            const int j = jacobian->column[k];
            finite &= fill_column(ode->pattern, j, d, d->moved[j] - d->z[j], value);
            d->moved[j] = d->z[j];
        }
    }
    return finite;
}
