// Operators: their given pairs, the learned matrix in its frame, and the projection of equation (2)
// that makes the laws hold; the checks of a spec, and its parameters.
#include "model/operator.h"

#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/constants.h"
#include "model/dissipation.h"

// Keeps the projection finite where the normal vanishes and there is nothing to project out.
#define SMALLEST_NORMAL 1e-300

// The initial entries of the factor of a learned M have this magnitude. At zero the factor would
// have no gradient. The signs of its rows alternate, since the projection removes what all rows
// have in common.
#define FACTOR_START 1.0
// A constant conductance starts from this magnitude: too large a one falls in one iteration, but
// one that is too small can only grow while all temperature differences shrink.
#define CONDUCTION_START 5.0
#define MAX_ENTRIES (1 << 24) // of a learned matrix

// --- sites ---

void pm_site_add(pm_site *site, const pm_layout *layout, const char *prefix, int end) {
    for (int i = 0; i < layout->ngroup; ++i) {
        pm_site_group *group = &site->group[site->ngroup++];
        snprintf(group->name, sizeof group->name, "%s%s", prefix, layout->group[i].name);
        group->first = site->n;
        group->size = layout->group[i].size;
        group->end = end;
        group->entropy = layout->group[i].role == PM_ROLE_ENTROPY;
        site->n += group->size;
    }
}

bool pm_is_listed(int count, const char *const *list, const char *name) {
    for (int i = 0; i < count; ++i) {
        if (strcmp(list[i], name) == 0) {
            return true;
        }
    }
    return false;
}

// --- given pairs ---

// Splits a name such as "m[2]" into the name of the group and the number of the component, which is
// -1 where the name stands for the whole group ("m"). Returns false if the name has neither form;
// then group and component are undefined.
static bool split_name(const char *name, char group[PM_MAX_NAME], int *component) {
    const char *bracket = strchr(name, '[');
    const size_t length = bracket == NULL ? strlen(name) : (size_t)(bracket - name);
    if (length == 0 || length >= PM_MAX_NAME) {
        return false;
    }
    memcpy(group, name, length);
    group[length] = '\0';
    *component = -1;
    if (bracket == NULL) {
        return true;
    }
    const size_t digits = strspn(bracket + 1, "0123456789");
    *component = digits > 0 && digits <= 6 ? atoi(bracket + 1) : -1;
    return *component >= 0 && strcmp(bracket + 1 + digits, "]") == 0;
}

static bool is_of(const char *name, const char *group) {
    char own[PM_MAX_NAME];
    int component;
    return split_name(name, own, &component) && strcmp(own, group) == 0;
}

bool pm_given_names(const pm_operator_spec *spec, const char *group) {
    bool found = false;
    for (int i = 0; i < spec->ngiven && !found; ++i) {
        const pm_given_pair *pair = &spec->given[i];
        found = is_of(pair->row, group) || is_of(pair->col, group);
        for (int k = 0; k < pair->ndirection; ++k) {
            found = found || is_of(pair->direction[k].name, group);
        }
    }
    return found;
}

// Returns true if the group can take up heat: the operator's `heats` lists it, or, where `heats` is
// empty, it is an entropy.
static bool takes_heat(const pm_operator_spec *spec, const pm_site_group *group) {
    return spec->nheats > 0 ? pm_is_listed(spec->nheats, spec->heats, group->name) : group->entropy;
}

// Returns true if pair i of an irreversible operator is friction by a difference of two flows:
// neither of its groups takes up heat, and the site has a group that does.
static bool is_difference(const pm_operator_spec *spec, int i, const pm_site *site) {
    const pm_given_pair *pair = &spec->given[i];
    bool some = false, own = false;
    for (int k = 0; k < site->ngroup; ++k) {
        const bool heat = takes_heat(spec, &site->group[k]);
        some = some || heat;
        own = own || (heat && (is_of(pair->row, site->group[k].name) ||
                               is_of(pair->col, site->group[k].name)));
    }
    return some && !own && pair->ndirection == 0;
}

// --- supports ---

// Returns the number of components of all groups of the site that the operator's `heats` lists.
static int count_heats(const pm_operator_spec *spec, const pm_site *site) {
    int count = 0;
    for (int i = 0; i < site->ngroup; ++i) {
        const bool heated = pm_is_listed(spec->nheats, spec->heats, site->group[i].name);
        count += heated ? site->group[i].size : 0;
    }
    return count;
}

pm_support pm_support_of(const pm_operator_spec *spec, bool irreversible, const pm_site *site) {
    pm_support s = {0};
    bool difference = false;
    for (int i = 0; i < spec->ngiven && irreversible && spec->nheats == 0; ++i) {
        difference = difference || is_difference(spec, i, site);
    }
    for (int i = 0; i < site->ngroup; ++i) {
        const pm_site_group *group = &site->group[i];
        const bool listed = pm_is_listed(spec->nheats, spec->heats, group->name);
        const bool against =
            spec->learned && pm_is_listed(spec->nagainst, spec->against, group->name);
        const bool learned =
            spec->learned &&
            (pm_is_listed(spec->nacts, spec->acts_on, group->name) || (against && !irreversible));
        if (learned || against || pm_given_names(spec, group->name) ||
            (irreversible && (listed || (difference && group->entropy)))) {
            // If a single entropy takes up all the heat, its rate follows from the rates of the
            // other variables, and the learned factor has no row for it.
            s.group[s.ngroup] = group;
            s.learned[s.ngroup] = learned && !(listed && count_heats(spec, site) == 1);
            s.first[s.ngroup++] = s.n;
            s.n += group->size;
        }
    }
    return s;
}

