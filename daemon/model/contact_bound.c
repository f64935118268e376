// Finds the sums |min(x,0)|^2 in a part's formulas and bounds every x over a box of states.
#include "model/contact_bound.h"

#include <stdio.h>
#include <string.h>

#include "model/formula_steps.h"
#include "model/potential.h"

#define MOST_SUMS 8

// --- what is unconstrained ---

// Returns the number of the derived variable x if the step reads |min(x,0)|^2 as a feature; else
// -1.
static int find_derived(const pm_part *part, const pm_step *s, const pm_symbols *symbols) {
    const int end = part->layout.ngroup + part->spec.nderived;
    for (int i = part->layout.ngroup; i < end && s->kind == PM_STEP_FEATURE; ++i) {
        char squared[PM_MAX_STEP_FEATURE];
        snprintf(squared, sizeof squared, "|min(%s,0)|^2", symbols->symbol[i].name);
        if (strcmp(s->feature, squared) == 0) {
            return i;
        }
    }
    return -1;
}

static bool is_number(const pm_formula_steps *f, int at) {
    return f->step[at].kind == PM_STEP_NUMBER;
}

// Returns the position of the step |min(x,0)|^2 if the formula is a number times such a sum; else
// -1. A sum over a group x does not count: evaluating it costs no more than checking its bound.
static int find_sum(const pm_part *part, const pm_formula_steps *f, const pm_symbols *symbols) {
    int at = f->whole;
    for (;;) {
        const pm_step *s = &f->step[at];
        if (s->kind == PM_STEP_MULTIPLY && is_number(f, s->a)) {
            at = s->b;
        } else if ((s->kind == PM_STEP_MULTIPLY || s->kind == PM_STEP_DIVIDE) &&
                   is_number(f, s->b)) {
            at = s->a;
        } else {
            break;
        }
    }
    const pm_step *s = &f->step[at];
    return s->kind == PM_STEP_NEGATIVE_SQUARED || find_derived(part, s, symbols) >= 0 ? at : -1;
}

static bool is_sum(const pm_part *part, const pm_formula *formula, const pm_symbols *symbols) {
    pm_formula_steps steps;
    pm_formula_read_again(&steps, formula, symbols);
    return find_sum(part, &steps, symbols) >= 0;
}

// Returns true if a potential depends on the group through another expression than such sums.
static bool depends_otherwise(const pm_part *part, const pm_potential_spec *potential,
                              const pm_symbols *symbols, const char *group) {
    pm_potential_spec others = *potential;
    others.nformula = 0;
    bool depends = pm_part_depends(part, &others, group);
    for (int i = 0; i < potential->nformula; ++i) {
        const pm_potential_spec alone = {.nformula = 1, .formula = &potential->formula[i]};
        depends = depends || (pm_part_depends(part, &alone, group) &&
                              !is_sum(part, &potential->formula[i], symbols));
    }
    return depends;
}

// --- bounds ---

// Adds the rounding of operands of this size to a spread, unless the spread is PM_NO_NODE.
static pm_node add_rounding(pm_graph *g, pm_node spread, pm_node size) {
    return spread == PM_NO_NODE ? spread : pm_add(g, spread, pm_scale(g, size, PM_PART_ROUNDING));
}

// Bounds the change of one step of a formula. False if there is no bound.
static bool bound_step(pm_graph *g, const pm_step *s, const pm_symbols *symbols,
                       const pm_node *radius, const pm_node *value, const pm_node *spread,
                       pm_node *result) {
    *result = PM_NO_NODE;
    switch (s->kind) {
    case PM_STEP_NUMBER:
        return true;
    case PM_STEP_FEATURE:
        for (int i = 0; i < symbols->count; ++i) {
            const char *name = symbols->symbol[i].name;
            if (radius[i] == PM_NO_NODE || !pm_feature_mentions(s->feature, name)) {
                continue;
            }
            if (strcmp(s->feature, name) != 0) {
                return false; // an expression of an unconstrained group
            }
            *result =
                s->component == PM_STEP_WHOLE ? radius[i] : pm_slice(g, radius[i], s->component, 1);
        }
        return true;
    case PM_STEP_ADD:
    case PM_STEP_SUBTRACT:
        *result =
            add_rounding(g, pm_add_or(g, spread[s->a], spread[s->b]),
                         pm_add(g, pm_magnitude(g, value[s->a]), pm_magnitude(g, value[s->b])));
        return true;
    case PM_STEP_MULTIPLY: // |a| spread_b + |b| spread_a + spread_a spread_b
        if (spread[s->b] != PM_NO_NODE) {
            *result = pm_mul(g, pm_magnitude(g, value[s->a]), spread[s->b]);
        }
        if (spread[s->a] != PM_NO_NODE) {
            *result = pm_add_or(g, *result, pm_mul(g, pm_magnitude(g, value[s->b]), spread[s->a]));
        }
        if (spread[s->a] != PM_NO_NODE && spread[s->b] != PM_NO_NODE) {
            *result = pm_add(g, *result, pm_mul(g, spread[s->a], spread[s->b]));
        }
        *result = add_rounding(g, *result, pm_magnitude(g, pm_mul(g, value[s->a], value[s->b])));
        return true;
    default:
        return spread[s->a] == PM_NO_NODE && spread[s->b] == PM_NO_NODE;
    }
}

