// The groups of a site, and lists of their names.
#include "model/site.h"

#include <stdio.h>
#include <string.h>

// "J/K", "kJ/K", ...
static bool is_entropy_unit(const char *unit) {
    const size_t length = unit == NULL ? 0 : strlen(unit);
    return length >= 3 && strcmp(unit + length - 3, "J/K") == 0;
}

void pm_site_add(pm_site *site, const pm_layout *layout, const char *prefix, int end) {
    for (int i = 0; i < layout->ngroup; ++i) {
        pm_site_group *group = &site->group[site->ngroup++];
        snprintf(group->name, sizeof group->name, "%s%s", prefix, layout->group[i].name);
        group->first = site->n;
        group->size = layout->group[i].size;
        group->end = end;
        group->entropy = is_entropy_unit(layout->group[i].unit);
        site->n += group->size;
    }
}

bool pm_is_listed(int count, const char *const *list, const char *name) {
    for (int i = 0; i < count; ++i) {
        if (strcmp(list[i], name) == 0) {
            return true;
        }
    }
    return false;
}