// Returns the position of the group `name` in the support, or s->ngroup if it is not there.
static int find_group(const pm_support *s, const char *name) {
    int i = 0;
    while (i < s->ngroup && strcmp(s->group[i]->name, name) != 0) {
        ++i;
    }
    return i;
}

// --- names and sizes ---

bool pm_operator_exists(const pm_operator_spec *spec) {
    return spec->ngiven > 0 || spec->learned;
}

int pm_operator_frame_rows(const pm_operator_spec *spec, int group_size) {
    return spec->nalong > 0 && group_size > 1 ? spec->nalong : group_size;
}

const char *pm_operator_join(pm_operator_name buffer, const char *prefix, const char *name) {
    snprintf(buffer, sizeof(pm_operator_name), "%s.%s", prefix, name);
    return buffer;
}

// --- the shape of the learned matrix ---

// The matrix is C [rows][columns] of a reversible operator or the factor G [rows][columns] of an
// irreversible one. Its rows are those of the frame. A reversible operator has as many columns as
// rows or, with `against`, as the other list has rows; an irreversible one has as many as its rank.
typedef struct matrix_shape {
    int rows, columns;
} matrix_shape;

// Returns the rows of the frame in the groups of the list.
static int listed_rows(const pm_operator_spec *spec, const pm_support *s, int count,
                       const char *const *list) {
    int rows = 0;
    for (int i = 0; i < s->ngroup; ++i) {
        const bool counts = s->learned[i] && pm_is_listed(count, list, s->group[i]->name);
        rows += counts ? pm_operator_frame_rows(spec, s->group[i]->size) : 0;
    }
    return rows;
}

static matrix_shape shape_of(const pm_operator *op, const pm_support *support) {
    const pm_operator_spec *spec = op->spec;
    const int rows = listed_rows(spec, support, spec->nacts, spec->acts_on);
    const int columns = op->kind == PM_IRREVERSIBLE ? spec->rank
                        : spec->nagainst > 0
                            ? listed_rows(spec, support, spec->nagainst, spec->against)
                            : rows;
    return (matrix_shape){rows, columns};
}

// --- one operator while its expression is built ---

typedef struct construction {
    pm_graph *g;
    const pm_operator *op;
    const pm_site *site;
    pm_support support;
    pm_node scale;  // [1][support.n]
    pm_node matrix; // C - C^T [rows][rows] or G [rows][rank]; PM_NO_NODE: nothing learned
    pm_node along;  // [nalong][size]; PM_NO_NODE: the frame is the identity
} construction;

static pm_node part_of(const construction *c, pm_node x, int i) {
    return pm_slice(c->g, x, c->support.first[i], c->support.group[i]->size);
}

// --- given pairs ---

// The components of a support that a name in a pair stands for.
typedef struct place {
    int group, first, size; // group: position in the support, its ngroup where there is none
} place;

static place place_of(const pm_support *s, const char *name) {
    char group[PM_MAX_NAME];
    int component;
    place p = {s->ngroup, 0, 0};
    if (!split_name(name, group, &component)) {
        return p;
    }
    const int at = find_group(s, group);
    if (at == s->ngroup || component >= s->group[at]->size) {
        return p;
    }
    return (place){at, s->first[at] + (component > 0 ? component : 0),
                   component >= 0 ? 1 : s->group[at]->size};
}

