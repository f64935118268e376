// Making, comparing and searching layouts of named groups, and adding the place of a spec to an
// error.
#include <string.h>

#include "base/digest.h"
#include "base/unit.h"
#include "model/spec.h"

// Returns the role of a group whose entropies would have the unit `entropy`.
static pm_role role_of(const char *unit, const char *entropy) {
    const pm_unit of_entropy = pm_unit_parse(entropy), own = pm_unit_parse(unit);
    return pm_unit_equal(&of_entropy, &own) ? PM_ROLE_ENTROPY : PM_ROLE_OTHER;
}

void pm_layout_add(pm_layout *layout, const char *name, const char *unit, int size) {
    layout->group[layout->ngroup++] = (pm_group){.name = name,
                                                 .unit = unit,
                                                 .size = size,
                                                 .first = layout->nz,
                                                 .role = role_of(unit, "J/K")};
    layout->nz += size;
}

void pm_layout_mark_coenergy(pm_layout *layout) {
    pm_group *group = &layout->group[layout->ngroup - 1];
    group->coenergy = true;
    group->role = role_of(group->unit, "K");
}

const pm_group *pm_layout_find(const pm_layout *layout, const char *name) {
    for (int i = 0; i < layout->ngroup; ++i) {
        if (strcmp(layout->group[i].name, name) == 0) {
            return &layout->group[i];
        }
    }
    return NULL;
}

bool pm_group_equal(const pm_group *a, const pm_group *b) {
    return strcmp(a->name, b->name) == 0 && strcmp(a->unit, b->unit) == 0 && a->size == b->size &&
           a->coenergy == b->coenergy;
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

uint64_t pm_layout_digest(const pm_layout *layout, uint64_t digest) {
    digest = pm_digest_integer(digest, layout->ngroup);
    for (int i = 0; i < layout->ngroup; ++i) {
        digest = pm_digest_text(digest, layout->group[i].name);
        digest = pm_digest_text(digest, layout->group[i].unit);
        digest = pm_digest_integer(digest, layout->group[i].size);
        if (layout->group[i].coenergy) {
            digest = pm_digest_text(digest, "coenergy");
        }
    }
    return digest;
}

pm_status pm_spec_locate(const char *at, pm_status status) {
    return status == PM_ECONFIG && at != NULL ? pm_fail(status, "%s: %s", at, pm_error()) : status;
}
