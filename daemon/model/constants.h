// The constants of formulas that training learns. Each is a parameter "constant.<name>" [1][1],
// which holds the value or, for a positive constant, its logarithm. Formulas name it as a symbol of
// one component. Known constants are folded into formulas when these are read; they are neither
// parameters nor symbols.
#ifndef PM_MODEL_CONSTANTS_H
#define PM_MODEL_CONSTANTS_H

#include <string.h>

#include "model/feature.h"
#include "model/params.h"

#define PM_CONSTANT_PREFIX "constant."

// Returns the name of the constant that a parameter holds; NULL: it holds none.
static inline const char *pm_constant_name(const char *parameter) {
    const size_t length = strlen(PM_CONSTANT_PREFIX);
    return strncmp(parameter, PM_CONSTANT_PREFIX, length) == 0 ? parameter + length : NULL;
}

// Declares the parameters of all learned constants, with their starting values. `constants` may be
// NULL. PM_ECONFIG: there are too many; PM_ENOMEM.
pm_status pm_constants_declare(const pm_constants *constants, pm_params *params);

// Adds every learned constant to the symbols, with its value [1][1] as a node of g. g is NULL while
// a spec is only being checked; the symbols then have no nodes.
void pm_constants_add(const pm_constants *constants, pm_graph *g, const pm_params *params,
                      pm_symbols *symbols);

#endif
