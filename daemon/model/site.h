// A site: the groups over which an operator or a rate acts, and the symbols that its expressions
// may read. The site of a part has the groups of its state, the site of a port the groups that both
// ends expose, side by side.
#ifndef PM_MODEL_SITE_H
#define PM_MODEL_SITE_H

#include "model/feature.h"

typedef struct pm_site_group {
    char name[PM_MAX_NAME]; // with the prefix of its end, such as "a.q"
    int first, size;        // components of the site
    int end;                // of a port: 0 for end a, 1 for end b; of a part: 0
    bool entropy;           // its unit is J/K or a multiple of it
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

#endif