// Returns x and its spread for a formula that is such a sum; the spread is PM_NO_NODE if x does not
// depend on unconstrained groups. False if there is no bound.
static bool bound_formula(pm_graph *g, const pm_part *part, const pm_formula *formula,
                          const pm_symbols *symbols, const pm_node *radius, pm_node *value,
                          pm_node *spread) {
    pm_formula_steps f;
    pm_node values[PM_MAX_STEPS], spreads[PM_MAX_STEPS];
    pm_formula_read_again(&f, formula, symbols);
    const int sum = find_sum(part, &f, symbols),
              derived = find_derived(part, &f.step[sum], symbols);
    if (derived >= 0) {
        *value = symbols->symbol[derived].node;
        *spread = radius[derived];
        return true;
    }
    pm_formula_build_steps(g, &f, symbols, values);
    const int x = f.step[sum].a;
    for (int i = 0; i <= x; ++i) {
        if (!bound_step(g, &f.step[i], symbols, radius, values, spreads, &spreads[i])) {
            return false;
        }
    }
    *value = values[x];
    *spread = spreads[x] == PM_NO_NODE ? PM_NO_NODE
                                       : pm_broadcast_to(g, spreads[x], pm_graph_shape(g, *value));
    return true;
}

bool pm_contact_bound_build(pm_graph *g, const pm_part *part, pm_node z, pm_node width,
                            bool *unconstrained, pm_node *value, pm_node *spread) {
    const pm_potential_spec *potential[2] = {&part->spec.energy, &part->spec.entropy};
    const pm_symbols symbols = pm_part_symbols(part, g, z);
    pm_node radius[PM_MAX_SYMBOLS], values[MOST_SUMS], spreads[MOST_SUMS];
    int count = 0;
    bool any = false;
    const bool bounded = part->spec.form != PM_FREE && !pm_part_has_coenergies(part);
    for (int i = 0; i < part->layout.ngroup && bounded; ++i) {
        const pm_group *group = &part->layout.group[i];
        bool depends = false, otherwise = false;
        for (int p = 0; p < 2; ++p) {
            depends = depends || pm_part_depends(part, potential[p], group->name);
            otherwise = otherwise || depends_otherwise(part, potential[p], &symbols, group->name);
        }
        const bool is_unconstrained = depends && !otherwise;
        for (int k = group->first; k < group->first + group->size; ++k) {
            unconstrained[k] = is_unconstrained;
        }
        radius[i] = is_unconstrained ? pm_slice(g, width, group->first, group->size) : PM_NO_NODE;
        any = any || is_unconstrained;
    }
    if (!any) {
        return false;
    }
    pm_part_spread(part, g, &symbols, radius);
    for (int p = 0; p < 2; ++p) {
        for (int i = 0; i < potential[p]->nformula; ++i) {
            const pm_formula *formula = &potential[p]->formula[i];
            if (!is_sum(part, formula, &symbols)) {
                continue;
            }
            if (count == MOST_SUMS || !bound_formula(g, part, formula, &symbols, radius,
                                                     &values[count], &spreads[count])) {
                return false;
            }
            count += spreads[count] != PM_NO_NODE;
        }
    }
    if (count == 0) {
        return false;
    }
    *value = pm_concat(g, count, values);
    *spread = pm_concat(g, count, spreads);
    return true;
}
