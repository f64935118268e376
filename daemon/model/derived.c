// Derived variables as parameters, as nodes of a graph, and their covectors and bounds.
#include "model/derived.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define MOST_NUMBERS 10000000 // of a matrix, which then takes 80 MB

typedef char entry_name[PM_MAX_NAME + 16];

static const pm_param_entry *entry_of(const pm_params *params, const pm_derived_spec *derived,
                                      const char *what) {
    entry_name name;
    snprintf(name, sizeof name, "derived.%s.%s", derived->name, what);
    return pm_params_find(params, name);
}

static pm_node node_of(pm_graph *g, const pm_params *params, const pm_derived_spec *derived,
                       const char *what) {
    const pm_param_entry *entry = entry_of(params, derived, what);
    return pm_param(g, entry->value, entry->rows, entry->cols);
}

bool pm_derived_is_of(const pm_derived_spec *derived, const char *group) {
    for (int i = 0; i < derived->ngroup; ++i) {
        if (strcmp(derived->group[i], group) == 0) {
            return true;
        }
    }
    return false;
}

// --- declaring ---

static pm_status check_groups(const pm_derived_spec *derived, const pm_layout *layout, int *cols) {
    *cols = 0;
    for (int i = 0; i < derived->ngroup; ++i) {
        const pm_group *group = pm_layout_find(layout, derived->group[i]);
        if (group == NULL) {
            return pm_fail(PM_ECONFIG, "derived variable %s: the state has no group \"%s\"",
                           derived->name, derived->group[i]);
        }
        *cols += group->size;
    }
    return PM_OK;
}

static pm_status check_name(const pm_part *part, int i) {
    const char *name = part->spec.derived[i].name;
    bool taken = pm_layout_find(&part->layout, name) != NULL;
    for (int k = 0; k < i; ++k) {
        taken = taken || strcmp(part->spec.derived[k].name, name) == 0;
    }
    if (taken || strlen(name) >= PM_MAX_NAME) {
        return pm_fail(PM_ECONFIG, "derived variable %.64s: its name is %s", name,
                       taken ? "that of a group, or of another one" : "too long");
    }
    return PM_OK;
}

static pm_status declare(const pm_derived_spec *derived, const pm_layout *layout,
                         pm_params *params) {
    const pm_matrix_spec *matrix = &derived->matrix;
    int cols;
    PM_TRY(check_groups(derived, layout, &cols));
    if (cols == 0 || derived->size > MOST_NUMBERS / cols) {
        return pm_fail(PM_ECONFIG,
                       "derived variable %s: a matrix of %d x %d, expected 1 to %d numbers",
                       derived->name, derived->size, cols, MOST_NUMBERS);
    }
    if (matrix->value != NULL && (matrix->rows != derived->size || matrix->cols != cols)) {
        return pm_fail(PM_ECONFIG, "derived variable %s: the matrix is %d x %d, expected %d x %d",
                       derived->name, matrix->rows, matrix->cols, derived->size, cols);
    }
    entry_name name;
    const bool kept = matrix->value == NULL;
    snprintf(name, sizeof name, "derived.%s.matrix", derived->name);
    PM_TRY(pm_params_add(params, name, derived->size, cols, false, 0, NAN));
    snprintf(name, sizeof name, "derived.%s.offset", derived->name);
    PM_TRY(pm_params_add(params, name, 1, derived->size, false, 0, kept ? NAN : 0));
    if (!kept) {
        memcpy(entry_of(params, derived, "matrix")->value, matrix->value,
               (size_t)derived->size * (size_t)cols * sizeof(double));
    }
    if (derived->offset != NULL) {
        memcpy(entry_of(params, derived, "offset")->value, derived->offset,
               (size_t)derived->size * sizeof(double));
    }
    return PM_OK;
}

pm_status pm_derived_declare(pm_part *part) {
    for (int i = 0; i < part->spec.nderived; ++i) {
        const pm_derived_spec *derived = &part->spec.derived[i];
        PM_TRY(pm_spec_locate(derived->at, check_name(part, i)));
        PM_TRY(pm_spec_locate(derived->at, declare(derived, &part->layout, &part->params)));
    }
    return PM_OK;
}

// --- building ---

