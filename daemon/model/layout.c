// Layouts of named groups.
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

bool pm_layout_equal(const pm_layout *a, const pm_layout *b) {
    if (a->ngroup != b->ngroup || a->nz != b->nz) {
        return false;
    }
    for (int i = 0; i < a->ngroup; ++i) {
        const pm_group *x = &a->group[i], *y = &b->group[i];
        if (strcmp(x->name, y->name) != 0 || strcmp(x->unit, y->unit) != 0 || x->size != y->size) {
            return false;
        }
    }
    return true;
}
