// Readers of the parts of a `model:` block. Only the files that implement model_reader.h include
// this header. Each function reads one part into plain data of model/spec.h, which lives in the
// arena. All of them fail with PM_ECONFIG, naming the place in the file, or with PM_ENOMEM.
#ifndef PM_SCENE_MODEL_BLOCK_H
#define PM_SCENE_MODEL_BLOCK_H

#include "model/spec.h"
#include "store/yaml.h"

// The data that all readers of a block share.
typedef struct pm_model_context {
    pm_arena *arena;
    const pm_constants *constants; // that formulas may name
} pm_model_context;

// Returns true if a value is absent or the word "none".
bool pm_model_is_none(pm_yaml value);

// Reads the text of a formula. Its names are checked later (pm_formula_check).
pm_status pm_model_read_formula(pm_yaml text, const pm_model_context *r, pm_formula *formula);

// Reads `energy:` or `entropy:`: one summand or a list of them, each of them a formula, a linear
// form {given: ...} or a network. A value that is absent or "none" gives no summand.
pm_status pm_model_read_potential(pm_yaml value, const pm_model_context *r,
                                  pm_potential_spec *potential);

// Reads `reversible:` or `irreversible:`: given pairs, a learned operator, or both. A block that is
// absent or "none" gives no operator.
pm_status pm_model_read_operator(pm_yaml block, const pm_model_context *r, bool reversible,
                                 pm_operator_spec *op);

// Reads a matrix, row by row. If the list is absent, the matrix has no numbers. Its size is checked
// later against the groups that it couples.
pm_status pm_model_read_matrix(pm_yaml list, pm_arena *arena, pm_matrix_spec *matrix);

// Reads `derived:`, a mapping from names to derived variables, into spec->derived. If the mapping
// is absent there are none.
pm_status pm_model_read_derived(pm_yaml map, pm_arena *arena, pm_part_spec *spec);

#endif
