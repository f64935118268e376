// Which groups of a site an operator touches, and which of them take up heat.
#include "model/support.h"

#include <string.h>

#include "model/given_pair.h"

bool pm_support_is_heated(const pm_operator_spec *spec, const pm_site *site,
                          const pm_site_group *group) {
    if (spec->nheats > 0) {
        return pm_is_listed(spec->nheats, spec->heats, group->name);
    }
    bool difference = false;
    for (int i = 0; i < spec->ngiven && group->entropy; ++i) {
        difference = difference || pm_given_is_difference(spec, i, site);
    }
    return difference;
}

int pm_support_heats(const pm_operator_spec *spec, const pm_site *site) {
    int count = 0;
    for (int i = 0; i < site->ngroup; ++i) {
        const bool heated = pm_is_listed(spec->nheats, spec->heats, site->group[i].name);
        count += heated ? site->group[i].size : 0;
    }
    return count;
}

// If a single entropy takes up all the heat, its rate follows from the rates of the other
// variables, and the learned factor has no row for it.
static bool is_idle(const pm_operator_spec *spec, const pm_site *site, const char *name) {
    return pm_is_listed(spec->nheats, spec->heats, name) && pm_support_heats(spec, site) == 1;
}

pm_support pm_support_of(const pm_operator_spec *spec, bool irreversible, const pm_site *site) {
    pm_support s = {0};
    for (int i = 0; i < site->ngroup; ++i) {
        const pm_site_group *group = &site->group[i];
        const bool learned =
            spec->learned && (pm_is_listed(spec->nacts, spec->acts_on, group->name) ||
                              pm_is_listed(spec->nagainst, spec->against, group->name));
        if (learned || pm_given_names(spec, group->name) ||
            (irreversible && pm_support_is_heated(spec, site, group))) {
            s.group[s.ngroup] = group;
            s.learned[s.ngroup] = learned && !is_idle(spec, site, group->name);
            s.first[s.ngroup++] = s.n;
            s.n += group->size;
        }
    }
    return s;
}

int pm_support_find(const pm_support *s, const char *name) {
    int i = 0;
    while (i < s->ngroup && strcmp(s->group[i]->name, name) != 0) {
        ++i;
    }
    return i;
}
