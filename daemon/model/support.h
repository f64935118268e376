// The support of an operator: the groups of its site (site.h) on which the operator acts, side by
// side. The program builds an operator over its support, and then adds the operator's rate to the
// rates of the site's groups.
#ifndef PM_MODEL_SUPPORT_H
#define PM_MODEL_SUPPORT_H

#include "model/site.h"

// The groups have the order of the site, from which they are borrowed.
typedef struct pm_support {
    int ngroup; // the number of entries in the three arrays
    const pm_site_group *group[2 * PM_MAX_GROUPS];
    bool learned[2 * PM_MAX_GROUPS]; // the learned matrix has rows for this group
    int first[2 * PM_MAX_GROUPS];    // position of its first component in the support
    int n;                           // components of all groups
} pm_support;

// Returns the support of an operator. A group of the site belongs to the support in three cases:
//   - the operator has a learned matrix, and its keys `acts_on` or `against` list the group;
//   - one of the operator's known couplings (pm_given_pair in spec.h) names the group;
//   - the operator is irreversible, and the group takes up its heat (pm_support_is_heated).
// The learned matrix has rows for the groups of the first case. It has none for an entropy of one
// component that is the only group in `heats`: the rate of this entropy follows from the rates of
// the other groups (dissipation.h).
pm_support pm_support_of(const pm_operator_spec *spec, bool irreversible, const pm_site *site);
// Returns the position of the group `name` in the support, or support->ngroup if it is not there.
int pm_support_find(const pm_support *support, const char *name);

// Returns true if the group takes up heat of the irreversible operator `spec`. If the operator's
// key `heats` lists groups, these take up the heat. If `heats` is empty, all entropies take up the
// heat of friction by the difference of two flows; they take up none if no known coupling of the
// operator is of this kind (pm_given_pair in spec.h).
bool pm_support_is_heated(const pm_operator_spec *spec, const pm_site *site,
                          const pm_site_group *group);
// Returns the number of components of all groups of the site that the operator's `heats` lists.
int pm_support_heats(const pm_operator_spec *spec, const pm_site *site);

#endif
