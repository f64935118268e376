// Names in given pairs, and the kind of a pair.
#include "model/given_pair.h"

#include <stdlib.h>
#include <string.h>

bool pm_given_split(const char *name, char group[PM_MAX_NAME], int *component) {
    const char *bracket = strchr(name, '[');
    const size_t length = bracket == NULL ? strlen(name) : (size_t)(bracket - name);
    if (length == 0 || length >= PM_MAX_NAME) {
        return false;
    }
    memcpy(group, name, length);
    group[length] = '\0';
    *component = -1;
    if (bracket == NULL) {
        return true;
    }
    const size_t digits = strspn(bracket + 1, "0123456789");
    *component = digits > 0 && digits <= 6 ? atoi(bracket + 1) : -1;
    return *component >= 0 && strcmp(bracket + 1 + digits, "]") == 0;
}

static bool is_of(const char *name, const char *group) {
    char own[PM_MAX_NAME];
    int component;
    return pm_given_split(name, own, &component) && strcmp(own, group) == 0;
}

bool pm_given_names(const pm_operator_spec *spec, const char *group) {
    for (int i = 0; i < spec->ngiven; ++i) {
        if (is_of(spec->given[i].row, group) || is_of(spec->given[i].col, group)) {
            return true;
        }
    }
    return false;
}

bool pm_given_takes_heat(const pm_operator_spec *spec, const pm_site_group *group) {
    return spec->nheats > 0 ? pm_is_listed(spec->nheats, spec->heats, group->name) : group->entropy;
}

bool pm_given_is_difference(const pm_operator_spec *spec, int i, const pm_site *site) {
    const pm_given_pair *pair = &spec->given[i];
    bool some = false, own = false;
    for (int k = 0; k < site->ngroup; ++k) {
        const bool heat = pm_given_takes_heat(spec, &site->group[k]);
        some = some || heat;
        own = own || (heat && (is_of(pair->row, site->group[k].name) ||
                               is_of(pair->col, site->group[k].name)));
    }
    return some && !own;
}