static pm_status check_pair(const pm_operator_spec *spec, int i, bool reversible,
                            const pm_site *site, const pm_support *s, const char *what) {
    const pm_given_pair *pair = &spec->given[i];
    const place row = place_of(s, pair->row), col = place_of(s, pair->col);
    const bool there = row.group < s->ngroup && col.group < s->ngroup;
    for (int k = 0; k < pair->ndirection; ++k) {
        const place term = place_of(s, pair->direction[k].name);
        if (reversible || pair->cross || term.group == s->ngroup || term.size != 1 ||
            (term.group == col.group && term.first == col.first)) {
            return pm_fail(PM_ECONFIG,
                           "%s: a direction must name variables of one component, other than %s "
                           "which takes up the heat, in an irreversible operator: %s",
                           what, pair->col, pair->direction[k].name);
        }
    }
    if (there && pair->cross) {
        int size = 0;
        const bool fits = reversible && row.size == 3 && col.size == 3;
        return fits && pm_feature_size(pair->col, &site->symbols, &size) == PM_OK
                   ? PM_OK
                   : pm_fail(PM_ECONFIG,
                             "%s: given pair [%s, %s, cross] must name groups of three components, "
                             "in a reversible operator",
                             what, pair->row, pair->col);
    }
    const bool equal = reversible || is_difference(spec, i, site);
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

// Returns the components of a row [1][support.n] that a name stands for.
static pm_node at(const construction *c, pm_node x, place p) {
    return pm_slice(c->g, x, p.first, p.size);
}

// Returns x times `sign` times a coefficient, which a formula replaces.
static pm_node multiply_by(const construction *c, double coefficient, const pm_formula *formula,
                           double sign, pm_node x) {
    if (formula->text == NULL) {
        return pm_scale(c->g, x, sign * coefficient);
    }
    const pm_node value = pm_formula_build(c->g, formula, &c->site->symbols);
    return pm_mul(c->g, pm_scale(c->g, value, sign), x);
}

// Returns x times `sign` times the coefficient of a pair.
static pm_node multiply(const construction *c, const pm_given_pair *pair, double sign, pm_node x) {
    return multiply_by(c, pair->coefficient, &pair->formula, sign, x);
}

static pm_node add(const construction *c, pm_node rate, place p, pm_node into) {
    return pm_add_or(c->g, rate, pm_place(c->g, into, p.first, c->support.n));
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

// Returns the rate [1][support.n] of all reversible pairs for the driving co-energies d
// [1][support.n], or PM_NO_NODE if there is no pair. A pair with coefficient c adds
//     rate_row += c d_col,  rate_col -= c d_row
// and a cross product of three components each, for a state z,
//     rate_row += z_col x d_col  and, where the groups differ,  rate_col += z_col x d_row.
// Each sum does no work: d . rate = 0.
static pm_node given_reversible(const construction *c, pm_node d) {
    const pm_operator_spec *spec = c->op->spec;
    pm_node rate = PM_NO_NODE;
    for (int k = 0; k < spec->ngiven; ++k) {
        const pm_given_pair *pair = &spec->given[k];
        const place row = place_of(&c->support, pair->row), col = place_of(&c->support, pair->col);
        if (pair->cross) {
            const pm_node z = pm_feature_build(c->g, pair->col, &c->site->symbols);
            rate = add(c, rate, row, cross_product(c->g, z, at(c, d, col)));
            if (row.group != col.group) {
                rate = add(c, rate, col, cross_product(c->g, z, at(c, d, row)));
            }
            continue;
        }
        const pm_node into_row = multiply(c, pair, 1, at(c, d, col));
        const pm_node into_col = multiply(c, pair, -1, at(c, d, row));
        rate = add(c, rate, row, into_row);
        rate = add(c, rate, col, into_col);
    }
    return rate;
}

// Adds friction by a difference. Equal parts of its power go to all components that take up heat.
static pm_node add_difference(const construction *c, pm_node rate, const pm_given_pair *pair,
                              place row, place col, pm_node n) {
    const pm_operator_spec *spec = c->op->spec;
    const pm_node difference = pm_sub(c->g, at(c, n, row), at(c, n, col));
    const pm_node flow = multiply(c, pair, 1, difference);
    rate = add(c, rate, row, pm_scale(c->g, flow, -1));
    rate = add(c, rate, col, flow);
    const pm_node power = pm_dot(c->g, flow, difference);
    int count = 0;
    for (int i = 0; i < c->support.ngroup; ++i) {
        const pm_site_group *group = c->support.group[i];
        count += takes_heat(spec, group) ? group->size : 0;
    }
    for (int i = 0; i < c->support.ngroup; ++i) {
        const pm_site_group *group = c->support.group[i];
        const place p = {i, c->support.first[i], group->size};
        if (takes_heat(spec, group)) {
            const pm_node share = pm_scale(c->g, power, 1.0 / count);
            rate = add(c, rate, p, pm_div(c->g, share, at(c, n, p)));
        }
    }
    return rate;
}

// Returns the component of x [1][support.n] along the direction of a pair.
static pm_node along(const construction *c, const pm_given_pair *pair, pm_node x) {
    pm_node sum = PM_NO_NODE;
    for (int k = 0; k < pair->ndirection; ++k) {
        const pm_direction_term *a = &pair->direction[k];
        const pm_node own = at(c, x, place_of(&c->support, a->name));
        sum = pm_add_or(c->g, sum, multiply_by(c, a->coefficient, &a->formula, 1, own));
    }
    return sum;
}

// Returns the rate [1][support.n] of all irreversible pairs for the driving d = dS and the normal
// n = dE, both [1][support.n], or PM_NO_NODE if there is no pair. A pair of a variable and an
// entropy adds
//     rate_row += c (d_row - d_col n_row/n_col),  rate_col -= rate_row . n_row/n_col
// and friction by the difference f = n_row - n_col, whose heat N components k take up, adds
//     rate_row -= c f,  rate_col += c f,  rate_k += c f . f/(N n_k).
// A pair with a direction a is one of the component along it (pm_given_pair). Every pair is
// degenerate by itself, n . rate = 0, and produces entropy for c >= 0.
static pm_node given_irreversible(const construction *c, pm_node d, pm_node n) {
    pm_graph *g = c->g;
    const pm_operator_spec *spec = c->op->spec;
    pm_node rate = PM_NO_NODE;
    for (int k = 0; k < spec->ngiven; ++k) {
        const pm_given_pair *pair = &spec->given[k];
        const place row = place_of(&c->support, pair->row), col = place_of(&c->support, pair->col);
        if (is_difference(spec, k, c->site)) {
            rate = add_difference(c, rate, pair, row, col, n);
            continue;
        }
        if (pair->ndirection > 0) {
            const pm_node ratio = pm_div(g, along(c, pair, n), at(c, n, col));
            const pm_node drive = pm_sub(g, along(c, pair, d), pm_mul(g, ratio, at(c, d, col)));
            const pm_node flow = multiply(c, pair, 1, drive);
            for (int i = 0; i < pair->ndirection; ++i) {
                const pm_direction_term *a = &pair->direction[i];
                rate = add(c, rate, place_of(&c->support, a->name),
                           multiply_by(c, a->coefficient, &a->formula, 1, flow));
            }
            rate = add(c, rate, col, pm_scale(g, pm_mul(g, ratio, flow), -1));
            continue;
        }
        const pm_node ratio = pm_div(g, at(c, n, row), at(c, n, col));
        const pm_node drive = pm_sub(g, at(c, d, row), pm_mul(g, ratio, at(c, d, col)));
        const pm_node into_row = multiply(c, pair, 1, drive);
        const pm_node into_col = pm_scale(g, pm_dot(g, ratio, into_row), -1);
        rate = add(c, rate, row, into_row);
        rate = add(c, rate, col, into_col);
    }
    return rate;
}

// --- the learned matrix ---

// Applies U^T to each line: rows of the frame -> components of the support, with zeros in groups
// that the learned matrix does not touch.
static pm_node from_frame(const construction *c, pm_node rows) {
    const int lines = pm_graph_shape(c->g, rows).rows;
    pm_node part[2 * PM_MAX_GROUPS];
    int first = 0;
    for (int i = 0; i < c->support.ngroup; ++i) {
        const int size = c->support.group[i]->size;
        if (!c->support.learned[i]) {
            part[i] = pm_constant(c->g, 0, lines, size);
            continue;
        }
        const int nrow = pm_operator_frame_rows(c->op->spec, size);
        const pm_node x = pm_slice(c->g, rows, first, nrow);
        part[i] =
            c->along != PM_NO_NODE && size > 1 ? pm_matmul(c->g, x, false, c->along, false) : x;
        first += nrow;
    }
    return pm_concat(c->g, c->support.ngroup, part);
}

// Returns those rows of the frame whose groups are in the list, side by side.
static pm_node select_rows(const construction *c, pm_node x, int count, const char *const *list) {
    pm_node part[2 * PM_MAX_GROUPS];
    int found = 0, first = 0;
    for (int i = 0; i < c->support.ngroup; ++i) {
        const pm_site_group *group = c->support.group[i];
        const int rows = pm_operator_frame_rows(c->op->spec, group->size);
        if (c->support.learned[i] && pm_is_listed(count, list, group->name)) {
            part[found++] = pm_slice(c->g, x, first, rows);
        }
        first += c->support.learned[i] ? rows : 0;
    }
    return pm_concat(c->g, found, part);
}

// Returns the rows of the frame for an operator with `against`, in which the two lists drive each
// other: C times the rows of `against` for those of acts_on, and -C^T times the rows of acts_on for
// the others.
static pm_node apply_across(const construction *c, pm_node x) {
    pm_graph *g = c->g;
    const pm_operator_spec *spec = c->op->spec;
    const pm_node own = select_rows(c, x, spec->nacts, spec->acts_on);
    const pm_node other = select_rows(c, x, spec->nagainst, spec->against);
    const pm_node into_own = pm_matmul(g, other, false, c->matrix, true);
    const pm_node into_other = pm_scale(g, pm_matmul(g, own, false, c->matrix, false), -1);
    pm_node part[2 * PM_MAX_GROUPS];
    int count = 0, at[2] = {0, 0};
    for (int i = 0; i < c->support.ngroup; ++i) {
        const pm_site_group *group = c->support.group[i];
        const int rows = pm_operator_frame_rows(spec, group->size);
        const bool acts = pm_is_listed(spec->nacts, spec->acts_on, group->name);
        if (c->support.learned[i]) {
            part[count++] = pm_slice(g, acts ? into_own : into_other, at[acts], rows);
            at[acts] += rows;
        }
    }
    return pm_concat(g, count, part);
}

// Returns K d over the support.
static pm_node apply(const construction *c, pm_node d) {
    pm_graph *g = c->g;
    const bool reversible = c->op->kind == PM_REVERSIBLE;
    const pm_node given = reversible ? given_reversible(c, d) : PM_NO_NODE;
    if (c->matrix == PM_NO_NODE) {
        return given;
    }
    // U applies: scaled components of the support become rows of the frame.
    const pm_node scaled = pm_mul(g, d, c->scale);
    pm_node part[2 * PM_MAX_GROUPS];
    int count = 0;
    for (int i = 0; i < c->support.ngroup; ++i) {
        if (c->support.learned[i]) {
            const pm_node own = part_of(c, scaled, i);
            part[count++] = c->along != PM_NO_NODE && c->support.group[i]->size > 1
                                ? pm_matmul(g, own, false, c->along, true)
                                : own;
        }
    }
    const pm_node x = pm_concat(g, count, part);
    pm_node rows;
    if (c->op->spec->nagainst > 0) {
        rows = apply_across(c, x);
    } else { // (C - C^T) x or G G^T x
        rows = reversible ? x : pm_matmul(g, x, false, c->matrix, false);
        rows = pm_matmul(g, rows, false, c->matrix, true);
    }
    return pm_add_or(g, given, pm_mul(g, from_frame(c, rows), c->scale));
}

// Returns x - (x . measure)/square direction, which is orthogonal to measure if square is
// direction . measure.
static pm_node remove_along(pm_graph *g, pm_node x, pm_node measure, pm_node direction,
                            pm_node square) {
    const pm_node share = pm_div(g, pm_dot(g, x, measure), square);
    return pm_sub(g, x, pm_mul(g, share, direction));
}

// Returns P^T K P d, which is orthogonal to the normal. Each second pass removes the rounding error
// of the first one, which is proportional to the part that the first pass removed. A learned skew
// matrix may be much larger than what is left of its effect; the rate therefore loses its component
// along P d, too, which is nothing but rounding.
static pm_node apply_projected(const construction *c, pm_node d, pm_node normal) {
    pm_graph *g = c->g;
    const pm_node metric = pm_square(g, c->scale);
    const pm_node weighted = pm_mul(g, normal, metric); // W n
    const pm_node square = pm_offset(g, pm_dot(g, normal, weighted), SMALLEST_NORMAL);
    const bool learned = c->matrix != PM_NO_NODE;
    pm_node projected = d;
    for (int i = 0; i < (learned ? 2 : 1); ++i) {
        projected = remove_along(g, projected, weighted, normal, square);
    }
    pm_node rate = apply(c, projected);
    for (int i = 0; i < 2; ++i) {
        rate = remove_along(g, rate, normal, weighted, square);
    }
    if (learned && c->op->kind == PM_REVERSIBLE) {
        const pm_node own = pm_mul(g, projected, metric);
        const pm_node size = pm_offset(g, pm_dot(g, projected, own), SMALLEST_NORMAL);
        rate = remove_along(g, rate, projected, own, size);
    }
    return rate;
}

// Returns the processes of an operator with `heats` (dissipation.h), without their strength.
static pm_dissipation dissipation_of(const construction *c, const pm_params *params, pm_node d,
                                     pm_node normal) {
    pm_graph *g = c->g;
    const pm_operator_spec *spec = c->op->spec;
    const pm_node rows = from_frame(c, pm_transpose(g, c->matrix));
    const pm_shape shape = {true, 1, c->support.n};
    // The flow that leaves a group of acts_on enters the group against it.
    const pm_node own = pm_mul(g, rows, c->scale);
    pm_node part[2 * PM_MAX_GROUPS];
    for (int i = 0; i < c->support.ngroup; ++i) {
        part[i] = part_of(c, own, i);
    }
    for (int k = 0; k < spec->nagainst; ++k) {
        part[find_group(&c->support, spec->against[k])] =
            pm_scale(g, part[find_group(&c->support, spec->acts_on[k])], -1);
    }
    const bool shared = count_heats(spec, c->site) > 1;
    pm_dissipation dissipation = {
        .driving = pm_broadcast_to(g, d, shape),
        .normal = pm_broadcast_to(g, normal, shape),
        .factor = pm_concat(g, c->support.ngroup, part),
        .power = pm_network_param(g, params, c->op->prefix, "power"),
        .reference = pm_network_param(g, params, c->op->prefix, "temperature"),
        .warmth = pm_warmth(g, params),
        .split = shared ? pm_network_param(g, params, c->op->prefix, "split") : PM_NO_NODE,
        .ratio_power =
            shared ? pm_network_param(g, params, c->op->prefix, "ratio_power") : PM_NO_NODE,
        .strength = PM_NO_NODE,
    };
    for (int i = 0; i < c->support.ngroup; ++i) {
        const bool heated = pm_is_listed(spec->nheats, spec->heats, c->support.group[i]->name);
        for (int k = 0; k < c->support.group[i]->size && heated; ++k) {
            dissipation.heat[dissipation.nheat++] = c->support.first[i] + k;
        }
    }
    return dissipation;
}

// Adds what drives each process, "force" [1][rank], to the symbols of a site for a strength.
static pm_symbols with_force(const pm_operator *op, const pm_site *site, pm_node force) {
    pm_symbols symbols = site->symbols;
    pm_symbols_add_one(&symbols, "force", op->spec->rank, force);
    return symbols;
}

// Returns the rate of an operator with `heats`.
static pm_node apply_dissipation(const construction *c, const pm_params *params, pm_node d,
                                 pm_node normal) {
    const pm_operator_spec *spec = c->op->spec;
    pm_dissipation dissipation = dissipation_of(c, params, d, normal);
    if (spec->strength != NULL) {
        pm_operator_name name;
        pm_operator_join(name, c->op->prefix, "strength");
        const pm_symbols symbols =
            with_force(c->op, c->site, pm_dissipation_force(c->g, &dissipation));
        dissipation.strength =
            pm_network_build(c->g, spec->strength, &symbols, spec->rank, params, name);
    }
    return pm_dissipation_build(c->g, &dissipation);
}

// Restricts a row [1][site->n] to the support [1][support.n].
static pm_node restrict_to(const construction *c, pm_node x) {
    pm_node part[2 * PM_MAX_GROUPS];
    for (int i = 0; i < c->support.ngroup; ++i) {
        const pm_site_group *group = c->support.group[i];
        part[i] = pm_slice(c->g, x, group->first, group->size);
    }
    return pm_concat(c->g, c->support.ngroup, part);
}

// Begins the construction with the scales, the frame and the learned matrix.
static construction construct(pm_graph *g, const pm_operator *op, const pm_site *site,
                              const pm_params *params) {
    const pm_operator_spec *spec = op->spec;
    construction c = {.g = g,
                      .op = op,
                      .site = site,
                      .support = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site),
                      .along = PM_NO_NODE,
                      .matrix = PM_NO_NODE};
    c.scale = pm_network_param(g, params, op->prefix, "scale");
    if (spec->nalong > 0) { // the vectors as rows, each divided by its typical length
        const pm_node side_by_side =
            pm_features_build(g, spec->nalong, spec->along, &site->symbols);
        const int size = pm_graph_shape(g, side_by_side).cols / spec->nalong;
        const pm_node length = pm_network_param(g, params, op->prefix, "along");
        const pm_node rows = pm_reshape(g, side_by_side, spec->nalong, size);
        c.along = pm_div(g, rows, pm_reshape(g, length, spec->nalong, 1));
    }
    if (spec->learned) {
        pm_operator_name name;
        const matrix_shape shape = shape_of(op, &c.support);
        pm_operator_join(name, op->prefix, "matrix");
        const pm_node entries = pm_network_build(g, &spec->network, &site->symbols,
                                                 shape.rows * shape.columns, params, name);
        c.matrix = pm_reshape(g, entries, shape.rows, shape.columns);
        // C - C^T is formed before it is multiplied by x. In C x - C^T x the terms of the diagonal
        // would cancel only up to rounding.
        if (op->kind == PM_REVERSIBLE && spec->nagainst == 0) {
            c.matrix = pm_sub(g, c.matrix, pm_transpose(g, c.matrix));
        }
    }
    return c;
}

pm_node pm_operator_build(pm_graph *g, const pm_operator *op, const pm_site *site,
                          const pm_params *params, pm_node driving, pm_node normal,
                          pm_node *degeneracy) {
    const pm_operator_spec *spec = op->spec;
    if (!pm_operator_exists(spec) || driving == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    const construction c = construct(g, op, site, params);
    const pm_node d = restrict_to(&c, driving);
    const pm_node n = normal == PM_NO_NODE ? PM_NO_NODE : restrict_to(&c, normal);
    pm_node rate = PM_NO_NODE;
    if (op->kind == PM_IRREVERSIBLE && c.matrix == PM_NO_NODE) {
        // only given pairs, which are added below
    } else if (n == PM_NO_NODE) {
        rate = apply(&c, d);
    } else if (spec->nheats > 0 && c.matrix != PM_NO_NODE) {
        rate = apply_dissipation(&c, params, d, n);
    } else if (op->form == PM_HARD) {
        rate = apply_projected(&c, d, n);
    } else {
        const pm_node residual = pm_div(g, apply(&c, n), c.scale);
        *degeneracy = pm_concat_or(g, *degeneracy, residual);
        rate = apply(&c, d);
    }
    if (op->kind == PM_IRREVERSIBLE && n != PM_NO_NODE) {
        rate = pm_add_or(g, rate, given_irreversible(&c, d, n));
    }
    if (rate == PM_NO_NODE) {
        return PM_NO_NODE;
    }
    pm_node part[2 * PM_MAX_GROUPS]; // zeros in groups beyond the support
    for (int i = 0; i < site->ngroup; ++i) {
        const int k = find_group(&c.support, site->group[i].name);
        part[i] =
            k < c.support.ngroup ? part_of(&c, rate, k) : pm_constant(g, 0, 1, site->group[i].size);
    }
    return pm_concat(g, site->ngroup, part);
}

// --- declaring ---

static pm_status check_heats(const pm_operator *op, const pm_site *site) {
    const pm_operator_spec *spec = op->spec;
    if (spec->nheats == 0 && spec->strength != NULL) {
        return pm_fail(PM_ECONFIG, "%s: strength belongs to an operator with heats", op->prefix);
    }
    if (spec->nheats == 0 || !spec->learned) {
        return PM_OK;
    }
    if (op->form != PM_HARD) {
        return pm_fail(PM_ECONFIG, "%s: heats belongs to form: hard", op->prefix);
    }
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    for (int i = 0; i < s.ngroup; ++i) {
        if (s.learned[i]) {
            return count_heats(spec, site) <= PM_MAX_HEATS
                       ? PM_OK
                       : pm_fail(PM_ECONFIG, "%s: at most %d components can take up heat",
                                 op->prefix, PM_MAX_HEATS);
        }
    }
    return pm_fail(PM_ECONFIG, "%s: a single entropy has nothing to exchange heat with",
                   op->prefix);
}

static pm_status check_groups(const pm_operator *op, const pm_site *site) {
    const pm_operator_spec *spec = op->spec;
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    for (int i = 0; i < spec->nacts; ++i) {
        if (find_group(&s, spec->acts_on[i]) == s.ngroup) {
            return pm_fail(PM_ECONFIG, "%s: acts_on names \"%s\", which is not a group here",
                           op->prefix, spec->acts_on[i]);
        }
    }
    for (int i = 0; i < spec->nheats; ++i) {
        if (find_group(&s, spec->heats[i]) == s.ngroup) {
            return pm_fail(PM_ECONFIG, "%s: heats names \"%s\", which is not a group here",
                           op->prefix, spec->heats[i]);
        }
    }
    PM_TRY(check_heats(op, site));
    for (int i = 0; i < spec->nagainst; ++i) {
        if (find_group(&s, spec->against[i]) == s.ngroup) {
            return pm_fail(PM_ECONFIG, "%s: against names \"%s\", which is not a group here",
                           op->prefix, spec->against[i]);
        }
        if (pm_is_listed(spec->nacts, spec->acts_on, spec->against[i])) {
            return pm_fail(PM_ECONFIG, "%s: against names \"%s\", as acts_on does", op->prefix,
                           spec->against[i]);
        }
    }
    for (int i = 0; i < spec->nagainst && op->kind == PM_IRREVERSIBLE; ++i) {
        const int own = i < spec->nacts ? find_group(&s, spec->acts_on[i]) : s.ngroup;
        if (spec->nheats == 0 || own == s.ngroup ||
            s.group[own]->size != s.group[find_group(&s, spec->against[i])]->size) {
            return pm_fail(PM_ECONFIG,
                           "%s: \"%s\" needs a group of its size at the same place of acts_on, and "
                           "heats",
                           op->prefix, spec->against[i]);
        }
    }
    for (int i = 0; i < spec->ngiven; ++i) {
        PM_TRY(check_pair(spec, i, op->kind == PM_REVERSIBLE, site, &s, op->prefix));
    }
    return PM_OK;
}

static pm_status check_along(const pm_operator *op, const pm_site *site, const pm_support *s) {
    const pm_operator_spec *spec = op->spec;
    int total = 0;
    PM_TRY(pm_features_size(spec->nalong, spec->along, &site->symbols, &total));
    for (int k = 0; k < spec->nalong; ++k) {
        int size = 0;
        PM_TRY(pm_feature_size(spec->along[k], &site->symbols, &size));
        if (size * spec->nalong != total) {
            return pm_fail(PM_ECONFIG, "%s: the vectors of along differ in size: \"%s\" has %d",
                           op->prefix, spec->along[k], size);
        }
        for (int i = 0; i < s->ngroup; ++i) {
            if (s->learned[i] && s->group[i]->size > 1 && s->group[i]->size != size) {
                return pm_fail(PM_ECONFIG, "%s: \"%s\" has %d components, %s has %d", op->prefix,
                               spec->along[k], size, s->group[i]->name, s->group[i]->size);
            }
        }
    }
    return PM_OK;
}

// Adds trained numbers that start at zero. Far from good weights they would only go astray, because
// the rates hardly depend on them there.
static pm_status add_late(pm_params *params, const char *name, int rows, int columns) {
    PM_TRY(pm_params_add(params, name, rows, columns, true, 0, 0));
    pm_params_find(params, name)->late = PM_LATE;
    return PM_OK;
}

// Declares the exponents of the dependence of the processes on temperature, the network of their
// strengths, and the shares of their heat.
static pm_status declare_split(const pm_operator *op, const pm_site *site, pm_params *params) {
    const pm_operator_spec *spec = op->spec;
    const int nheat = count_heats(spec, site), rank = spec->rank;
    pm_operator_name name, output;
    PM_TRY(pm_params_add(params, pm_operator_join(name, op->prefix, "temperature"), 1, 1, false, 0,
                         PM_DEFAULT_TEMPERATURE));
    PM_TRY(pm_params_add_shared(params, PM_WARMTH, 0));
    PM_TRY(add_late(params, pm_operator_join(name, op->prefix, "power"), 1, rank));
    if (spec->strength != NULL) { // its outputs start at zero, so that all strengths are 1
        pm_operator_join(name, op->prefix, "strength");
        const size_t length = strlen(name);
        const pm_symbols symbols = with_force(op, site, PM_NO_NODE);
        PM_TRY(pm_network_declare(spec->strength, &symbols, rank, NULL, params, name));
        pm_param_entry *weight =
            pm_params_find(params, pm_operator_join(output, name, "output.weight"));
        if (weight != NULL) {
            weight->spread = 0;
        }
        for (int i = 0; i < params->count; ++i) {
            pm_param_entry *entry = &params->entry[i];
            if (entry->trained && strncmp(entry->name, name, length) == 0 &&
                entry->name[length] == '.') {
                entry->late = PM_LATE;
            }
        }
    }
    if (nheat < 2) {
        return PM_OK;
    }
    PM_TRY(add_late(params, pm_operator_join(name, op->prefix, "ratio_power"), 1, rank));
    return add_late(params, pm_operator_join(name, op->prefix, "split"), rank, nheat - 1);
}

static pm_status declare_matrix(const pm_operator *op, const pm_site *site, const pm_support *s,
                                pm_params *params) {
    pm_operator_name name;
    pm_operator_join(name, op->prefix, "matrix");
    const pm_network_spec *network = &op->spec->network;
    const matrix_shape shape = shape_of(op, s);
    if ((int64_t)shape.rows * shape.columns > MAX_ENTRIES) {
        return pm_spec_locate(op->spec->at,
                              pm_fail(PM_ECONFIG,
                                      "%s: a learned matrix of %d x %d, at most %d "
                                      "entries are possible",
                                      op->prefix, shape.rows, shape.columns, MAX_ENTRIES));
    }
    const int nout = shape.rows * shape.columns;
    if (op->spec->nheats > 0) {
        PM_TRY(declare_split(op, site, params));
    }
    if (op->kind == PM_REVERSIBLE) {
        return pm_network_declare(network, &site->symbols, nout, NULL, params, name);
    }
    double *start = malloc((size_t)nout * sizeof *start);
    PM_TRY(pm_allocated(start, "an operator"));
    // An operator with `heats` that acts on these entropies alone conducts heat between them.
    // Others start from the numbers that the spread of the network draws.
    bool conducts = op->spec->nacts > 0;
    for (int i = 0; i < op->spec->nacts; ++i) {
        conducts =
            conducts && pm_is_listed(op->spec->nheats, op->spec->heats, op->spec->acts_on[i]);
    }
    const double size = op->spec->nheats == 0    ? 1
                        : !conducts              ? 0
                        : network->nfeature == 0 ? CONDUCTION_START
                                                 : 1;
    for (int i = 0; i < nout; ++i) {
        const double alternating = i / op->spec->rank % 2 == 0 ? FACTOR_START : -FACTOR_START;
        start[i] = size * alternating;
    }
    const pm_status status = pm_network_declare(network, &site->symbols, nout, start, params, name);
    free(start);
    return status;
}

pm_status pm_operator_declare(const pm_operator *op, const pm_site *site, pm_params *params) {
    const pm_operator_spec *spec = op->spec;
    if (!pm_operator_exists(spec)) {
        return PM_OK;
    }
    PM_TRY(pm_spec_locate(spec->at, check_groups(op, site)));
    for (int i = 0; i < spec->ngiven; ++i) {
        const pm_given_pair *pair = &spec->given[i];
        PM_TRY(pair->formula.text != NULL ? pm_formula_check(&pair->formula, &site->symbols)
                                          : PM_OK);
        for (int k = 0; k < pair->ndirection; ++k) {
            const pm_formula *formula = &pair->direction[k].formula;
            PM_TRY(formula->text != NULL ? pm_formula_check(formula, &site->symbols) : PM_OK);
        }
    }
    // Lets the learned coefficients of lossless pairs wait until initial weights have been chosen.
    // An energy that is larger by a factor, with a coefficient that is smaller by it, moves all but
    // the heat as before, so that the coefficients would go astray while the energy is far from its
    // place.
    for (int k = 0; k < op->spec->ngiven && op->kind == PM_REVERSIBLE; ++k) {
        const pm_formula *formula = &op->spec->given[k].formula;
        const pm_constants *constants = formula->text == NULL ? NULL : formula->constants;
        for (int i = 0; constants != NULL && i < constants->count; ++i) {
            char name[PM_MAX_NAME + 16];
            snprintf(name, sizeof name, PM_CONSTANT_PREFIX "%.*s", PM_MAX_NAME, constants->name[i]);
            pm_param_entry *entry = pm_params_find(params, name);
            if (entry != NULL && strstr(formula->text, constants->name[i]) != NULL) {
                entry->late = PM_LATE;
            }
        }
    }
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    PM_TRY(pm_spec_locate(spec->at, check_along(op, site, &s)));
    pm_operator_name name;
    PM_TRY(pm_params_add(params, pm_operator_join(name, op->prefix, "scale"), 1, s.n, false, 0, 1));
    if (spec->nalong > 0) {
        pm_operator_join(name, op->prefix, "along");
        PM_TRY(pm_params_add(params, name, 1, spec->nalong, false, 0, 1));
    }
    return spec->learned ? declare_matrix(op, site, &s, params) : PM_OK;
}

pm_status pm_operator_visit(pm_graph *g, const pm_operator *op, const pm_site *site,
                            const pm_params *params, pm_node driving, pm_node normal,
                            pm_normaliser_visit *visit, void *context) {
    const pm_operator_spec *spec = op->spec;
    if (!pm_operator_exists(spec)) {
        return PM_OK;
    }
    const pm_support s = pm_support_of(spec, op->kind == PM_IRREVERSIBLE, site);
    const char *group[2 * PM_MAX_GROUPS];
    for (int i = 0; i < s.ngroup; ++i) {
        group[i] = s.group[i]->name;
    }
    const pm_normaliser scale = {.kind = op->kind == PM_REVERSIBLE ? PM_NORMALISE_SCALE
                                                                   : PM_NORMALISE_FRICTION,
                                 .prefix = op->prefix,
                                 .count = s.ngroup,
                                 .expression = group,
                                 .symbols = &site->symbols,
                                 .nheats = spec->learned ? spec->nheats : 0,
                                 .heats = spec->heats};
    PM_TRY(visit(context, &scale));
    if (spec->nalong > 0) {
        const pm_normaliser along = {.kind = PM_NORMALISE_ALONG,
                                     .prefix = op->prefix,
                                     .count = spec->nalong,
                                     .expression = spec->along,
                                     .symbols = &site->symbols};
        PM_TRY(visit(context, &along));
    }
    pm_operator_name name;
    if (spec->strength != NULL && driving != PM_NO_NODE && normal != PM_NO_NODE) {
        const construction c = construct(g, op, site, params);
        const pm_dissipation processes =
            dissipation_of(&c, params, restrict_to(&c, driving), restrict_to(&c, normal));
        const pm_symbols symbols = with_force(op, site, pm_dissipation_force(g, &processes));
        PM_TRY(pm_network_visit(spec->strength, &symbols,
                                pm_operator_join(name, op->prefix, "strength"), visit, context));
    }
    return spec->learned
               ? pm_network_visit(&spec->network, &site->symbols,
                                  pm_operator_join(name, op->prefix, "matrix"), visit, context)
               : PM_OK;
}
