// The support of an operator: the groups of a site that it touches, side by side. An operator is
// built over its support, and its rate is then placed into the site.
#ifndef PM_MODEL_SUPPORT_H
#define PM_MODEL_SUPPORT_H

#include "model/site.h"

// The groups stand in the order of the site. Borrowed from the site.
typedef struct pm_support {
    int ngroup;
    const pm_site_group *group[2 * PM_MAX_GROUPS];
    bool learned[2 * PM_MAX_GROUPS]; // the learned matrix has rows for this group
    int first[2 * PM_MAX_GROUPS];    // position of its first component in the support
    int n;                           // components of all groups
} pm_support;

// Returns the support of an operator. A group belongs to it if acts_on or against lists it, if a
// given pair names it, or if it takes up heat of an irreversible operator. The learned matrix has
// rows for the listed groups, except for a single entropy that takes up all the heat
// (dissipation.h): its rate follows from the others.
pm_support pm_support_of(const pm_operator_spec *spec, bool irreversible, const pm_site *site);
// Returns the position of a group in the support, or support->ngroup if it is not there.
int pm_support_find(const pm_support *support, const char *name);

// Returns true if heat of an irreversible operator goes into this group: `heats` lists it, or,
// where `heats` is empty, it is an entropy and some given pair is friction by a difference
// (spec.h).
bool pm_support_is_heated(const pm_operator_spec *spec, const pm_site *site,
                          const pm_site_group *group);
// Returns the number of components of all groups that `heats` lists.
int pm_support_heats(const pm_operator_spec *spec, const pm_site *site);

#endif
