// Derived variables of a state: offset + matrix * groups (spec.h). The potentials of a part read
// them like its groups. An example are the openings between the surfaces of two bodies, whose
// states are the amplitudes of a few modes. Matrix and offset are the parameters
// "derived.<name>.matrix" and "derived.<name>.offset".
#ifndef PM_MODEL_DERIVED_H
#define PM_MODEL_DERIVED_H

#include "model/part.h"

// Checks names, groups and sizes of all derived variables and declares their parameters. PM_ECONFIG
// with the place in the file, PM_ENOMEM.
pm_status pm_derived_declare(pm_part *part);

// Adds each derived variable as a symbol behind the part's groups, which must come first in
// `symbols`. g is NULL while a spec is only being checked.
void pm_derived_add(const pm_part *part, pm_graph *g, pm_symbols *symbols);

// Applies the chain rule: adds the covector of each derived variable, multiplied by the transposed
// matrix, to the covectors of its groups. `covector` holds one node per group, then one per derived
// variable in the order of pm_derived_add.
void pm_derived_pull(const pm_part *part, pm_graph *g, pm_node *covector);

// Bound of the rounding error of a sum, relative to the sum of magnitudes. It is a thousand times
// larger than double precision requires.
#define PM_DERIVED_ROUNDING 1e-12

// Bounds the change of the derived variables if each group g changes by at most radius[g] [1][size
// of group g], or not at all if radius[g] is PM_NO_NODE. Writes the bound of derived variable i,
// with its rounding errors, to radius[ngroup + i]. `symbols` are those of pm_part_symbols.
void pm_derived_spread(const pm_part *part, pm_graph *g, const pm_symbols *symbols,
                       pm_node *radius);

// Returns true if the derived variable depends on this group.
bool pm_derived_is_of(const pm_derived_spec *derived, const char *group);

#endif
