// This header declares where an operator acts: its site, the groups of the site that its given
// pairs name, and its support.
//
// A site has the groups over which an operator or a rate acts, and the symbols that its expressions
// may read. The site of a part has the groups of its state, the site of a port the groups that both
// ends expose, side by side.
#ifndef PM_MODEL_SITE_H
#define PM_MODEL_SITE_H

#include "model/feature.h"

typedef struct pm_site_group {
    char name[PM_MAX_NAME]; // with the prefix of its end, such as "a.q"
    int first, size;        // components of the site
    int end;                // of a port: 0 for end a, 1 for end b; of a part: 0
    bool entropy;           // its role is that of an entropy
} pm_site_group;

typedef struct pm_site {
    int ngroup;
    pm_site_group group[2 * PM_MAX_GROUPS];
    int n; // components of all groups
    pm_symbols symbols;
} pm_site;

// Appends the groups of `layout` to the site as "<prefix><group>", as groups of this end. It adds
// no symbols (pm_symbols_add does).
void pm_site_add(pm_site *site, const pm_layout *layout, const char *prefix, int end);

// Returns true if the list [count] contains the name.
bool pm_is_listed(int count, const char *const *list, const char *name);

// --- groups that the given pairs of an operator name (pm_given_pair in spec.h) ---

// Returns true if some pair of the operator names the group or one of its components.
bool pm_given_names(const pm_operator_spec *spec, const char *group);
// --- the support: the groups of its site on which an operator acts, side by side ---
//
// The program builds an operator over its support, and then adds the operator's rate to the rates
// of the site's groups.

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
//   - the operator is irreversible, and the group takes up its heat: the key `heats` lists it, or
//     it is an entropy and some pair is friction by a difference.
// The learned matrix has rows for the groups of the first case. It has none for an entropy of one
// component that is the only group in `heats`: the rate of this entropy follows from the rates of
// the other groups (dissipation.h).
pm_support pm_support_of(const pm_operator_spec *spec, bool irreversible, const pm_site *site);

#endif
