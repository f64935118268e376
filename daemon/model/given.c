// Given pairs: their checks, and the graphs of their rates.
#include "model/given.h"

#include <stddef.h>

#include "model/formula.h"

// The components of a support that a name in a pair stands for.
typedef struct place {
    int group, first, size; // group: position in the support, its ngroup where there is none
} place;

static place place_of(const pm_support *s, const char *name) {
    char group[PM_MAX_NAME];
    int component;
    place p = {s->ngroup, 0, 0};
    if (!pm_given_split(name, group, &component)) {
        return p;
    }
    const int at = pm_support_find(s, group);
    if (at == s->ngroup || component >= s->group[at]->size) {
        return p;
    }
    return (place){at, s->first[at] + (component > 0 ? component : 0),
                   component >= 0 ? 1 : s->group[at]->size};
}

// --- checks ---

static pm_status check_cross(const pm_given_pair *pair, const pm_site *site, place row, place col,
                             bool reversible, const char *what) {
    int size = 0;
    const bool fits = reversible && row.size == 3 && col.size == 3;
    return fits && pm_feature_size(pair->col, &site->symbols, &size) == PM_OK
               ? PM_OK
               : pm_fail(
                     PM_ECONFIG,
                     "%s: given pair [%s, %s, cross] must name groups of three components, in a "
                     "reversible operator",
                     what, pair->row, pair->col);
}

static pm_status check_pair(const pm_operator_spec *spec, int i, bool reversible,
                            const pm_site *site, const pm_support *s, const char *what) {
    const pm_given_pair *pair = &spec->given[i];
    const place row = place_of(s, pair->row), col = place_of(s, pair->col);
    const bool there = row.group < s->ngroup && col.group < s->ngroup;
    if (there && pair->cross) {
        return check_cross(pair, site, row, col, reversible, what);
    }
    const bool equal = reversible || pm_given_is_difference(spec, i, site);
    const bool same = row.group == col.group && row.first == col.first;
    if (!there || same || (reversible && row.group == col.group && row.size > 1) ||
        col.size != (equal ? row.size : 1)) {
        return pm_fail(PM_ECONFIG,
                       "%s: given pair [%s, %s] must name two groups here%s, or components such "
                       "as q[0]",
                       what, pair->row, pair->col,
                       equal ? " of equal size" : ", the second of one component");
    }
    if (!reversible && pair->coefficient < 0) {
        return pm_fail(PM_ECONFIG, "%s: given pair [%s, %s] has %g, expected a number >= 0", what,
                       pair->row, pair->col, pair->coefficient);
    }
    return PM_OK;
}

pm_status pm_given_check(const pm_operator_spec *spec, bool reversible, const pm_site *site,
                         const char *what) {
    const pm_support s = pm_support_of(spec, !reversible, site);
    for (int i = 0; i < spec->ngiven; ++i) {
        PM_TRY(check_pair(spec, i, reversible, site, &s, what));
    }
    return PM_OK;
}

// --- building ---

typedef struct builder {
    pm_graph *g;
    const pm_operator_spec *spec;
    const pm_site *site;
    const pm_support *support;
} builder;

static pm_node part_of(const builder *b, pm_node x, place p) {
    return pm_slice(b->g, x, p.first, p.size);
}

// Returns x times `sign` times the coefficient of a pair.
static pm_node multiply(const builder *b, const pm_given_pair *pair, double sign, pm_node x) {
    if (pair->formula.text == NULL) {
        return pm_scale(b->g, x, sign * pair->coefficient);
    }
    const pm_node coefficient = pm_formula_build(b->g, &pair->formula, &b->site->symbols);
    return pm_mul(b->g, pm_scale(b->g, coefficient, sign), x);
}

static pm_node add(const builder *b, pm_node rate, place p, pm_node into) {
    return pm_add_or(b->g, rate, pm_place(b->g, into, p.first, b->support->n));
}

