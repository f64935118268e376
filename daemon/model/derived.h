// Images of a state (spec.h): what a part's potentials see of it beside its groups, such as the
// openings between two surfaces, which are many, of bodies that move in few modes. Their numbers
// are the parameters "derived.<name>.matrix" and "derived.<name>.offset".
#ifndef PM_MODEL_DERIVED_H
#define PM_MODEL_DERIVED_H

#include "model/part.h"

// Checks names, groups and sizes and declares the parameters. PM_ECONFIG, PM_ENOMEM.
pm_status pm_derived_declare(pm_part *part);

// Adds each image as a symbol, after the part's groups, which must be the first of `symbols`; g is
// NULL while a spec is only being checked.
void pm_derived_add(const pm_part *part, pm_graph *g, pm_symbols *symbols);

// Adds to the groups' covectors what those of the images, which follow them in the order of
// pm_derived_add, are with respect to the groups.
void pm_derived_pull(const pm_part *part, pm_graph *g, pm_node *covector);

// What rounding adds, relative to what is summed up: a thousand times more than doubles need.
#define PM_DERIVED_ROUNDING 1e-12

// Given by how much each group g changes at most, radius[g] [1][its size] (PM_NO_NODE: not at all),
// adds the same for the derived: radius[ngroup + i], and to all what rounding may add to a value.
// `symbols` are those of pm_part_symbols.
void pm_derived_spread(const pm_part *part, pm_graph *g, const pm_symbols *symbols,
                       pm_node *radius);

// Whether an image is one of this group.
bool pm_derived_is_of(const pm_derived_spec *derived, const char *group);

#endif
