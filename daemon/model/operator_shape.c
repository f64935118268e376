// Rows and columns of the learned matrix of an operator.
#include "model/operator_shape.h"

#include <stdio.h>

int pm_operator_frame_rows(const pm_operator_spec *spec, int group_size) {
    return spec->nalong > 0 && group_size > 1 ? spec->nalong : group_size;
}

// Returns the rows of the frame in the groups of the list.
static int listed_rows(const pm_operator_spec *spec, const pm_support *s, int count,
                       const char *const *list) {
    int rows = 0;
    for (int i = 0; i < s->ngroup; ++i) {
        const bool counts = s->learned[i] && pm_is_listed(count, list, s->group[i]->name);
        rows += counts ? pm_operator_frame_rows(spec, s->group[i]->size) : 0;
    }
    return rows;
}

pm_operator_shape pm_operator_shape_of(const pm_operator *op, const pm_support *support) {
    const pm_operator_spec *spec = op->spec;
    const int rows = listed_rows(spec, support, spec->nacts, spec->acts_on);
    const int columns = op->kind == PM_IRREVERSIBLE ? spec->rank
                        : spec->nagainst > 0
                            ? listed_rows(spec, support, spec->nagainst, spec->against)
                            : rows;
    return (pm_operator_shape){rows, columns};
}

const char *pm_operator_join(pm_operator_name buffer, const char *prefix, const char *name) {
    snprintf(buffer, sizeof(pm_operator_name), "%s.%s", prefix, name);
    return buffer;
}
