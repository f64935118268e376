// A formula as it was read: a list of steps, operands before what is made of them. For those who
// make graphs of it (formula.c, contact_bound.c).
#ifndef PM_MODEL_FORMULA_STEPS_H
#define PM_MODEL_FORMULA_STEPS_H

#include "model/formula.h"

#define PM_MAX_STEPS 128
#define PM_MAX_STEP_FEATURE (2 * PM_MAX_NAME + 8)

typedef enum pm_step_kind {
    PM_STEP_NUMBER,
    PM_STEP_FEATURE, // component `component` of one
    PM_STEP_ADD,
    PM_STEP_SUBTRACT,
    PM_STEP_MULTIPLY,
    PM_STEP_DIVIDE,
    PM_STEP_EXP,
    PM_STEP_LN,
    PM_STEP_SQRT,
    PM_STEP_NEGATIVE_SQUARED // sum over the components
} pm_step_kind;

#define PM_STEP_WHOLE (-1) // a feature's component: all of them

typedef struct pm_step {
    pm_step_kind kind;
    int width; // components of the result
    int a, b;  // operands, by position
    double number;
    char feature[PM_MAX_STEP_FEATURE];
    int component, size; // of the feature
} pm_step;

typedef struct pm_formula_steps {
    int count, whole; // whole: position of the last operation
    pm_step step[PM_MAX_STEPS];
} pm_formula_steps;

// PM_ECONFIG: as pm_formula_check, without the formula's place.
pm_status pm_formula_read(pm_formula_steps *steps, const pm_formula *formula,
                          const pm_symbols *symbols);
// The same for a formula that has passed pm_formula_check; and the value of each step, value
// [count].
void pm_formula_read_again(pm_formula_steps *steps, const pm_formula *formula,
                           const pm_symbols *symbols);
void pm_formula_build_steps(pm_graph *g, const pm_formula_steps *steps, const pm_symbols *symbols,
                            pm_node *value);

#endif
