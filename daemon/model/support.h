// Where an operator acts: the groups of one state, or of both ends of a port side by side, and of
// these the ones that it touches.
#ifndef PM_MODEL_SUPPORT_H
#define PM_MODEL_SUPPORT_H

#include "model/feature.h"

// A site: all groups, and the symbols that features and formulas may use.
typedef struct pm_site_group {
    char name[PM_MAX_NAME];
    int first, size;
    bool entropy; // by its unit, J/K or a multiple of it
} pm_site_group;

typedef struct pm_site {
    int ngroup;
    pm_site_group group[2 * PM_MAX_GROUPS];
    int n; // components in all
    pm_symbols symbols;
} pm_site;

// Appends the groups of `layout` as "<prefix><group>".
void pm_site_add(pm_site *site, const pm_layout *layout, const char *prefix);

// The site's groups that an operator touches, in the site's order, side by side.
typedef struct pm_support {
    int ngroup;
    const pm_site_group *group[2 * PM_MAX_GROUPS];
    bool learned[2 * PM_MAX_GROUPS]; // in acts_on, and not idle
    int first[2 * PM_MAX_GROUPS];    // in the support
    int n;
} pm_support;

pm_support pm_support_of(const pm_operator_spec *spec, bool irreversible, const pm_site *site);
// The position of a group in the support; ngroup: not there.
int pm_support_find(const pm_support *support, const char *name);

// Whether an irreversible operator's heat goes into this group (spec.h).
bool pm_support_is_heated(const pm_operator_spec *spec, const pm_site *site,
                          const pm_site_group *group);
// Components of all groups that take up heat by the operator's `heats`.
int pm_support_heats(const pm_operator_spec *spec, const pm_site *site);

bool pm_is_listed(int count, const char *const *list, const char *name);

#endif
