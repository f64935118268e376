// A formula after reading is a list of operations, in which operands come before their result.
// formula.c makes the list; formula.c and contact_bound.c build graphs from it.
#ifndef PM_MODEL_FORMULA_STEPS_H
#define PM_MODEL_FORMULA_STEPS_H

#include "model/formula.h"

#define PM_MAX_STEPS 2000
#define PM_MAX_STEP_FEATURE (2 * PM_MAX_NAME + 8)

typedef enum pm_step_kind {
    PM_STEP_NUMBER,
    PM_STEP_FEATURE, // one component of a feature, or all of them
    PM_STEP_ADD,
    PM_STEP_SUBTRACT,
    PM_STEP_MULTIPLY,
    PM_STEP_DIVIDE,
    PM_STEP_EXP, // the functions of one number, up to PM_STEP_COS
    PM_STEP_LN,
    PM_STEP_SQRT,
    PM_STEP_SIN,
    PM_STEP_COS,
    PM_STEP_NEGATIVE_SQUARED // |min(a,0)|^2, summed over the components of a
} pm_step_kind;

#define PM_STEP_WHOLE (-1) // a component that stands for all components of a feature

typedef struct pm_step {
    pm_step_kind kind;
    int width;                         // components of the result
    int a, b;                          // positions of the operands
    double number;                     // PM_STEP_NUMBER: its value
    char feature[PM_MAX_STEP_FEATURE]; // PM_STEP_FEATURE: its text
    int component, size; // PM_STEP_FEATURE: one component or PM_STEP_WHOLE; their number
} pm_step;

typedef struct pm_formula_steps {
    // `whole` is the position of the last operation, whose result is the value of the formula.
    int count, whole;
    pm_step step[PM_MAX_STEPS];
} pm_formula_steps;

// Reads a formula that has passed pm_formula_check, which cannot fail.
void pm_formula_read_again(pm_formula_steps *steps, const pm_formula *formula,
                           const pm_symbols *symbols);
// Builds the value [1][width] of every step: value [steps->count].
void pm_formula_build_steps(pm_graph *g, const pm_formula_steps *steps, const pm_symbols *symbols,
                            pm_node *value);

#endif
