// Constants of formulas that training learns, as parameters "constant.<name>" [1][1] and as symbols
// of one component: the value, or of a positive one its logarithm. Known constants are folded into
// formulas when these are read, and do not appear here.
#ifndef PM_MODEL_CONSTANTS_H
#define PM_MODEL_CONSTANTS_H

#include "model/feature.h"
#include "model/params.h"

// Declares those that are learned. PM_ECONFIG: too many; PM_ENOMEM.
pm_status pm_constants_declare(const pm_constants *constants, pm_params *params);

// Adds each learned constant as a symbol; g is NULL while a spec is only being checked.
void pm_constants_add(const pm_constants *constants, pm_graph *g, const pm_params *params,
                      pm_symbols *symbols);

#endif