static pm_node cross_product(pm_graph *g, pm_node a, pm_node b) {
    pm_node part[3];
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        part[i] = pm_sub(g, pm_mul(g, pm_slice(g, a, j, 1), pm_slice(g, b, k, 1)),
                         pm_mul(g, pm_slice(g, a, k, 1), pm_slice(g, b, j, 1)));
    }
    return pm_concat(g, 3, part);
}

static pm_node add_cross(const builder *b, pm_node rate, const pm_given_pair *pair, place row,
                         place col, pm_node d) {
    const pm_node z = pm_feature_build(b->g, pair->col, &b->site->symbols);
    rate = add(b, rate, row, cross_product(b->g, z, part_of(b, d, col)));
    return row.group == col.group ? rate
                                  : add(b, rate, col, cross_product(b->g, z, part_of(b, d, row)));
}

pm_node pm_given_reversible(pm_graph *g, const pm_operator_spec *spec, const pm_site *site,
                            const pm_support *support, pm_node d) {
    const builder b = {g, spec, site, support};
    pm_node rate = PM_NO_NODE;
    for (int k = 0; k < spec->ngiven; ++k) {
        const pm_given_pair *pair = &spec->given[k];
        const place row = place_of(support, pair->row), col = place_of(support, pair->col);
        if (pair->cross) {
            rate = add_cross(&b, rate, pair, row, col, d);
            continue;
        }
        const pm_node into_row = multiply(&b, pair, 1, part_of(&b, d, col));
        const pm_node into_col = multiply(&b, pair, -1, part_of(&b, d, row));
        rate = add(&b, rate, row, into_row);
        rate = add(&b, rate, col, into_col);
    }
    return rate;
}

// Adds the heat of a friction by a difference: equal parts of its power go to all components that
// take up heat.
static pm_node add_heat(const builder *b, pm_node rate, pm_node power, pm_node n) {
    int count = 0;
    for (int i = 0; i < b->support->ngroup; ++i) {
        const pm_site_group *group = b->support->group[i];
        count += pm_given_takes_heat(b->spec, group) ? group->size : 0;
    }
    for (int i = 0; i < b->support->ngroup; ++i) {
        const pm_site_group *group = b->support->group[i];
        const place p = {i, b->support->first[i], group->size};
        if (pm_given_takes_heat(b->spec, group)) {
            const pm_node share = pm_scale(b->g, power, 1.0 / count);
            rate = add(b, rate, p, pm_div(b->g, share, part_of(b, n, p)));
        }
    }
    return rate;
}

static pm_node add_difference(const builder *b, pm_node rate, const pm_given_pair *pair, place row,
                              place col, pm_node n) {
    const pm_node difference = pm_sub(b->g, part_of(b, n, row), part_of(b, n, col));
    const pm_node flow = multiply(b, pair, 1, difference);
    rate = add(b, rate, row, pm_scale(b->g, flow, -1));
    rate = add(b, rate, col, flow);
    return add_heat(b, rate, pm_dot(b->g, flow, difference), n);
}

pm_node pm_given_irreversible(pm_graph *g, const pm_operator_spec *spec, const pm_site *site,
                              const pm_support *support, pm_node d, pm_node n) {
    const builder b = {g, spec, site, support};
    pm_node rate = PM_NO_NODE;
    for (int k = 0; k < spec->ngiven; ++k) {
        const pm_given_pair *pair = &spec->given[k];
        const place row = place_of(support, pair->row), col = place_of(support, pair->col);
        if (pm_given_is_difference(spec, k, site)) {
            rate = add_difference(&b, rate, pair, row, col, n);
            continue;
        }
        const pm_node ratio = pm_div(g, part_of(&b, n, row), part_of(&b, n, col));
        const pm_node drive = pm_sub(g, part_of(&b, d, row), pm_mul(g, ratio, part_of(&b, d, col)));
        const pm_node into_row = multiply(&b, pair, 1, drive);
        const pm_node into_col = pm_scale(g, pm_dot(g, ratio, into_row), -1);
        rate = add(&b, rate, row, into_row);
        rate = add(&b, rate, col, into_col);
    }
    return rate;
}
