// Comparing and searching layouts of named groups, and adding the place of a spec to an error.
#include <string.h>

#include "model/spec.h"

const pm_group *pm_layout_find(const pm_layout *layout, const char *name) {
    for (int i = 0; i < layout->ngroup; ++i) {
        if (strcmp(layout->group[i].name, name) == 0) {
            return &layout->group[i];
        }
    }
    return NULL;
}

bool pm_group_equal(const pm_group *a, const pm_group *b) {
    return strcmp(a->name, b->name) == 0 && strcmp(a->unit, b->unit) == 0 && a->size == b->size;
}

bool pm_layout_equal(const pm_layout *a, const pm_layout *b) {
    if (a->ngroup != b->ngroup || a->nz != b->nz) {
        return false;
    }
    for (int i = 0; i < a->ngroup; ++i) {
        if (!pm_group_equal(&a->group[i], &b->group[i])) {
            return false;
        }
    }
    return true;
}

pm_status pm_spec_locate(const char *at, pm_status status) {
    return status == PM_ECONFIG && at != NULL ? pm_fail(status, "%s: %s", at, pm_error()) : status;
}