static int position_of(const pm_symbols *symbols, const char *name) {
    int i = 0;
    while (strcmp(symbols->symbol[i].name, name) != 0) {
        ++i;
        assert(i < symbols->count);
    }
    return i;
}

// Returns the groups of a derived variable side by side.
static pm_node join(pm_graph *g, const pm_derived_spec *derived, const pm_symbols *symbols) {
    pm_node part[PM_MAX_GROUPS];
    for (int i = 0; i < derived->ngroup; ++i) {
        part[i] = symbols->symbol[position_of(symbols, derived->group[i])].node;
    }
    return pm_concat(g, derived->ngroup, part);
}

void pm_derived_add(const pm_part *part, pm_graph *g, pm_symbols *symbols) {
    for (int i = 0; i < part->spec.nderived; ++i) {
        const pm_derived_spec *derived = &part->spec.derived[i];
        pm_node node = PM_NO_NODE;
        if (g != NULL) {
            node = pm_add(g,
                          pm_matmul(g, join(g, derived, symbols), false,
                                    node_of(g, &part->params, derived, "matrix"), true),
                          node_of(g, &part->params, derived, "offset"));
        }
        pm_symbols_add_one(symbols, derived->name, derived->size, node);
    }
}

void pm_derived_pull(const pm_part *part, pm_graph *g, pm_node *covector) {
    for (int i = 0; i < part->spec.nderived; ++i) {
        const pm_derived_spec *derived = &part->spec.derived[i];
        const pm_node own = covector[part->layout.ngroup + i];
        if (own == PM_NO_NODE) {
            continue;
        }
        const pm_node all =
            pm_matmul(g, own, false, node_of(g, &part->params, derived, "matrix"), false);
        int first = 0;
        for (int k = 0; k < derived->ngroup; ++k) {
            const pm_group *group = pm_layout_find(&part->layout, derived->group[k]);
            pm_node *sum = &covector[group - part->layout.group];
            *sum = pm_add_or(g, *sum, pm_slice(g, all, first, group->size));
            first += group->size;
        }
    }
}

// --- bounds of their change ---

// Returns the radii of a derived variable's groups side by side; PM_NO_NODE if no group moves.
static pm_node join_spreads(const pm_part *part, pm_graph *g, const pm_derived_spec *derived,
                            const pm_node *radius) {
    pm_node side[PM_MAX_GROUPS];
    bool moves = false;
    for (int i = 0; i < derived->ngroup; ++i) {
        const pm_group *group = pm_layout_find(&part->layout, derived->group[i]);
        const pm_node own = radius[group - part->layout.group];
        side[i] = own == PM_NO_NODE ? pm_constant(g, 0, 1, group->size) : own;
        moves = moves || own != PM_NO_NODE;
    }
    return moves ? pm_concat(g, derived->ngroup, side) : PM_NO_NODE;
}

void pm_derived_spread(const pm_part *part, pm_graph *g, const pm_symbols *symbols,
                       pm_node *radius) {
    const int ngroup = part->layout.ngroup;
    for (int i = 0; i < ngroup; ++i) {
        if (radius[i] != PM_NO_NODE) {
            const pm_node size = pm_magnitude(g, symbols->symbol[i].node);
            radius[i] = pm_add(g, radius[i], pm_scale(g, size, PM_DERIVED_ROUNDING));
        }
    }
    for (int i = 0; i < part->spec.nderived; ++i) {
        const pm_derived_spec *derived = &part->spec.derived[i];
        const pm_node moves = join_spreads(part, g, derived, radius);
        radius[ngroup + i] = PM_NO_NODE;
        if (moves != PM_NO_NODE) {
            const pm_node values = pm_magnitude(g, join(g, derived, symbols));
            const pm_node matrix = pm_magnitude(g, node_of(g, &part->params, derived, "matrix"));
            const pm_node offset = pm_magnitude(g, node_of(g, &part->params, derived, "offset"));
            // Values of groups that do not move are rounded too.
            const pm_node most = pm_add(g, moves, pm_scale(g, values, PM_DERIVED_ROUNDING));
            radius[ngroup + i] = pm_add(g, pm_matmul(g, most, false, matrix, true),
                                        pm_scale(g, offset, PM_DERIVED_ROUNDING));
        }
    }
}
