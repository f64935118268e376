// Builds the values of formulas and their discrete derivatives.
#include "model/formula_steps.h"

#define HALVINGS 8 // of an angle, so that the series begins at less than 0.01 for |h| < 2.5

// --- building ---

static pm_node build_step(pm_graph *g, const pm_step *s, const pm_symbols *symbols,
                          const pm_node *value) {
    switch (s->kind) {
    case PM_STEP_NUMBER:
        return pm_constant(g, s->number, 1, 1);
    case PM_STEP_FEATURE:
        return s->component == PM_STEP_WHOLE
                   ? pm_feature_build(g, s->feature, symbols)
                   : pm_slice(g, pm_feature_build(g, s->feature, symbols), s->component, 1);
    case PM_STEP_ADD:
        return pm_add(g, value[s->a], value[s->b]);
    case PM_STEP_SUBTRACT:
        return pm_sub(g, value[s->a], value[s->b]);
    case PM_STEP_MULTIPLY:
        return pm_mul(g, value[s->a], value[s->b]);
    case PM_STEP_DIVIDE:
        return pm_div(g, value[s->a], value[s->b]);
    case PM_STEP_EXP:
        return pm_exp(g, value[s->a]);
    case PM_STEP_LN:
        return pm_log(g, value[s->a]);
    case PM_STEP_NEGATIVE_SQUARED:
        return pm_negative_squared(g, value[s->a]);
    case PM_STEP_SIN:
        return pm_sin(g, value[s->a]);
    case PM_STEP_COS:
        return pm_cos(g, value[s->a]);
    case PM_STEP_SQRT:
        break;
    }
    return pm_sqrt(g, value[s->a]);
}

void pm_formula_build_steps(pm_graph *g, const pm_formula_steps *steps, const pm_symbols *symbols,
                            pm_node *value) {
    for (int i = 0; i < steps->count; ++i) {
        value[i] = build_step(g, &steps->step[i], symbols, value);
    }
}

pm_node pm_formula_build(pm_graph *g, const pm_formula *formula, const pm_symbols *symbols) {
    pm_formula_steps steps;
    pm_node value[PM_MAX_STEPS];
    pm_formula_read_again(&steps, formula, symbols);
    pm_formula_build_steps(g, &steps, symbols, value);
    return value[steps.whole];
}

// --- discrete derivatives ---

static pm_node mean(pm_graph *g, pm_node from, pm_node to) {
    return pm_scale(g, pm_add(g, from, to), 0.5);
}

// Returns the divided difference of sin or cos between a and b, which is that function's derivative
// in the middle times sin(h)/h with h = (b - a)/2. Viete's product of cos(h/2^k) gives the latter
// also at h = 0; what is left of it after HALVINGS factors is a short series.
static pm_node trigonometric_difference(pm_graph *g, pm_step_kind kind, pm_node a, pm_node b) {
    pm_node h = pm_scale(g, pm_sub(g, b, a), 0.5);
    const pm_node middle = mean(g, a, b);
    pm_node slope = kind == PM_STEP_SIN ? pm_cos(g, middle) : pm_scale(g, pm_sin(g, middle), -1);
    for (int k = 0; k < HALVINGS; ++k) {
        h = pm_scale(g, h, 0.5);
        slope = pm_mul(g, slope, pm_cos(g, h));
    }
    const pm_node square = pm_square(g, h);
    const pm_node series =
        pm_offset(g, pm_mul(g, square, pm_offset(g, pm_scale(g, square, 1.0 / 120), -1.0 / 6)), 1);
    return pm_mul(g, slope, series);
}

// Computes the slopes of a step between two states: change = slope[0] change_a + slope[1] change_b.
static void divided_difference(pm_graph *g, const pm_step *s, pm_node own_from, pm_node own_to,
                               const pm_node *from, const pm_node *to, pm_node slope[2]) {
    const pm_node one = pm_constant(g, 1, 1, 1);
    const pm_node a_from = from[s->a], a_to = to[s->a], b_from = from[s->b], b_to = to[s->b];
    slope[0] = one;
    slope[1] = PM_NO_NODE;
    switch (s->kind) {
    case PM_STEP_ADD:
        slope[1] = one;
        break;
    case PM_STEP_SUBTRACT:
        slope[1] = pm_constant(g, -1, 1, 1);
        break;
    case PM_STEP_MULTIPLY:
        slope[0] = mean(g, b_from, b_to);
        slope[1] = mean(g, a_from, a_to);
        break;
    case PM_STEP_DIVIDE:
        slope[0] = mean(g, pm_div(g, one, b_from), pm_div(g, one, b_to));
        slope[1] = pm_scale(g, pm_div(g, mean(g, a_from, a_to), pm_mul(g, b_from, b_to)), -1);
        break;
    case PM_STEP_EXP:
        slope[0] = pm_div(g, one, pm_inverse_logarithmic_mean(g, own_from, own_to));
        break;
    case PM_STEP_LN:
        slope[0] = pm_inverse_logarithmic_mean(g, a_from, a_to);
        break;
    case PM_STEP_SQRT:
        slope[0] = pm_div(g, one, pm_add(g, own_from, own_to));
        break;
    case PM_STEP_SIN:
    case PM_STEP_COS:
        slope[0] = trigonometric_difference(g, s->kind, a_from, a_to);
        break;
    case PM_STEP_NEGATIVE_SQUARED:
        slope[0] = pm_negative_squared_slope(g, a_from, a_to);
        break;
    case PM_STEP_NUMBER:
    case PM_STEP_FEATURE:
        break;
    }
}

// Adds `more` to the weight of an operand; an operand of one component receives the sum of `more`.
static pm_node add_weight(pm_graph *g, pm_node weight, pm_node more, int width) {
    const pm_shape shape = {pm_graph_shape(g, more).batched, 1, width};
    return pm_add_or(g, weight, width == 1 ? pm_sum_to(g, more, shape) : more);
}

void pm_formula_discrete(pm_graph *g, const pm_formula *formula, const pm_symbols *from,
                         const pm_symbols *to, pm_node *covector) {
    pm_formula_steps steps;
    pm_node before[PM_MAX_STEPS], after[PM_MAX_STEPS], weight[PM_MAX_STEPS];
    pm_formula_read_again(&steps, formula, from);
    pm_formula_build_steps(g, &steps, from, before);
    pm_formula_build_steps(g, &steps, to, after);
    for (int i = 0; i < steps.count; ++i) {
        weight[i] = i == steps.whole ? pm_constant(g, 1, 1, 1) : PM_NO_NODE;
    }
    for (int i = steps.whole; i >= 0; --i) {
        const pm_step *s = &steps.step[i];
        if (weight[i] == PM_NO_NODE || s->kind == PM_STEP_NUMBER) {
            continue;
        }
        if (s->kind == PM_STEP_FEATURE) {
            const char *feature = s->feature;
            const pm_node placed = s->component == PM_STEP_WHOLE
                                       ? weight[i]
                                       : pm_place(g, weight[i], s->component, s->size);
            pm_features_discrete(g, 1, &feature, from, to, placed, covector);
            continue;
        }
        pm_node slope[2];
        divided_difference(g, s, before[i], after[i], before, after, slope);
        for (int k = 0; k < 2 && slope[k] != PM_NO_NODE; ++k) {
            const int operand = k == 0 ? s->a : s->b;
            weight[operand] = add_weight(g, weight[operand], pm_mul(g, weight[i], slope[k]),
                                         steps.step[operand].width);
        }
    }
}
